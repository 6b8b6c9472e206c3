"""`python -m experiments.speed_vs_error`: measure what is missing, draw, write reports/speed_vs_error/index.html."""

from functools import partial
from pathlib import Path

import tyro

from experiments.lab import experiment
from experiments.speed_vs_error.contenders import MISSING, PACKAGES
from experiments.speed_vs_error.study import FULL, QUICK, shown, tables


def main(out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Measure speed against error and write a page about it; what is on disk is not measured again.

    Args:
        out: folder for tables, figures and the page: reports/speed_vs_error, or speed_vs_error_quick beside it.
        quick: a first look in under a minute: few settings, few scenes.
        force: measure everything again.
    """
    for name in MISSING:
        print(f"speed_vs_error: {name} is not installed (extra `peers`); it takes no part")
    compute, packages = partial(tables, QUICK if quick else FULL), set(PACKAGES.values()) - set(MISSING.values())
    experiment.command("speed_vs_error", compute, shown, out, quick, again=force, packages=sorted(packages))


if __name__ == "__main__":
    tyro.cli(main)
