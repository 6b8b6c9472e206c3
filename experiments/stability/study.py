"""The whole study: compute what is missing, draw, write the page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.lab import page
from experiments.lab import tables as records
from experiments.lab.charts import save
from experiments.lab.results import noted
from experiments.lab.tables import Row
from experiments.stability import agreement, bars, figures, hard_cases, invariances, rivals, scenes, storm

IN_A_QUICK_RUN = ("impact_gym", "solve_ivp", "0.0001")  # rivals whose names have one of these
SHOWN = 200  # failures in the page; the table has all


def tables(folder: Path, count: int, quick: bool, processes: int | None = None) -> dict[str, list[Row]]:
    """Return all tables of a storm of `count` scenes, after computing what `folder` does not have of them.

    A `quick` look has fewer scenes for rivals and invariances, fewer rivals and hard cases, and less time for the
    independent solver.
    """
    patience, contested, size = (10.0, 6, 8) if quick else (60.0, 250, 300)  # s by the clock, scenes, scenes
    names = [name for name in rivals.RIVALS if not quick or any(word in name for word in IN_A_QUICK_RUN)]
    sampled, contest = agreement.sampled(count), rivals.sample(contested)
    rows = storm.rows(folder, count, processes)
    truths = agreement.truths(folder, sorted({*sampled, *contest}), patience, processes)
    judges = {number: truths[number] for number in contest}
    return {
        "storm": rows,
        "truth": list(truths.values()),
        "agreement": agreement.comparisons(folder, {number: truths[number] for number in sampled}, processes),
        "rivals": rivals.rows(folder, judges, names, processes),
        "invariances": invariances.rows(folder, size, rows, processes),
        "hard_cases": hard_cases.rows(folder, quick, processes),
    }


def run(folder: Path, count: int, quick: bool, again: bool, command: str, processes: int | None = None) -> Path:
    """Compute what `folder` does not have of a storm, or everything `again`; return the path of the page."""
    with noted(folder, command, (), again) as runs:
        found = tables(folder, count, quick, processes)
    return write(folder, found, runs)


def write(folder: Path, tables: Mapping[str, Sequence[Row]], runs: Sequence[Mapping[str, Any]]) -> Path:
    """Write the tables, and one of what broke a promise; draw them and write the page; return its path."""
    rows, judged, shares = tables["storm"], tables["agreement"], rivals.table(tables["rivals"])
    broken = [failure for row in rows for failure in bars.failures(row)]
    for name, found in {**tables, "failures": broken}.items():
        (folder / f"{name}.csv").unlink(missing_ok=True)
        if found:
            records.write(folder / f"{name}.csv", found)
    save(figures.storm(rows, judged), folder / "storm.svg")
    save(figures.who_stands(shares), folder / "rivals.svg")
    save(figures.hard_cases(tables["hard_cases"]), folder / "hard_cases.svg")
    sampled = [row for row in tables["truth"] if int(row["scene"]) in agreement.sampled(len(rows))]
    unknown = [row for row in sampled if row["failure"]]
    return page.write(
        folder,
        "stability",
        bars=[*bars.over_storm(rows, broken), bars.over_agreement(judged, len(unknown))],
        invariances=tables["invariances"],
        failures=broken,
        shown=SHOWN,
        apart=[(row, bars.disagreement(row)) for row in judged if bars.disagreement(row)],
        unknown=unknown,
        sampled=len(sampled),
        table=shares,
        rivals=rivals,
        storm=scenes,
        size=len(rows),
        energy=bars.ENERGY,
        runs=runs,
    )
