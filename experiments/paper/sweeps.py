"""A row of a table per value of one parameter, with the places enclosed at which something discrete changes."""

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

Row = tuple[float, ...]


def enclosed(
    values: Iterable[float], row: Callable[[float], Row], at: int, marks: Sequence[int], width: float
) -> list[Row]:
    """Return the rows at `values`, and the pairs of rows that enclose each change of a mark.

    Args:
        values: the parameter, rising.
        row: computes a row; its entry `at` is the parameter.
        at: place of the parameter in a row.
        marks: places of the discrete entries to watch; between two values one change is found.
        width: distance to which the two rows of a pair close in, in units of the parameter.
    """
    rows = [row(value) for value in values]
    found: list[Row] = []
    for mark in marks:
        for low, high in pairwise(rows):
            if low[mark] == high[mark]:
                continue
            while high[at] - low[at] > width:
                middle = row(0.5 * (low[at] + high[at]))
                low, high = (middle, high) if middle[mark] == low[mark] else (low, middle)
            found += [low, high]
    return sorted({*rows, *found}, key=lambda entry: entry[at])
