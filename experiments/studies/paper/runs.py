"""Functions that several figures of the study `paper` use."""

from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise, product
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure as Sheet
from numpy.typing import NDArray

import impact_gym as ig
from experiments.lab.charts import SERIES
from experiments.lab.parts import Picture
from experiments.lab.scenes import DURATION, MOTION, OBJECT_MASS, TOOL_MASS
from experiments.lab.study import Row
from experiments.studies.paper.models import Model
from impact_gym.physics import impact
from impact_gym.render.palette import FLANGE, FORCE, OBJECT, PERSON, TOOL

Array = NDArray[np.float64]
WIDTH = 1e-6  # `enclose_changes` adds two rows around a change; their parameters differ by at most this
SCALE = 0.8  # factor on the size of all figures, so that the text is legible in two figures side by side
WIDE = 11.0  # inches, before the factor SCALE; a wider figure is alone in its row of the page


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


def histories(
    model: Model, cases: Mapping[str, ig.Scene], motion: ig.Trapezoid = MOTION, duration: float = DURATION
) -> pl.DataFrame:
    """Simulate scenes for `duration` (s); return a table of traces with `case`, `contact` and `impulse`, see `Run`."""
    parts = []
    for case, scene in cases.items():
        outcome, trace = model.trace(scene, motion, duration)
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

    def equation_22(self, restitution: float) -> float:
        """Return V_p (m/s) by eq. 22, from a restitution and the simulated impulse of the coupling."""
        at_rest = float(self.first_contact.object_velocity[0])
        masses = TOOL_MASS, OBJECT_MASS
        return float(impact.free_tool(*masses, self.impact_velocity, at_rest, restitution, self.impulse)[1])


def runs_of(frame: pl.DataFrame) -> tuple[Run, Run]:
    """Return the runs of the cases "a" and "b"."""
    return Run(frame, "a"), Run(frame, "b")


def panels(width: float, height: float, **grid: Any) -> tuple[Sheet, Any]:
    """Return a figure of `width` by `height` inches, before the factor SCALE, and its panels in a flat array."""
    sheet = Sheet(figsize=(SCALE * width, SCALE * height))
    return sheet, np.ravel(sheet.subplots(**grid))


def picture(name: str, sheet: Sheet, heading: str, caption: str, alternative: str) -> Picture:
    """Return a figure as a part of the page."""
    return Picture(name, sheet, alternative, caption, heading, wide=sheet.get_figwidth() > SCALE * WIDE)


def of_stiffness(k_c: float) -> str:
    """Return the label of a contact stiffness that is a power of ten (N/m^1.5)."""
    return f"k_c = 1e{np.log10(k_c):.0f} N/m^1.5"


def velocities(axes: Any, run: Run, title: str, until: tuple[float, float], robot: str = "flange") -> None:
    """Draw the velocities of robot, tool and object over time; `robot`: the flange, or its "command"."""
    trace = run.trace
    label = "imposed" if robot == "command" else robot
    axes.plot(trace.time, getattr(trace, f"{robot}_velocity"), "--", color=FLANGE, label=label)
    axes.plot(trace.time, trace.tool_velocity, color=TOOL, label="tool")
    axes.plot(trace.time, trace.object_velocity, color=OBJECT, label="object")
    axes.set(title=title, xlabel="time (s)", ylabel="velocity (m/s)", xlim=until)
    axes.legend(loc="center right" if until[0] else "upper left")


def forces(axes: Any, run: Run) -> None:
    """Draw contact force and coupling force over time."""
    axes.plot(run.trace.time, run.trace.contact_force, color=FORCE, label="contact force on the object")
    axes.plot(run.trace.time, run.trace.coupling_force, color=PERSON, label="force of the coupling on the tool")
    axes.set(xlabel="time (s)", ylabel="force (N)")
    axes.legend(fontsize=8)


def velocities_and_forces(
    frame: pl.DataFrame, titles: tuple[str, str], until: tuple[float, float]
) -> tuple[Sheet, Any]:
    """Draw the velocities of the cases "a" and "b", with the forces below."""
    sheet, axes = panels(10.4, 6.4, ncols=2, nrows=2, sharex=True, sharey="row")
    for upper, lower, run, title in zip(axes[:2], axes[2:], runs_of(frame), titles, strict=True):
        velocities(upper, run, title, until)
        forces(lower, run)
    return sheet, axes


def impulses(frame: pl.DataFrame, titles: tuple[str, str]) -> Sheet:
    """Draw the impulse of the coupling over time in the cases "a" and "b", as in Fig. 20 and 24."""
    sheet, (axes,) = panels(7.0, 4.4)
    for colour, run, title in zip(SERIES, runs_of(frame), titles, strict=False):
        time, impulse = run.running_impulse()
        axes.plot(time, impulse, color=colour, label=f"{title}: {impulse[-1]:.4f} N s")
        axes.plot(time[-1], impulse[-1], "o", color=colour)
    axes.plot([], [], "o", color="black", label="end of the contact")
    axes.set(xlabel="time since the contact began (s)", ylabel="impulse of the coupling (N s)")
    axes.legend()
    return sheet
