"""The page about the paper's figures, made from the tables on disk: reports/paper/index.html."""

from collections import Counter, namedtuple
from dataclasses import asdict
from pathlib import Path

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from agents.provenance import circumstances
from experiments.paper import tables
from experiments.paper.catalogue import HERE, NAMES, heading, load
from experiments.paper.contradictions import contradictions
from experiments.paper.statements import Verdict
from impact_gym.files import whole_file

Entry = namedtuple("Entry", ["name", "heading", "module", "statements"])
"""A figure on the page."""


def read(folder: Path) -> tuple[list[Entry], dict[str, tables.Table]]:
    """Return the figures whose tables are in `folder`, judged afresh, and the tables.

    Raises:
        ValueError: a table is not as this version writes it; names it.
    """
    entries, found = [], {}
    for name in NAMES:
        file = folder / f"{name}.csv"
        if not file.is_file():
            continue
        module = load(name)
        try:
            found[name] = tables.read(file)
            entries.append(Entry(name, heading(name), module, tuple(module.statements(found[name]))))
        except (KeyError, IndexError, ValueError) as error:
            word = name.removeprefix("figure_")
            raise ValueError(
                f"{file} is not of this version ({error!r}): python -m experiments.paper {word}"
            ) from error
    return entries, found


def write(folder: Path) -> Path:
    """Write the page about all figures whose tables are in `folder`; return its path."""
    entries, found = read(folder)
    if not entries:
        raise ValueError(f"{folder} has no tables")
    every = [statement for entry in entries for statement in entry.statements]
    rows = [{"figure": entry.name, **asdict(statement)} for entry in entries for statement in entry.statements]
    columns = {column: np.array([row[column] for row in rows], object) for column in rows[0]}
    tables.write(folder / "statements.csv", columns)
    pages = Environment(loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined)
    text = pages.get_template("page.html.jinja").render(
        entries=entries,
        counts=Counter(statement.verdict for statement in every),
        total=len(every),
        fitted=[statement for statement in every if statement.fitted],
        verdicts=Verdict,
        contradictions=contradictions(found),
        missing=[heading(name) if name.startswith("figure") else name for name in NAMES if name not in found],
        circumstances=circumstances("impact-gym", "numpy", "scipy", "matplotlib"),
    )
    with whole_file(folder / "index.html") as file:
        file.write(text.encode())
    return folder / "index.html"
