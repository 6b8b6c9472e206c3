"""Drawing of figures: panels and texts from statements.toml, and layouts that several figures share."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from experiments.lab.charts import FORCE, PERSON, SERIES, velocities
from experiments.lab.parts import Picture
from experiments.studies.paper.runs import runs_of
from experiments.studies.paper.statements import DATA

SCALE = 0.8  # factor on the size of all figures, so that text is legible if two figures are side by side
WIDE = 11.0  # inches, before scaling; a wider figure is alone in its row of the page
Panels = Any
"""Axes of matplotlib, or an array of them."""


def picture(name: str, draw: Callable[..., None], frame: pl.DataFrame) -> Picture:
    """Return a figure drawn from its table, with texts and layout from statements.toml."""
    about = DATA["figures"][name]
    figure = Figure(figsize=tuple(SCALE * length for length in about["size"]))
    grid: Panels = figure.subplots(**about.get("panels", {}))
    draw(frame, grid, **about.get("arguments", {}))
    for axes, texts in zip(np.ravel(grid), about["axes"], strict=True):
        axes.set(**{name: value for name, value in texts.items() if name != "legend"})
        if "legend" in texts:
            axes.legend(**texts["legend"])
    heading = f"{about['heading']}: {about['title']}"
    return Picture(name, figure, about["alternative"], about["caption"], heading, about["size"][0] > WIDE)


def mark(axes: Panels, x: Any, y: Any, colour: str = "none", marker: str = "o", label: str | None = None) -> None:
    """Mark points of a curve; without points and colour, add an entry to the legend."""
    axes.plot(x, y, marker, color=colour, markeredgecolor="black", label=label)


def velocities_and_forces(frame: pl.DataFrame, grid: Panels) -> None:
    """Draw two cases of `frame`: the layout of Fig. 17, 19 and 23."""
    for (upper, lower), run in zip(grid.T, runs_of(frame), strict=True):
        velocities(upper, run.trace)
        lower.plot(run.trace.time, run.trace.contact_force, color=FORCE, label="contact force on the object")
        lower.plot(run.trace.time, run.trace.coupling_force, color=PERSON, label="force of the coupling on the tool")
    lower.figure.legend(loc="outside lower center", ncols=2, handles=lower.get_lines()[:2])


def imposed_and_actual(frame: pl.DataFrame, grid: Panels) -> None:
    """Draw the velocities of two cases with a compliant robot against time: the layout of Fig. 13 and 14."""
    for axes, run in zip(grid, runs_of(frame), strict=True):
        velocities(axes, run.trace._replace(flange_velocity=run.trace.command_velocity))
        axes.lines[0].set_label("imposed")


def impulses(frame: pl.DataFrame, axes: Panels, cases: Sequence[str]) -> None:
    """Draw the impulse of the coupling since the contact began: the layout of Fig. 20 and 24."""
    for colour, run, case in zip(SERIES, runs_of(frame), cases, strict=False):
        time, impulse = run.running_impulse()
        axes.plot(time, impulse, color=colour, label=f"{case}: {impulse[-1]:.4f} N s")
        mark(axes, time[-1], impulse[-1], colour)
        last = np.flatnonzero(run.during_contact.contact_force)[-1]
        axes.plot(time[last], impulse[last], "D", color=colour, markersize=5)
    mark(axes, [], [], label="end of the contact")
    axes.plot([], [], "D", color="black", markersize=5, label="contact force has fallen to zero")
