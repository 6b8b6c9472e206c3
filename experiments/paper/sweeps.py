"""A row of a table per value of one parameter, with the places enclosed at which something discrete changes."""

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import numpy as np

from experiments.paper.tables import Table

Row = tuple[float, ...]
WIDTH = 1e-6  # to which the two rows of a pair close in, in units of the parameter


def enclosed(
    values: Iterable[float], row: Callable[[float], Row], names: Sequence[str], parameter: str, *marks: str
) -> list[Row]:
    """Return the rows at rising `values` of the parameter, and the pairs within WIDTH that enclose a change of a mark.

    `row` computes a row, whose entries have `names`. One of them is the `parameter`; `marks` are the discrete ones to
    watch, of which between two values one change is found.
    """
    at = names.index(parameter)
    rows = [row(value) for value in values]
    found: list[Row] = []
    for mark in map(names.index, marks):
        for low, high in pairwise(rows):
            if low[mark] == high[mark]:
                continue
            while high[at] - low[at] > WIDTH:
                middle = row(0.5 * (low[at] + high[at]))
                low, high = (middle, high) if middle[mark] == low[mark] else (low, middle)
            found += [low, high]
    return sorted({*rows, *found}, key=lambda entry: entry[at])


def changes(rows: Table, parameter: str, mark: str) -> list[tuple[float, int, int]]:
    """Return where the column `mark` changes: the parameter below it, and the mark below and above it."""
    places, marks = np.flatnonzero(np.diff(rows[mark])), rows[mark].astype(int).tolist()
    return [(float(rows[parameter][i]), marks[i], marks[i + 1]) for i in places]
