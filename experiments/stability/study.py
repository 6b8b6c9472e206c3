"""The whole study: compute what is missing, draw, write the page."""

import json
import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from experiments.results import circumstances
from experiments.speed_vs_error import records
from experiments.speed_vs_error.records import Row
from experiments.stability import agreement, hard_cases, invariances, page, rivals, storm
from impact_gym.files import whole_file


@dataclass(frozen=True)
class Extent:
    """How much is computed."""

    scenes: int  # of the storm
    every: int  # of them, one goes to the independent solver
    patience: float  # s by the clock, for it
    rivals: int  # scenes
    names: tuple[str, ...]  # of the rivals
    invariances: int  # scenes
    hard_cases: Callable[[], Sequence[Row]]


def few_hard_cases() -> list[Row]:
    """A point or two of each panel."""
    slow = (row for row in hard_cases.slow() if row["x"] >= 1e-3)
    return [*hard_cases.onset(places=1), *hard_cases.graze(scenes=1), *slow, *hard_cases.tolerance()]


def full(scenes: int) -> Extent:
    """Return the extent of a whole study."""
    names = tuple(rival.name for rival in rivals.rivals())
    return Extent(scenes, agreement.EVERY, 60.0, 250, names, 300, hard_cases.rows)


def quick(scenes: int) -> Extent:
    """Return the extent of a first look."""
    wanted = ("impact_gym", "solve_ivp", "0.0001")
    names = tuple(rival.name for rival in rivals.rivals() if any(word in rival.name for word in wanted))
    return Extent(scenes, agreement.EVERY, 10.0, 6, names, 8, few_hard_cases)


def _results(folder: Path) -> dict[str, Any]:
    """Return what earlier runs left to say about themselves."""
    file = folder / "results.json"
    found: dict[str, Any] = json.loads(file.read_text()) if file.is_file() else {"runs": []}
    return found


def _keep(folder: Path, results: dict[str, Any]) -> None:
    with whole_file(folder / "results.json") as file:
        file.write((json.dumps(results, indent=2) + "\n").encode())


def _invariances(folder: Path, extent: Extent) -> None:
    """Compute the table of invariances, unless there is one of these sources and this size."""
    path, mark = folder / page.INVARIANCES, f"{storm.sources()}, {extent.invariances} scenes"
    if all(row["run"] == mark for row in records.read(path)) and path.is_file():
        return
    rows = list(islice(storm.known(folder, extent.scenes), 4 * extent.invariances))
    before = {int(row["scene"]): row["object_velocity"] for row in rows if not row["failure"]}
    changes = [
        row["trace_change"] / max(abs(row["object_velocity"]), 1e-6 * row["speed"])
        for row in storm.known(folder, extent.scenes)
        if math.isfinite(row["trace_change"])
    ]
    table = invariances.table(extent.invariances, dict(islice(before.items(), extent.invariances)), changes)
    records.write(path, [row | {"run": mark} for row in table])


def run(folder: Path, extent: Extent, again: bool, command: str, processes: int | None = None) -> Path:
    """Compute what the tables in `folder` do not have, or everything `again`; return the path of the page."""
    begun = time.perf_counter()
    folder.mkdir(parents=True, exist_ok=True)
    if again:
        for table in [*folder.glob("*.csv"), *folder.glob("storm/*.csv"), folder / "results.json"]:
            table.unlink(missing_ok=True)
    results = _results(folder)
    this: dict[str, Any] = {
        "command": command,
        "load_before": os.getloadavg()[0],
        "seconds": None,  # until it is done: what a run that was interrupted has computed stays
        "computed": 0,
        **circumstances("impact-gym", "numpy", "scipy"),
    }
    results["runs"].append(this)
    results["sample"] = agreement.sample(extent.scenes, extent.every)
    _keep(folder, results)

    this["computed"] = storm.extend(folder, extent.scenes, processes)
    compared = rivals.sample(extent.rivals)
    numbers = sorted({*results["sample"], *compared})
    truths = agreement.extend(folder / page.TRUTH, numbers, extent.patience, processes)
    sampled = {number: truths[number] for number in results["sample"]}
    agreement.compare(folder / page.AGREEMENT, sampled, processes)
    judges = {number: truths[number] for number in compared}
    rivals.extend(folder / page.RIVALS, judges, extent.names, processes)
    _invariances(folder, extent)
    mark = storm.sources()
    if not any(row["run"] == mark for row in records.read(folder / page.HARD_CASES)) or again:
        records.write(folder / page.HARD_CASES, [row | {"run": mark} for row in extent.hard_cases()])

    this["seconds"] = time.perf_counter() - begun
    _keep(folder, results)
    return page.write(folder, extent.scenes, results)
