"""`python -m experiments.speed_vs_error`: measure what is missing, draw, write reports/speed_vs_error/index.html."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from experiments.lab.results import REPORTS
from experiments.speed_vs_error.study import FULL, QUICK, run


@dataclass(frozen=True)
class Settings:
    """Measure speed against error and write a page about it; what the tables have already is not measured again."""

    out: Path | None = None
    """Folder for tables, figures and the page: reports/speed_vs_error, or speed_vs_error_quick beside it."""
    quick: bool = False
    """A first look in under a minute: few settings, few scenes."""
    force: bool = False
    """Measure everything again."""


def main() -> None:
    """Read the settings from the command line and run."""
    settings = tyro.cli(Settings)
    command = shlex.join(["python", "-m", "experiments.speed_vs_error", *sys.argv[1:]])
    folder = settings.out or REPORTS / ("speed_vs_error_quick" if settings.quick else "speed_vs_error")
    try:
        written = run(folder, QUICK if settings.quick else FULL, settings.force, command)
    except KeyboardInterrupt:
        print("experiments.speed_vs_error: interrupted; what was measured is kept", file=sys.stderr)
        sys.exit(130)
    print(f"speed against error: {written.resolve().as_uri()}")


if __name__ == "__main__":
    main()
