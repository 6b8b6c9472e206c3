"""The page about the paper's figures, made from the tables on disk: reports/paper/index.html."""

import re
from collections import Counter, namedtuple
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from agents.provenance import circumstances
from experiments.lab import page
from experiments.paper import hidden_values, tables
from experiments.paper.catalogue import NAMES, heading, load
from experiments.paper.contradictions import contradictions
from experiments.paper.statements import Basis, Verdict

Entry = namedtuple("Entry", ["name", "heading", "module", "statements", "wide"])
"""A figure on the page; a wide one stands alone in its row."""
WIDE = 650.0  # points


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
            entries.append(Entry(name, heading(name), module, tuple(module.statements(found[name])), _wide(file)))
        except (KeyError, IndexError, ValueError) as error:
            word = name.removeprefix("figure_")
            raise ValueError(
                f"{file} is not of this version ({error!r}): python -m experiments.paper {word}"
            ) from error
    return entries, found


def _wide(table: Path) -> bool:
    width = re.search(r'width="([\d.]+)pt"', table.with_suffix(".svg").read_text())
    return width is not None and float(width[1]) > WIDE


def write(folder: Path, run: Mapping[str, Any]) -> Path:
    """Write the page about all figures whose tables are in `folder`; return its path.

    Args:
        folder: of tables and figures.
        run: command and seconds of what made the figures.
    """
    entries, found = read(folder)
    if not entries:
        raise ValueError(f"{folder} has no tables")
    every = [statement for entry in entries for statement in entry.statements]
    rows = [{"figure": entry.name, **asdict(statement)} for entry in entries for statement in entry.statements]
    columns = {column: np.array([row[column] for row in rows], object) for column in rows[0]}
    tables.write(folder / "statements.csv", columns)
    return page.write(
        folder,
        "paper",
        entries=entries,
        total=len(every),
        bases=Counter(statement.basis for statement in every),
        counts=Counter(statement.verdict for statement in every),
        tested=Counter(statement.verdict for statement in every if statement.basis is Basis.TEST),
        verdicts=Verdict,
        basis=Basis,
        contradictions=contradictions(found),
        intervals=list(hidden_values.intervals(found["hidden_values"])) if "hidden_values" in found else [],
        missing=[heading(name) if name.startswith("figure") else name for name in NAMES if name not in found],
        runs=[{**run, **circumstances("impact-gym", "numpy", "scipy", "matplotlib")}],
    )
