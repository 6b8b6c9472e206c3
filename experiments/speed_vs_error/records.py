"""Tables on disk to which rows are added: what is there already is not measured again."""

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from impact_gym.files import whole_file

Row = dict[str, Any]
TEXT = frozenset({"scene", "description", "contender", "failure", "run", "coupling"})


def read(path: Path) -> list[Row]:
    """Return the rows of a table; no rows if there is no file. Columns not in TEXT are numbers."""
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return [
            {name: value if name in TEXT else float(value) for name, value in row.items()}
            for row in csv.DictReader(file)
        ]


def write(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write all rows, whole or not at all; the first row names the columns."""
    rows = list(rows)
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    with whole_file(path) as file:
        file.write(text.getvalue().encode())
