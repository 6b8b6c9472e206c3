"""`python -m experiments.fidelity`: calibrate the predictions of impact_gym.fidelity, test them on other scenes."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from experiments.fidelity.study import FULL, QUICK, run
from experiments.results import REPORTS


@dataclass(frozen=True)
class Settings:
    """Calibrate impact_gym.fidelity, test it on other scenes, write a page; what is on disk is not computed again."""

    out: Path | None = None
    """Folder for rows, tables and the page: reports/fidelity, or fidelity_quick beside it."""
    quick: bool = False
    """A first look in under a minute: few scenes, so constants that are good for nothing."""
    ship: bool = False
    """Write the constants into the package, too."""

    @property
    def folder(self) -> Path:
        """Where it goes."""
        return self.out or REPORTS / ("fidelity_quick" if self.quick else "fidelity")


def main() -> None:
    """Read the settings from the command line and run."""
    settings = tyro.cli(Settings)
    if settings.quick and settings.ship:
        raise SystemExit("--ship needs the constants of a full calibration: leave out --quick")
    print(run(settings.folder, QUICK if settings.quick else FULL, settings.ship).resolve().as_uri())


if __name__ == "__main__":
    main()
