"""`impact-gym stability`: a storm of random scenes, and reports/stability/index.html about it."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import tyro

from experiments.lab import experiment
from experiments.lab.experiment import Shown, Tables
from experiments.lab.tables import Gather
from experiments.solver import approaches, figures, promises, storm, timing
from experiments.solver.solutions import CLASSES, storm_truths
from experiments.solver.timing import IN_THE_STORM, Settings

EVERY, FIRST = 50, 17  # one scene in so many is judged by the independent solver: 2 %; the scenes are random themselves
SHOWN = 200  # failures in the page; the table has all


@dataclass(frozen=True)
class Extent:
    """How much is done besides the storm itself."""

    patience: float  # s by the clock, for the independent solver on a scene
    contested: int  # scenes that rivals meet
    rivals: Settings


FULL = Extent(60.0, 250, IN_THE_STORM)
QUICK = Extent(10.0, 6, [rival for rival in IN_THE_STORM if timing.CAREFUL not in rival[0] and rival[1] != 1e-5])


def sampled(count: int) -> range:
    """Return the numbers of the random sample of so many scenes."""
    return range(FIRST, count, EVERY)


def tables(count: int, extent: Extent, gather: Gather) -> Tables:
    """Return all tables of a storm of `count` scenes, after computing what is missing of them."""
    contest, rows = timing.sample(extent.contested), storm.rows(gather, count)
    truths = storm_truths(gather, sorted({*sampled(count), *contest}), extent.patience)
    return {
        "storm": rows,
        "failures": [failure for row in rows for failure in promises.failures(row)],
        "truth": list(truths.values()),
        "agreement": promises.agreement(rows, {number: truths[number] for number in sampled(count)}),
        "rivals": timing.in_storm(gather, {number: truths[number] for number in contest}, extent.rivals),
    }


def shown(tables: Tables) -> Shown:
    """Return figures and what the page says."""
    rows, judged, broken = (tables[name] for name in ("storm", "agreement", "failures"))
    judging = [row for row in tables["truth"] if int(row["scene"]) in sampled(len(rows))]
    unknown, shares = [row for row in judging if row["failure"]], timing.shares(tables["rivals"])
    return {"storm": figures.storm(rows, judged), "rivals": figures.who_stands(shares)}, {
        "promises": [*promises.over_storm(rows, broken), promises.over_agreement(judged, len(unknown))],
        "failures": broken,
        "shown": SHOWN,
        "apart": [(row, reason) for row in judged if (reason := promises.disagreement(row))],
        "unknown": unknown,
        "sampled": len(judging),
        "table": shares,
        "classes": CLASSES,
        "timing": timing,
        "ranges": approaches,
        "size": len(rows),
        "energy": promises.ENERGY,
    }


def main(scenes: int | None = None, out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Send random scenes through the solver and others, and write a page about its robustness.

    What is on disk is not computed again.

    Args:
        scenes: how many: 10000, or 200 of a quick run.
        out: folder for tables, figures and the page: reports/stability, or stability_quick beside it.
        quick: a first look in under a minute: few scenes, few contenders.
        force: compute everything again.
    """
    count = scenes or (200 if quick else 10_000)
    compute = partial(tables, count, QUICK if quick else FULL)
    experiment.command("solver.stability", compute, shown, out, quick, again=force)


if __name__ == "__main__":
    tyro.cli(main, prog="impact-gym stability")
