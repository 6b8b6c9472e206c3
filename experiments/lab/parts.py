"""Parts of pages: sections of paragraphs, tables, pictures and terms; tabs."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import polars as pl
from markupsafe import Markup
from matplotlib.figure import Figure

from experiments.lab.statistics import Estimate

LONG = 80  # number of characters; a column with a longer cell stays wide on a small screen


@dataclass(frozen=True)
class Table:
    """A table of texts; the first column names the row."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    results: str = ""  # name of the file in docs/results that has this table; "": no page of the documentation shows it

    @classmethod
    def of(
        cls, caption: str, frame: pl.DataFrame | Iterable[Mapping[str, Any]], columns: Mapping[str, str],
        results: str = "",
    ) -> "Table":  # fmt: skip
        """Return a table of the rows in `frame`; `columns` maps each heading to a format string for a row."""
        rows = frame.to_dicts() if isinstance(frame, pl.DataFrame) else frame
        body = [[form.format(**row) for form in columns.values()] for row in rows]
        return cls(caption, tuple(columns), body, results)

    @classmethod
    def joined(cls, caption: str, rows: Sequence[Mapping[str, str]], results: str = "") -> "Table":
        """Return a table of rows that map headings to texts; a row without a heading has an empty cell."""
        head = [*dict.fromkeys(heading for row in rows for heading in row)]
        return cls(caption, head, [[row.get(heading, "") for heading in head] for row in rows], results)

    @cached_property  # a page asks for it in every cell
    def classes(self) -> list[str]:
        """CSS class by column: "" if half or more cells look like numbers, "left words" if any is long, else "left"."""
        found = []
        for column in zip(*self.rows, strict=False):
            numbers = sum(bool(re.match(r"([-+\d]|at (least|most) \d).{,40}$", cell)) for cell in column)
            long = max(map(len, column)) > LONG
            found.append("" if 2 * numbers >= len(self.rows) else "left words" if long else "left")
        return found


@dataclass(frozen=True)
class Picture:
    """A figure of matplotlib, saved as NAME.svg and embedded in the page."""

    name: str
    figure: Figure
    alternative: str  # text alternative
    caption: str = ""
    heading: str = ""
    wide: bool = True  # whether the picture is alone in its row


@dataclass(frozen=True)
class Section:
    """A heading, and below it paragraphs (str), tables, pictures, words with explanations (dict), further sections."""

    heading: str
    parts: Sequence[Any]
    folded: bool = False
    key: str = ""  # HTML id of the section, in a tab followed by "-" and the name of the tab


@dataclass(frozen=True)
class Tab:
    """A part of a page that is shown alone; the reader chooses it by its title."""

    name: str  # HTML id of the tab
    title: str
    headline: str
    warning: str  # why the tab is not for decisions; "": it is
    fails: tuple[str, str, str]  # a controller, where it fails in one line, and details
    chart: Picture
    films: Mapping[str, Markup]  # by label; the page shows the first, and the reader chooses another
    sections: Sequence[Section]
    numbers: Sequence[tuple[str, str]] = ()  # each with its words
    about: str = ""  # what the recommended controller does


def percent(share: Estimate) -> str:
    """Return a fraction and its interval as text, in percent."""
    return f"{100 * share.value:.1f} % [{100 * share.low:.1f}, {100 * share.high:.1f}]"


def tables_of(sections: Iterable[Section]) -> Iterator[Table]:
    """Yield the tables of sections and of the sections in them."""
    for section in sections:
        yield from (part for part in section.parts if isinstance(part, Table))
        yield from tables_of(part for part in section.parts if isinstance(part, Section))
