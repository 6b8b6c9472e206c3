"""The whole study: compute what is missing, draw, write the page."""

from functools import partial
from pathlib import Path

from experiments.lab import experiment
from experiments.lab.experiment import Shown, Tables
from experiments.stability import agreement, bars, figures, hard_cases, invariances, rivals, scenes, storm

IN_A_QUICK_RUN = ("impact_gym", "solve_ivp", "0.0001")  # rivals whose names have one of these
SHOWN = 200  # failures in the page; the table has all


def tables(folder: Path, count: int, quick: bool, processes: int | None = None) -> Tables:
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
        "failures": [failure for row in rows for failure in bars.failures(row)],
        "truth": list(truths.values()),
        "agreement": agreement.comparisons(folder, {number: truths[number] for number in sampled}, processes),
        "rivals": rivals.rows(folder, judges, names, processes),
        "invariances": invariances.rows(folder, size, rows, processes),
        "hard_cases": hard_cases.rows(folder, quick, processes),
    }


def shown(tables: Tables) -> Shown:
    """Return figures and what the page says."""
    rows, judged, broken = (tables[name] for name in ("storm", "agreement", "failures"))
    sampled = [row for row in tables["truth"] if int(row["scene"]) in agreement.sampled(len(rows))]
    unknown, shares = [row for row in sampled if row["failure"]], rivals.table(tables["rivals"])
    drawn = {
        "storm": figures.storm(rows, judged),
        "rivals": figures.who_stands(shares),
        "hard_cases": figures.hard_cases(tables["hard_cases"]),
    }
    return drawn, {
        "bars": [*bars.over_storm(rows, broken), bars.over_agreement(judged, len(unknown))],
        "invariances": tables["invariances"],
        "failures": broken,
        "shown": SHOWN,
        "apart": [(row, bars.disagreement(row)) for row in judged if bars.disagreement(row)],
        "unknown": unknown,
        "sampled": len(sampled),
        "table": shares,
        "rivals": rivals,
        "storm": scenes,
        "size": len(rows),
        "energy": bars.ENERGY,
    }


def run(
    folder: Path, line: str, *, scenes: int, quick: bool, again: bool = False, processes: int | None = None
) -> Path:
    """Compute what `folder` does not have of a storm, or everything `again`; return the path of the page."""
    return experiment.run(
        "stability", folder, line, partial(tables, folder, scenes, quick, processes), shown, again=again
    )
