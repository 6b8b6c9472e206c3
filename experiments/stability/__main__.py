"""`python -m experiments.stability`: a storm of random scenes, who stands in it, reports/stability/index.html."""

import shlex
import sys
from pathlib import Path

import tyro

from experiments.lab.results import REPORTS
from experiments.stability.study import run


def main(scenes: int | None = None, out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Test whether the solver stands, and write a page about it; what is on disk is not computed again.

    Args:
        scenes: how many: 10000, or 200 of a quick run.
        out: folder for tables, figures and the page: reports/stability, or stability_quick beside it.
        quick: a first look in under a minute: few scenes, few contenders.
        force: compute everything again.
    """
    folder = out or REPORTS / ("stability_quick" if quick else "stability")
    command = shlex.join(["python", "-m", "experiments.stability", *sys.argv[1:]])
    try:
        written = run(folder, scenes or (200 if quick else 10_000), quick, force, command)
    except KeyboardInterrupt:
        print("experiments.stability: interrupted; what was computed is kept", file=sys.stderr)
        sys.exit(130)
    print(f"stability: {written.resolve().as_uri()}")


if __name__ == "__main__":
    tyro.cli(main)
