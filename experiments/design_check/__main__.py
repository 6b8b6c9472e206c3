"""The command line of `experiments.design_check`: `python -m experiments.design_check`."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import tyro

from experiments.design_check import agreement, sizes, told
from experiments.lab.experiment import Shown, Tables, command
from experiments.lab.tables import Gather


@dataclass(frozen=True)
class Check:
    """Check the search for designs against a grid and against itself, and one tuning against other sizes and speeds."""

    out: Path | None = None
    """Folder; reports/design_check unless given."""
    quick: bool = False
    """A first look: three seeds, a coarse grid, coarse maps."""
    again: bool = False
    """Compute everything again."""
    processes: int | None = None
    """Jobs at a time; as many as there are cores unless given."""


def compute(gather: Gather, quick: bool) -> Tables:
    """Return the tables: what seeds and grid find, what a policy makes of the grid, maps of sizes and speeds."""
    found = agreement.tables(gather, quick)
    return found | told.tables(gather, found["grid"], quick) | {"sizes": sizes.rows(gather, quick)}


def show(tables: Tables) -> Shown:
    """Return the figures and what the page says."""
    figures = {
        "agreement": agreement.figure(tables),
        "told": told.figure(tables),
        "sizes": sizes.figure(tables["sizes"]),
    }
    return figures, {**agreement.said(tables), **told.said(tables), **sizes.said(tables["sizes"])}


def main() -> None:
    """Compute, draw and write what the command line asks for."""
    options = tyro.cli(Check, prog="python -m experiments.design_check")
    work = partial(compute, quick=options.quick)
    rest = {"again": options.again, "processes": options.processes, "packages": ("cma",)}
    command("design_check", work, show, options.out, options.quick, **rest)


if __name__ == "__main__":
    main()
