"""What pages are made of: sections of paragraphs, tables, heat maps and pictures."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import polars as pl
from matplotlib.figure import Figure

from experiments.lab.statistics import Estimate

LONG = 80  # characters of a cell that holds a sentence


@dataclass(frozen=True)
class Table:
    """Rows of words; the first column names the row."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    @classmethod
    def of(cls, caption: str, frame: pl.DataFrame | Iterable[Mapping[str, Any]], columns: Mapping[str, str]) -> "Table":
        """Return the table of a frame, or of rows by name: under each head a format string of a row's columns."""
        rows = frame.to_dicts() if isinstance(frame, pl.DataFrame) else frame
        body = [[form.format(**row) for form in columns.values()] for row in rows]
        return cls(caption, tuple(columns), body)

    @property
    def words(self) -> list[bool]:
        """Whether each column holds words: most of its cells are no number, nor an interval of numbers."""
        columns = zip(*self.rows, strict=False)
        return [2 * sum(bool(re.match(r"([-+\d]|at (least|most) \d).{,40}$", cell)) for cell in column) < len(self.rows)
                for column in columns]  # fmt: skip

    @property
    def long(self) -> list[bool]:
        """Whether each column has sentences, which are not to be squeezed on a small screen."""
        return [max(map(len, column)) > LONG for column in zip(*self.rows, strict=False)]


class Heat(NamedTuple):
    """A cell of a heat map."""

    value: str
    note: str  # under it
    ratio: float  # to what the heat map compares with; below 1 better


@dataclass(frozen=True)
class HeatMap:
    """Rows of cells, the warmer the worse they compare."""

    caption: str
    head: Sequence[str]
    rows: Sequence[tuple[str, str, Sequence[Heat]]]  # what is changed, over which values, a cell for each contestant


@dataclass(frozen=True)
class Picture:
    """A figure of matplotlib, which is also written to disk as NAME.svg."""

    name: str
    figure: Figure
    alternative: str  # what it shows, for a reader who cannot see it
    caption: str = ""
    heading: str = ""
    wide: bool = True  # stands alone in its row


@dataclass(frozen=True)
class Section:
    """A part of a page under a heading; what it holds is a paragraph (str), a table, a heat map or a picture."""

    heading: str
    parts: Sequence[Any]
    folded: bool = False
    key: str = ""  # of a link to it


def percent(share: Estimate, digits: int = 1) -> str:
    """Return a share with its interval in percent."""
    value, low, high = (f"{100 * each:.{digits}f}" for each in (share.value, share.low, share.high))
    return f"{value} % [{low}, {high}]"
