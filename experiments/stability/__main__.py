"""`python -m experiments.stability`: a storm of random scenes, who stands in it, reports/stability/index.html."""

from functools import partial
from pathlib import Path

import tyro

from experiments.lab import experiment
from experiments.stability import study


def main(scenes: int | None = None, out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Test whether the solver stands, and write a page about it; what is on disk is not computed again.

    Args:
        scenes: how many: 10000, or 200 of a quick run.
        out: folder for tables, figures and the page: reports/stability, or stability_quick beside it.
        quick: a first look in under a minute: few scenes, few contenders.
        force: compute everything again.
    """
    count = scenes or (200 if quick else 10_000)
    compute = partial(study.tables, count, quick)
    experiment.command("stability", compute, study.shown, out, quick, again=force)


if __name__ == "__main__":
    tyro.cli(main)
