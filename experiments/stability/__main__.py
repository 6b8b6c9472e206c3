"""`python -m experiments.stability`: a storm of random scenes, who stands in it, reports/stability/index.html."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from experiments.results import REPORTS
from experiments.stability.study import full, quick, run


@dataclass(frozen=True)
class Settings:
    """Test whether the solver stands, and write a page about it; what is on disk is not computed again."""

    scenes: int | None = None
    """How many scenes: 10000, or 200 of a quick run."""
    out: Path | None = None
    """Folder for tables, figures and the page: reports/stability, or stability_quick beside it."""
    quick: bool = False
    """A first look in under a minute: few scenes, few contenders."""
    force: bool = False
    """Compute everything again."""

    @property
    def folder(self) -> Path:
        """Where it goes."""
        return self.out or REPORTS / ("stability_quick" if self.quick else "stability")


def main() -> None:
    """Read the settings from the command line and run."""
    settings = tyro.cli(Settings)
    command = shlex.join(["python", "-m", "experiments.stability", *sys.argv[1:]])
    extent = quick(settings.scenes or 200) if settings.quick else full(settings.scenes or 10_000)
    try:
        written = run(settings.folder, extent, settings.force, command)
    except KeyboardInterrupt:
        print("experiments.stability: interrupted; what was computed is kept", file=sys.stderr)
        sys.exit(130)
    print(f"stability: {written.resolve().as_uri()}")


if __name__ == "__main__":
    main()
