"""Tables between computing and drawing: columns of equal length by name, as CSV on disk."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import impact_gym as ig
from impact_gym.files import whole_file

Table = dict[str, NDArray[np.generic]]


def write(path: Path, table: Table) -> None:
    """Write `table` to `path`, whole or not at all."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(table)
    writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
    with whole_file(path) as file:
        file.write(text.getvalue().encode())


def read(path: Path) -> Table:
    """Read what `write` wrote."""
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


def stack(outcomes: Mapping[str, ig.Outcome]) -> Table:
    """Return the traces of several runs below each other, told apart by the column `case`.

    The column `contact` says which contact is going on, counted from 1, and is 0 in flight; `impulse` is eq. 21 as
    the simulation integrated it over all contacts, in N s, the same in every row of a case.
    """
    parts: list[Table] = []
    for case, outcome in outcomes.items():
        trace = outcome.trace
        if trace is None:
            raise ValueError(f"case {case!r} was simulated without a trace")
        part: Table = {"case": np.full(len(trace.time), case)}
        part |= trace._asdict()
        part["contact"] = np.zeros(len(trace.time))
        for number, contact in enumerate(outcome.contacts, start=1):
            end = np.inf if contact.end is None else contact.end
            part["contact"][(trace.time >= contact.start) & (trace.time <= end)] = number
        part["impulse"] = np.full(len(trace.time), outcome.coupling_impulse)
        parts.append(part)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def histories(scenes: Mapping[str, ig.Scene], motion: ig.Trapezoid, duration: float) -> Table:
    """Simulate several scenes under one motion and return their traces, as `stack` does."""
    return stack({case: ig.simulate(scene, motion, duration, trace=True) for case, scene in scenes.items()})


def trace_of(table: Table, case: str) -> ig.Trace:
    """Return the trace of one case of `stack`."""
    rows = where(table, case=case)
    return ig.Trace(*(rows[name] for name in ig.Trace._fields))


def contact_of(table: Table, case: str) -> NDArray[np.float64]:
    """Return, beside `trace_of`, the number of the contact going on (0 in flight)."""
    return where(table, case=case)["contact"].astype(float)
