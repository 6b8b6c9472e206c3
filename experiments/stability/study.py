"""The whole study: compute what is missing, draw, write the page."""

import json
import os
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from agents.provenance import circumstances
from experiments.lab import tables as records
from experiments.lab.tables import Row
from experiments.stability import agreement, hard_cases, invariances, page, rivals, storm
from impact_gym.files import whole_file

IN_A_QUICK_RUN = ("impact_gym", "solve_ivp", "0.0001")  # rivals whose names have one of these


def once(path: Path, extent: str, rows: Callable[[], Sequence[Row]]) -> list[Row]:
    """Return the table at `path` if it is of these sources and this extent; make it anew if not."""
    run = f"{storm.sources()}, {extent}"
    found = [row for row in records.read(path) if row["run"] == run]
    if not found:
        found = [row | {"run": run} for row in rows()]
        records.write(path, found)
    return found


def tables(folder: Path, scenes: int, quick: bool, processes: int | None = None) -> tuple[dict[str, list[Row]], int]:
    """Compute what the tables in `folder` do not have; return them all, and how many scenes of the storm are new.

    A `quick` look has fewer scenes for rivals and invariances, fewer rivals and hard cases, and less time for the
    independent solver.
    """
    patience, contested, size = (10.0, 6, 8) if quick else (60.0, 250, 300)  # s by the clock, scenes, scenes
    names = [name for name in rivals.RIVALS if not quick or any(word in name for word in IN_A_QUICK_RUN)]
    rows, computed = storm.rows(folder, scenes, processes)
    sampled, compared = range(agreement.FIRST, scenes, agreement.EVERY), rivals.sample(contested)
    truths = agreement.truths(folder / "truth.csv", sorted({*sampled, *compared}), patience, processes)
    judged, judges = ({number: truths[number] for number in numbers} for numbers in (sampled, compared))
    return {
        "storm": rows,
        "truth": list(judged.values()),
        "agreement": agreement.comparisons(folder / "agreement.csv", judged, processes),
        "rivals": rivals.rows(folder / "rivals.csv", judges, names, processes),
        "invariances": once(folder / "invariances.csv", f"{size} scenes", partial(invariances.table, size, rows)),
        "hard_cases": once(folder / "hard_cases.csv", "few" if quick else "all", partial(hard_cases.rows, quick)),
    }, computed


def run(folder: Path, scenes: int, quick: bool, again: bool, command: str, processes: int | None = None) -> Path:
    """Compute what the tables in `folder` do not have, or everything `again`; return the path of the page."""
    begun, file = time.perf_counter(), folder / "results.json"
    folder.mkdir(parents=True, exist_ok=True)
    if again:
        for table in [*folder.glob("*.csv"), file]:
            table.unlink(missing_ok=True)
    results: dict[str, Any] = json.loads(file.read_text()) if file.is_file() else {"runs": []}
    this: dict[str, Any] = {
        "command": command,
        "load_before": os.getloadavg()[0],
        "seconds": None,  # of a run that is stopped
        "computed": 0,
        **circumstances("impact-gym", "numpy", "scipy"),
    }
    results["runs"].append(this)
    try:
        found, this["computed"] = tables(folder, scenes, quick, processes)
        this["seconds"] = time.perf_counter() - begun
    finally:
        with whole_file(file) as out:
            out.write((json.dumps(results, indent=2) + "\n").encode())
    return page.write(folder, found, results)
