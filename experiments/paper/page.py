"""The page about the paper's figures, made from the tables on disk: reports/paper/index.html."""

import csv
import io
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from agents.provenance import circumstances
from experiments.lab import page
from experiments.paper import tables
from experiments.paper.catalogue import NAMES, Module, heading, load
from experiments.paper.contradictions import contradictions
from experiments.paper.statements import Statement, Verdict
from impact_gym.files import whole_file


@dataclass(frozen=True, slots=True)
class Entry:
    """A figure on the page."""

    name: str
    heading: str
    module: Module
    statements: tuple[Statement, ...]


def read(folder: Path) -> tuple[list[Entry], dict[str, tables.Table]]:
    """Return the figures that are in `folder` with their tables, judged afresh, and the tables.

    Raises:
        ValueError: a table is not as this version writes it; names it.
    """
    entries, found = [], {}
    for name in NAMES:
        file = folder / f"{name}.csv"
        if not (file.is_file() and file.with_suffix(".svg").is_file()):
            continue
        module = load(name)
        try:
            found[name] = tables.read(file)
            entries.append(Entry(name, heading(name), module, module.statements(found[name])))
        except (KeyError, IndexError, ValueError) as error:
            word = name.removeprefix("figure_")
            raise ValueError(
                f"{file} is not of this version ({error!r}): python -m experiments.paper {word}"
            ) from error
    return entries, found


def write_statements(path: Path, entries: list[Entry]) -> None:
    """Write one row per statement."""
    text = io.StringIO(newline="")
    rows = [{"figure": entry.name, **asdict(statement)} for entry in entries for statement in entry.statements]
    writer = csv.DictWriter(text, rows[0])
    writer.writeheader()
    writer.writerows(rows)
    with whole_file(path) as file:
        file.write(text.getvalue().encode())


def write(folder: Path, run: Mapping[str, Any]) -> Path:
    """Write the page about all figures whose tables are in `folder`; return its path.

    Args:
        folder: of tables and figures.
        run: command and seconds of what made the figures.
    """
    entries, found = read(folder)
    if not entries:
        raise ValueError(f"{folder} has no tables")
    write_statements(folder / "statements.csv", entries)
    every = [statement for entry in entries for statement in entry.statements]
    return page.write(
        folder,
        "paper",
        entries=entries,
        counts=Counter(statement.verdict for statement in every),
        total=len(every),
        fitted=[statement for statement in every if statement.fitted],
        verdicts=Verdict,
        contradictions=contradictions(found),
        missing=[heading(name) if name.startswith("figure") else name for name in NAMES if name not in found],
        runs=[{**run, **circumstances("impact-gym", "numpy", "scipy", "matplotlib")}],
    )
