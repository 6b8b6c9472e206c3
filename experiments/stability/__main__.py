"""`python -m experiments.stability`: a storm of random scenes, who stands in it, reports/stability/index.html."""

from functools import partial
from pathlib import Path

import tyro

from experiments.lab import experiment
from experiments.lab.experiment import Shown, Tables
from experiments.lab.tables import Gather
from experiments.stability import agreement, figures, hard_cases, invariances, promises, rivals, scenes, storm

IN_A_QUICK_RUN = ("impact_gym", "solve_ivp", "0.0001")  # rivals whose names have one of these
SHOWN = 200  # failures in the page; the table has all


def tables(count: int, quick: bool, gather: Gather) -> Tables:
    """Return all tables of a storm of `count` scenes, after computing what is missing of them.

    A `quick` look has fewer scenes for rivals and invariances, fewer rivals and hard cases, and less time for the
    independent solver.
    """
    patience, contested, size = (10.0, 6, 8) if quick else (60.0, 250, 300)  # s by the clock, scenes, scenes
    names = [name for name in rivals.RIVALS if not quick or any(word in name for word in IN_A_QUICK_RUN)]
    sampled, contest = agreement.sampled(count), rivals.sample(contested)
    rows = storm.rows(gather, count)
    truths = agreement.truths(gather, sorted({*sampled, *contest}), patience)
    return {
        "storm": rows,
        "failures": [failure for row in rows for failure in promises.failures(row)],
        "truth": list(truths.values()),
        "agreement": agreement.comparisons(gather, {number: truths[number] for number in sampled}),
        "rivals": rivals.rows(gather, {number: truths[number] for number in contest}, names),
        "invariances": invariances.rows(gather, size, rows),
        "hard_cases": hard_cases.rows(gather, quick),
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
        "promises": [*promises.over_storm(rows, broken), promises.over_agreement(judged, len(unknown))],
        "invariances": tables["invariances"],
        "failures": broken,
        "shown": SHOWN,
        "apart": [(row, reason) for row in judged if (reason := promises.disagreement(row))],
        "unknown": unknown,
        "sampled": len(sampled),
        "table": shares,
        "rivals": rivals,
        "storm": scenes,
        "size": len(rows),
        "energy": promises.ENERGY,
    }


def main(scenes: int | None = None, out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Test whether the solver stands, and write a page about it; what is on disk is not computed again.

    Args:
        scenes: how many: 10000, or 200 of a quick run.
        out: folder for tables, figures and the page: reports/stability, or stability_quick beside it.
        quick: a first look in under a minute: few scenes, few contenders.
        force: compute everything again.
    """
    count = scenes or (200 if quick else 10_000)
    compute = partial(tables, count, quick)
    experiment.command("stability", compute, shown, out, quick, again=force)


if __name__ == "__main__":
    tyro.cli(main, prog="python -m experiments.stability")
