"""Layouts that figures share: panels beside each other."""

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from experiments.lab.charts import COUPLING, FLANGE, FORCE, OBJECT, SERIES, TOOL, velocities
from experiments.lab.study import Rows
from experiments.studies.paper.runs import Numbers, Run

SCALE = 0.8  # of all figures: so small that letters can be read where two stand beside each other
Panels = Any
"""Axes of matplotlib: one, or an array of them, which its types do not tell apart."""


class Reproduction(NamedTuple):
    """A figure of the paper made anew."""

    measure: Callable[[], Rows]  # computes its table
    plot: Callable[[pl.DataFrame], Figure]
    numbers: Callable[[pl.DataFrame], Numbers]  # that statements about it name


def panels(
    width: float, height: float, columns: int = 1, rows: int = 1, **sharing: Any  # of `Figure.subplots`
) -> Callable[[Callable[..., None]], Callable[..., Figure]]:  # fmt: skip
    """Decorate a function that draws a frame on axes: makes these in a figure (inches times SCALE), and returns it."""

    def decorate(draw: Callable[..., None]) -> Callable[..., Figure]:
        @wraps(draw)
        def plot(frame: pl.DataFrame, **options: Any) -> Figure:
            figure = Figure(figsize=(SCALE * width, SCALE * height))
            draw(frame, figure.subplots(rows, columns, **sharing), **options)
            return figure

        return plot

    return decorate


def mark(axes: Panels, x: Any, y: Any, colour: str = "none", marker: str = "o", label: str | None = None) -> None:
    """Mark points of a curve; with no points and no colour, as an entry of the legend."""
    axes.plot(x, y, marker, color=colour, markeredgecolor="black", label=label)


@panels(10.4, 6.4, columns=2, rows=2, sharex=True, sharey="row")
def velocities_and_forces(
    frame: pl.DataFrame, grid: Panels, titles: Mapping[str, str], window: tuple[float, float]
) -> None:
    """Draw two cases of `frame` over `window` (s): the layout of Fig. 17, 19 and 23."""
    for (upper, lower), (case, title) in zip(grid.T, titles.items(), strict=True):
        trace = Run(frame, case).trace
        velocities(upper, trace)
        upper.set(title=title, xlabel="", xlim=window)
        lower.plot(trace.time, trace.contact_force, color=FORCE, label="contact force on the object")
        lower.plot(trace.time, trace.coupling_force, color=COUPLING, label="force of the coupling on the tool")
        lower.set(xlabel="time (s)", ylabel="force (N)")
    lower.figure.legend(loc="outside lower center", ncols=2, handles=lower.get_lines()[:2])


@panels(10.4, 4.0, columns=2, sharex=True, sharey=True)
def imposed_and_actual(frame: pl.DataFrame, grid: Panels, titles: Mapping[str, str]) -> None:
    """Draw velocities of two cases against time where the robot is compliant: the layout of Fig. 13 and 14."""
    for axes, (case, title) in zip(grid, titles.items(), strict=True):
        trace = Run(frame, case).trace
        axes.plot(trace.time, trace.command_velocity, color=FLANGE, linestyle=(0, (4, 2)), label="imposed")
        axes.plot(trace.time, trace.tool_velocity, color=TOOL, label="tool")
        axes.plot(trace.time, trace.object_velocity, color=OBJECT, label="object")
        axes.set(title=title, xlabel="time (s)", ylabel="velocity (m/s)", xlim=(0.0, 0.6))
        axes.legend(loc="upper left")


@panels(7.0, 4.4)
def impulses(frame: pl.DataFrame, axes: Panels, titles: Mapping[str, str]) -> None:
    """Draw what the coupling has given the tool since the contact began: the layout of Fig. 20 and 24."""
    for colour, (case, title) in zip(SERIES, titles.items(), strict=False):
        run = Run(frame, case)
        time, impulse = run.running_impulse()
        axes.plot(time, impulse, color=colour, label=f"{title}: {impulse[-1]:.4f} N s")
        mark(axes, time[-1], impulse[-1], colour)
        last = np.flatnonzero(run.during_contact.contact_force)[-1]
        axes.plot(time[last], impulse[last], "D", color=colour, markersize=5)
    mark(axes, [], [], label="end of the contact")
    axes.plot([], [], "D", color="black", markersize=5, label="contact force has fallen to zero")
    axes.set(xlabel="time since the contact began (s)", ylabel="impulse of the coupling (N s)")
    axes.legend()
