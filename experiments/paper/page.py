"""The page about the paper's figures, made from the tables on disk: reports/paper/index.html."""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import polars as pl

from agents.provenance import circumstances
from experiments.lab import page
from experiments.paper import NAMES, heading, load, tables
from experiments.paper.statements import Basis, Verdict
from impact_gym.files import write_file

WIDE = 650.0  # points; a wider figure stands alone in its row


def read(folder: Path) -> list[dict[str, Any]]:
    """Return the entries of the page: each figure that is in `folder`, judged afresh.

    Raises:
        ValueError: a table is not as this version writes it; names it.
    """
    entries = []
    for name in NAMES:
        file, picture, module = folder / f"{name}.csv", folder / f"{name}.svg", load(name)
        if not (file.is_file() and picture.is_file()):
            continue
        try:
            table = tables.read(file)
            statements = tuple(module.statements(table))
        except (KeyError, IndexError, ValueError) as error:
            command = f"impact-gym paper {name.removeprefix('figure_')}"
            raise ValueError(f"{file} is not of this version ({error!r}): {command}") from error
        width = re.search(r'width="([\d.]+)pt"', picture.read_text())
        wide = width is not None and float(width[1]) > WIDE
        about = {"name": name, "heading": heading(name), "module": module, "table": table}
        entries.append({**about, "statements": statements, "wide": wide})
    return entries


def write(folder: Path, run: Mapping[str, Any]) -> Path:
    """Write the page about all figures whose tables are in `folder`; return its path.

    Args:
        folder: of tables and figures.
        run: command and seconds of what made the figures.
    """
    entries = read(folder)
    if not entries:
        raise ValueError(f"{folder} has no tables")
    rows = [{"figure": entry["name"], **asdict(statement)} for entry in entries for statement in entry["statements"]]
    write_file(folder / "statements.csv", pl.DataFrame(rows, infer_schema_length=None).write_csv())
    present = {entry["name"] for entry in entries}
    return page.write(
        folder,
        "paper",
        entries=entries,
        total=len(rows),
        bases=Counter(row["basis"] for row in rows),
        counts=Counter(row["verdict"] for row in rows),
        tested=Counter(row["verdict"] for row in rows if row["basis"] == Basis.TEST),
        verdicts=Verdict,
        basis=Basis,
        missing=[heading(name) if name.startswith("figure") else name for name in NAMES if name not in present],
        runs=[{**run, **circumstances("impact-gym", "numpy", "scipy", "matplotlib")}],
    )
