"""Tables between computing and drawing: columns of equal length by name, as CSV on disk."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impact_gym as ig
from experiments.paper.scenes import DURATION, MOTION
from impact_gym.files import whole_file

Table = dict[str, NDArray[Any]]


def write(path: Path, table: Table) -> None:
    """Write `table` to `path`, whole or not at all."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(table)
    writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
    with whole_file(path) as file:
        file.write(text.getvalue().encode())


def read(path: Path) -> Table:
    """Read what `write` wrote; all but the column `case` are numbers."""
    with path.open(newline="") as file:
        header, *rows = csv.reader(file)
    columns = {name: np.array([row[place] for row in rows]) for place, name in enumerate(header)}
    return {name: column if name == "case" else column.astype(float) for name, column in columns.items()}


def from_rows(names: tuple[str, ...], rows: list[tuple[float, ...]]) -> Table:
    """Return the table with these rows below `names`."""
    return dict(zip(names, np.array(rows, dtype=float).T, strict=True))


def where(table: Table, **values: float | str) -> Table:
    """Return the rows in which each named column has the value given for it."""
    rows = np.logical_and.reduce([table[name] == value for name, value in values.items()])
    return {name: column[rows] for name, column in table.items()}


def histories(
    scenes: Mapping[str, ig.Scene],
    motion: ig.Trapezoid = MOTION,
    duration: float = DURATION,
    impact_velocity: bool = False,
) -> Table:
    """Simulate scenes for `duration` (s) and return their traces below each other, told apart by the column `case`.

    The column `contact` counts the contact going on from 1 and is 0 in flight. `impulse` is eq. 21 over all contacts in
    N s, and `impact_velocity`, if asked for, that at which the tool strikes first in m/s: the same in all rows of a
    case.
    """
    cases = []
    for case, scene in scenes.items():
        outcome = ig.simulate(scene, motion, duration, trace=True)
        time = outcome.trace.time
        contact = np.zeros_like(time)
        for number, one in enumerate(outcome.contacts, start=1):
            contact[(time >= one.start) & (time <= (np.inf if one.end is None else one.end))] = number
        part = {"case": np.full(time.shape, case), **outcome.trace._asdict(), "contact": contact}
        part["impulse"] = np.full_like(time, outcome.coupling_impulse)
        if impact_velocity:
            struck = outcome.contacts[0].approach_velocity if outcome.contacts else np.nan
            part["impact_velocity"] = np.full_like(time, struck)
        cases.append(part)
    return {name: np.concatenate([part[name] for part in cases]) for name in cases[0]}
