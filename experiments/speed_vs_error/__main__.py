"""`python -m experiments.speed_vs_error`: measure what is missing, draw, write reports/speed_vs_error/index.html."""

import shlex
import sys
from pathlib import Path

import tyro

from experiments.lab.results import REPORTS
from experiments.speed_vs_error.study import FULL, QUICK, run


def main(out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Measure speed against error and write a page about it; what is on disk is not measured again.

    Args:
        out: folder for tables, figures and the page: reports/speed_vs_error, or speed_vs_error_quick beside it.
        quick: a first look in under a minute: few settings, few scenes.
        force: measure everything again.
    """
    folder = out or REPORTS / ("speed_vs_error_quick" if quick else "speed_vs_error")
    command = shlex.join(["python", "-m", "experiments.speed_vs_error", *sys.argv[1:]])
    try:
        written = run(folder, QUICK if quick else FULL, force, command)
    except KeyboardInterrupt:
        print("experiments.speed_vs_error: interrupted; what was measured is kept", file=sys.stderr)
        sys.exit(130)
    print(f"speed against error: {written.resolve().as_uri()}")


if __name__ == "__main__":
    tyro.cli(main)
