"""Tables between computing and drawing: columns of equal length by name, as CSV on disk."""

import csv
import io
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import impact_gym as ig
from agents.files import whole_file

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


def histories(scenes: Mapping[str, ig.Scene], motion: ig.Trapezoid, duration: float) -> Table:
    """Return the traces of several scenes below each other, told apart by the column `case`."""
    traces = {case: ig.simulate(scene, motion, duration, trace=True).trace for case, scene in scenes.items()}
    table: Table = {"case": np.concatenate([np.full(len(trace.time), case) for case, trace in traces.items() if trace])}
    for field in fields(ig.Trace):
        table[field.name] = np.concatenate([getattr(trace, field.name) for trace in traces.values()])
    return table


def trace_of(table: Table, case: str) -> ig.Trace:
    """Return the trace of one case of `histories`."""
    rows = table["case"] == case
    return ig.Trace(*(table[field.name][rows] for field in fields(ig.Trace)))
