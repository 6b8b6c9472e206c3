"""Functions that several figures of the study `paper` use."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise, product
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

import impact_gym as ig
from experiments.lab.charts import SERIES
from experiments.lab.scenes import DURATION, MOTION, OBJECT_MASS, THRESHOLD, TOOL_MASS, simulate_with_trace
from experiments.lab.study import Row
from impact_gym.physics import impact

Array = NDArray[np.float64]
Numbers = dict[str, Any]  # numbers, arrays or words, by the names that statements.toml uses
WIDTH = 1e-6  # `enclose_changes` adds two rows around a change; their parameters differ by at most this


def where(frame: pl.DataFrame, **values: float | str) -> dict[str, NDArray[Any]]:
    """Return the columns, by name, of the rows that have these `values`."""
    return {column.name: column.to_numpy() for column in (frame.filter(**values) if values else frame)}


def enclose_changes(values: Iterable[float], row: Callable[[float], Row], parameter: str, *counts: str) -> list[Row]:
    """Return `row(value)` for rising `values`; add two rows, at most WIDTH apart, around each change of a count."""
    rows = [row(value) for value in values]
    enclosing: list[Row] = []
    for count, (low, high) in product(counts, pairwise(rows)):
        if low[count] != high[count]:
            while high[parameter] - low[parameter] > WIDTH:
                middle = row(0.5 * (low[parameter] + high[parameter]))
                low, high = (middle, high) if middle[count] == low[count] else (low, middle)
            enclosing += [low, high]
    by_value = {entry[parameter]: entry for entry in [*rows, *enclosing]}
    return [by_value[value] for value in sorted(by_value)]


def changes(rows: dict[str, NDArray[Any]], parameter: str, count: str) -> list[tuple[float, int, int]]:
    """Return (parameter before, count before, count after) for each change of the column `count`."""
    places, counts = np.flatnonzero(np.diff(rows[count])), rows[count].astype(int).tolist()
    return [(float(rows[parameter][i]), counts[i], counts[i + 1]) for i in places]


def histories(cases: Mapping[str, ig.Scene], motion: ig.Trapezoid = MOTION, duration: float = DURATION) -> pl.DataFrame:
    """Simulate scenes for `duration` (s); return a table of traces with `case`, `contact` and `impulse`, see `Run`."""
    parts = []
    for case, scene in cases.items():
        outcome, trace = simulate_with_trace(scene, motion, duration)
        number = np.zeros_like(trace.time)
        for count, contact in enumerate(outcome.contacts, start=1):
            end = np.inf if contact.end is None else contact.end
            number[(trace.time >= contact.start) & (trace.time <= end)] = count
        constants = {"case": case, "impulse": outcome.coupling_impulse}
        parts.append(pl.DataFrame({**trace._asdict(), "contact": number, **constants}))
    return pl.concat(parts)


class Run:
    """One case in a table of `histories`: the trace of the case, and numbers that describe the case."""

    def __init__(self, frame: pl.DataFrame, case: str) -> None:
        rows = where(frame, case=case)
        self.trace = ig.Trace(*(rows[name] for name in ig.Trace._fields))
        self.contact = rows["contact"]  # number of the current contact, 0 in flight
        self.contacts = int(self.contact.max())
        self.first_contact = first = self.part(self.contact == 1)
        self.during_contact = during = self.part(self.contact > 0)
        self.felt_contact = self.part((self.contact == 1) & (self.trace.contact_force > THRESHOLD))
        self.impulse = rows["impulse"][-1]  # N s, impulse of the coupling (eq. 21)
        self.final_velocity = self.trace.object_velocity[-1]  # m/s, V_p
        self.peak_force = self.trace.contact_force.max()  # N
        self.impact_velocity = first.tool_velocity[0]  # m/s, velocity of the tool at the first touch
        self.duration = 1e3 * np.ptp(first.time)  # ms, duration of the first contact
        self.deceleration = (during.contact_force - during.coupling_force).max() / TOOL_MASS  # m/s^2; paper, eq. 17
        rate = first.tool_velocity - first.object_velocity
        self.restitution = -rate[-1] / rate[0]  # of the first contact
        behind = first.command_position - first.tool_position
        self.deflection = 1e3 * (behind.max() - behind[0])  # mm, how far the contact pushes the tool behind the command
        self.way = 1e3 * np.ptp(first.command_position)  # mm, length of the commanded motion during the first contact

    def part(self, rows: NDArray[np.bool_]) -> ig.Trace:
        """Return the points of the trace at which `rows` is true."""
        return ig.Trace(*(column[rows] for column in self.trace))

    def running_impulse(self) -> tuple[Array, Array]:
        """Return times (s) after the first touch, and the coupling's impulse (N s) in contacts so far (eq. 21)."""
        time, force, contact = self.trace.time, self.trace.coupling_force, self.contact
        within = (contact[1:] > 0) & (contact[1:] == contact[:-1])
        pieces = np.where(within, 0.5 * (force[1:] + force[:-1]) * np.diff(time), 0.0)
        begin, end = np.flatnonzero(contact > 0)[[0, -1]]
        total = np.concatenate([[0.0], np.cumsum(pieces)])[begin : end + 1]
        return time[begin : end + 1] - time[begin], total

    def equation_22(self, restitution: float, impulse: float) -> float:
        """Return V_p (m/s) by eq. 22, from a restitution and an impulse of the coupling (N s)."""
        at_rest = float(self.first_contact.object_velocity[0])
        return float(impact.free_tool(TOOL_MASS, OBJECT_MASS, self.impact_velocity, at_rest, restitution, impulse)[1])


def runs_of(frame: pl.DataFrame) -> tuple[Run, Run]:
    """Return the runs of the cases "a" and "b"."""
    return Run(frame, "a"), Run(frame, "b")


def impulses(frame: pl.DataFrame, axes: Any, cases: Sequence[str]) -> None:
    """Draw the impulse of the coupling over time, as in Fig. 20 and 24."""
    for colour, run, case in zip(SERIES, runs_of(frame), cases, strict=False):
        time, impulse = run.running_impulse()
        axes.plot(time, impulse, color=colour, label=f"{case}: {impulse[-1]:.4f} N s")
        axes.plot(time[-1], impulse[-1], "o", color=colour)
    axes.plot([], [], "o", color="black", label="end of the contact")
