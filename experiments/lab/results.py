"""Results that pages of the documentation show: tables in CSV files, whose first lines say how they were made."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments.lab.parts import Table
from impact_gym.support.files import write_file

FOLDER = Path(__file__).parents[2] / "docs" / "results"
ABOUT = ("command", "date", "machine", "versions", "table")  # the first lines of a file, "# command: ...", in order


def write(folder: Path, name: str, table: Table, record: Mapping[str, Any]) -> Path:
    """Write `folder`/NAME.csv and return its path; `record` has the command and `provenance.machine_and_versions`."""
    versions = ", ".join(f"{package} {version}" for package, version in record["versions"].items())
    about = record["command"], record["date"][:10], record["machine"], versions, table.caption
    file = io.StringIO()
    file.writelines(f"# {key}: {' '.join(value.split())}\n" for key, value in zip(ABOUT, about, strict=True))
    csv.writer(file, lineterminator="\n").writerows([table.head, *table.rows])
    return write_file(folder / f"{name}.csv", file.getvalue())


def read(name: str, folder: Path = FOLDER) -> tuple[dict[str, str], Table]:
    """Return what the first lines of a file say, and its table; ValueError: it is missing, or of another version."""
    path = folder / f"{name}.csv"
    if not path.is_file():
        raise ValueError(f"there are no results {path}: make results writes them")
    lines = path.read_text().splitlines()
    about = dict(line.removeprefix("# ").split(": ", 1) for line in lines if line.startswith("# ") and ": " in line)
    head, *rows = csv.reader(lines[len(ABOUT) :]) if len(lines) > len(ABOUT) else [[]]
    if tuple(about) != ABOUT or any(len(row) != len(head) for row in rows):
        command = about.get("command", "make results")
        raise ValueError(f"{path} is damaged or of another version: write it again with {command}")
    return about, Table(about["table"], head, rows)


def cell(name: str, row: str, column: str, folder: Path = FOLDER) -> str:
    """Return the text in a row, named by its first cell, and a column of a table; ValueError: there is none."""
    about, table = read(name, folder)
    found = [each[table.head.index(column)] for each in table.rows if each[0] == row and column in table.head]
    if len(found) != 1:
        raise ValueError(f"{folder / name}.csv has no single number in row {row!r} and column {column!r}; "
                         f"{about['command']} writes this file")  # fmt: skip
    return found[0]
