"""Tables on disk to which rows are added: what is there already is not measured again."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import polars as pl

from impact_gym.files import whole_file

Row = dict[str, Any]
TEXT = ("scene", "description", "contender", "failure", "run", "coupling")


def table(path: Path) -> pl.DataFrame:
    """Return the table in a file, an empty one if there is no file; columns not in TEXT are numbers."""
    if not path.is_file():
        return pl.DataFrame()
    text = pl.read_csv(path, infer_schema=False).fill_null("")
    return text.with_columns(pl.exclude(TEXT).cast(pl.Float64))


def read(path: Path) -> list[Row]:
    """Return the rows of `table`."""
    return table(path).to_dicts()


def write(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write all rows, whole or not at all."""
    with whole_file(path) as file:
        pl.DataFrame(list(rows), infer_schema_length=None).write_csv(file)
