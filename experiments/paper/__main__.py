"""`python -m experiments.paper [NUMBER ...]`: compute and draw figures of the paper below reports/paper."""

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tqdm import tqdm

from experiments.charts import save
from experiments.paper import tables
from experiments.results import REPORTS

NUMBERS = sorted(int(path.stem.removeprefix("figure_")) for path in Path(__file__).parent.glob("figure_*.py"))


@dataclass(frozen=True)
class Settings:
    """Reproduce figures of the paper."""

    numbers: Annotated[tuple[int, ...], tyro.conf.Positional] = ()
    """Which figures; none means all there are."""
    out: Path = REPORTS / "paper"
    """Folder for tables and figures."""


def main() -> None:
    """Read the settings from the command line, compute, draw."""
    settings = tyro.cli(Settings)
    unknown = sorted(set(settings.numbers) - set(NUMBERS))
    if unknown:
        raise SystemExit(f"no figure {unknown}: there are {NUMBERS}")
    settings.out.mkdir(parents=True, exist_ok=True)
    for number in tqdm(settings.numbers or NUMBERS, desc="figures"):
        module = importlib.import_module(f"experiments.paper.figure_{number:02}")
        table_file = settings.out / f"figure_{number:02}.csv"
        tables.write(table_file, module.compute())
        save(module.plot(tables.read(table_file)), settings.out / f"figure_{number:02}.svg")
    print(f"figures: {settings.out.resolve().as_uri()}")


if __name__ == "__main__":
    main()
