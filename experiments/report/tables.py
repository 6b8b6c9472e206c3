"""Tables of the page: rows of words, and heat maps."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from experiments.lab.statistics import Estimate


@dataclass(frozen=True)
class Table:
    """Rows of words; the first column names the row."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    @property
    def words(self) -> list[bool]:
        """Whether each column holds words: most of its cells begin with neither a digit nor a sign."""
        columns = zip(*self.rows, strict=False)
        return [2 * sum(bool(re.match(r"[-+\d]|at (least|most) \d", cell)) for cell in column) < len(self.rows)
                for column in columns]  # fmt: skip


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


def percent(share: Estimate) -> str:
    """Return a share with its interval in percent."""
    return f"{100 * share.value:.1f} % [{100 * share.low:.1f}, {100 * share.high:.1f}]"
