"""The page about the storm, made from the tables on disk: one file, its figures inside."""

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from experiments.speed_vs_error import records
from experiments.speed_vs_error.page import short
from experiments.speed_vs_error.records import Row
from experiments.stability import bars, figures, rivals, storm
from experiments.stability.bars import Failure
from experiments.stability.scenes import EXPONENTS, OTHERS, RANGES
from impact_gym.files import whole_file

HERE = Path(__file__).parent
TRUTH, AGREEMENT, RIVALS = "truth.csv", "agreement.csv", "rivals.csv"
INVARIANCES, HARD_CASES, FAILURES = "invariances.csv", "hard_cases.csv", "failures.csv"
SHOWN = 200  # failures in the page; the table has all


def broken(folder: Path, count: int) -> list[Failure]:
    """Return every failure of the storm, in the order of the scenes."""
    return [failure for row in storm.known(folder, count) for failure in bars.failures(row)]


def extremes(columns: Mapping[str, Any]) -> dict[str, float]:
    """Return the worst of each column over the scenes that finished, and how many scenes there are."""
    done = columns["failure"] == ""

    worst = {name: _largest(columns[name][done]) for name in ("momentum_error", "impulse_error", "pull", "trace_fall")}
    struck = done & (columns["contacts"] > 0) & (columns["traced"] == 1)
    worst["excess"] = _largest((columns["energy_created"] - columns["energy_doubt"])[struck])
    worst["doubt"] = _largest(columns["energy_doubt"][struck])
    change = columns["finer_change"] / np.maximum(np.abs(columns["object_velocity"]), 1e-6 * columns["speed"])
    worst["settled"] = float(np.nanmedian(change)) if np.any(np.isfinite(change)) else float("nan")
    worst |= {name: _largest(columns[name]) for name in ("milliseconds", "steps")}
    worst["median"] = float(np.nanmedian(columns["milliseconds"]))
    worst["untraced"] = float(np.sum(done & (columns["traced"] == 0)))
    worst["scenes"] = float(len(done))
    return worst


def _largest(values: Any) -> float:
    values = values[np.isfinite(values)]
    return float(values.max()) if values.size else float("nan")


def listed(found: Sequence[Failure]) -> list[Row]:
    """Return the table of failures."""
    rows = []
    for failure in found:
        row = failure.row
        numbers = {name: row[name] for name in ("milliseconds", "steps", "slowest_contact")}
        words = {"contender": failure.promise, "failure": failure.reason, "coupling": row["coupling"]}
        rows.append({"scene": failure.scene, **words, **numbers, "description": row["description"]})
    return rows


def draw(folder: Path, columns: Mapping[str, Any], table: Sequence[Row], size: int) -> None:
    """Draw every figure from the tables in `folder`."""
    figures.both(figures.storm(columns, records.read(folder / AGREEMENT)), folder / "storm.svg")
    figures.both(figures.rivals(table, size), folder / "rivals.svg")
    figures.both(figures.hard_cases(records.read(folder / HARD_CASES)), folder / "hard_cases.svg")


def write(folder: Path, count: int, results: Mapping[str, Any]) -> Path:
    """Draw the figures and write the page and the table of failures; return the path of the page."""
    columns = storm.columns(folder, count)
    found = broken(folder, count)
    judged, truths = records.read(folder / AGREEMENT), records.read(folder / TRUTH)
    sampled = {row["scene"] for row in judged} | {row["scene"] for row in truths if row["failure"]}
    unknown = [row for row in truths if row["failure"] and int(row["scene"]) in results["sample"]]
    rival_rows = records.read(folder / RIVALS)
    table = rivals.table(rival_rows, list(dict.fromkeys(row["contender"] for row in rival_rows)))
    size = len({row["scene"] for row in rival_rows})
    invariances = records.read(folder / INVARIANCES)
    storm_bars = bars.over_storm(found, extremes(columns))
    rows = listed(found)
    if rows:
        records.write(folder / FAILURES, rows)
    else:
        (folder / FAILURES).unlink(missing_ok=True)
    draw(folder, columns, table, size)

    def image(name: str) -> str:
        return "data:image/svg+xml;base64," + base64.b64encode((folder / f"{name}.svg").read_bytes()).decode()

    pages = Environment(loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined)
    pages.filters |= {"short": short}
    text = pages.get_template("page.html.jinja").render(
        bars=[*storm_bars, bars.over_agreement(judged, len(unknown))],
        invariances=bars.over_invariances(invariances),
        failures=rows[:SHOWN],
        failure_count=len(rows),
        failing=len({row["scene"] for row in rows}),
        apart=[(row, bars.disagreement(row)) for row in judged if bars.disagreement(row)],
        unknown=unknown,
        sampled=len(sampled),
        scenes=len(columns["failure"]),
        table=table,
        classes=rivals.CLASSES,
        size=size,
        rival_settings=rivals,
        ranges=RANGES,
        others=OTHERS,
        pairs=len(set(EXPONENTS)),
        energy=bars.ENERGY,
        image=image,
        results=results,
    )
    with whole_file(folder / "index.html") as file:
        file.write(text.encode())
    return folder / "index.html"
