"""The run of every experiment: compute the rows that are missing, write the tables, draw them, write the page."""

import shlex
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl
from matplotlib.figure import Figure

from agents.command_line import command_line
from experiments.lab import page
from experiments.lab.charts import save
from experiments.lab.results import REPORTS, noted
from experiments.lab.tables import Gather, Row, gathered
from impact_gym.files import write_file

Tables = dict[str, list[Row]]
Compute = Callable[[Gather], Tables]
Shown = tuple[Mapping[str, Figure], Mapping[str, Any]]
"""Figures by name, and the other content of the page's template."""
Show = Callable[[Tables], Shown]


def command(
    name: str, compute: Compute, show: Show, out: Path | None, quick: bool, called: str = "", **options: Any
) -> None:
    """`run` for a command line; print where the page is.

    The folder is `out`, or reports/name, or name_quick beside it; `name` is of the package below `experiments`, with
    dots, of which the last part names folder and command, unless the command is `called` otherwise.
    """
    short = name.rpartition(".")[2]
    folder = out or REPORTS / (f"{short}_quick" if quick else short)
    line = shlex.join(["impact-gym", called or short, *sys.argv[1:]])
    with command_line(called or short, "what was computed is kept"):
        index = run(name.replace(".", "/"), folder, line, compute, show, quick=quick, **options)
    print(f"{short}: {index.resolve().as_uri()}")


def run(
    name: str, folder: Path, line: str, compute: Compute, show: Show,
    *, again: bool = False, packages: Iterable[str] = (), processes: int | None = None, quick: bool = False,
) -> Path:  # fmt: skip
    """Compute what `folder` does not have, or everything `again`; write and show it; return the path of the page."""
    with noted(folder, line, packages, again) as runs:
        tables = compute(partial(gathered, folder, processes=processes))
    figures, content = show(tables)
    return write(name, folder, tables, figures, {**content, "quick": quick}, runs)


def write(
    name: str, folder: Path, tables: Tables, figures: Mapping[str, Figure], content: Mapping[str, Any],
    runs: Sequence[Mapping[str, Any]],
) -> Path:  # fmt: skip
    """Write tables, as CSV for people, figures and the page into `folder`; return the path of the page."""
    for title, rows in tables.items():
        (folder / f"{title}.csv").unlink(missing_ok=True)
        if rows:
            write_file(folder / f"{title}.csv", pl.DataFrame(rows, infer_schema_length=None).write_csv())
    for title, figure in figures.items():
        save(figure, folder / f"{title}.svg")
    return page.write(folder, name, runs=runs, **content)
