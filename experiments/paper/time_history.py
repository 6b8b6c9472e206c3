"""The layout of Fig. 17, 19, 23 and 25, velocities above, forces below, a column per case; and what is read off it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from experiments.lab.charts import COUPLING, FORCE, velocities
from experiments.paper.tables import Table, contact_of, trace_of


def draw(table: Table, titles: Mapping[str, str], window: tuple[float, float]) -> Figure:
    """Draw the cases of `table` named in `titles` over `window` (s)."""
    figure = Figure(figsize=(5.2 * len(titles), 6.4))
    grid: Any = figure.subplots(2, len(titles), sharex=True, sharey="row", squeeze=False)
    for column, (case, title) in enumerate(titles.items()):
        trace = trace_of(table, case)
        velocities(grid[0, column], trace)
        grid[0, column].set(title=title, xlabel="", xlim=window)
        axes = grid[1, column]
        axes.plot(trace.time, trace.contact_force, color=FORCE, label="contact force on the object")
        axes.plot(trace.time, trace.coupling_force, color=COUPLING, label="force of the coupling on the tool")
        axes.set(xlabel="time (s)", ylabel="force (N)")
        axes.legend()
    return figure


def final_velocity(table: Table, case: str) -> float:
    """Return V_p, m/s."""
    return float(trace_of(table, case).object_velocity[-1])


def contacts(table: Table, case: str) -> int:
    """Return the number of contacts."""
    return int(contact_of(table, case).max())


def during_contact(table: Table, case: str, name: str) -> NDArray[np.float64]:
    """Return a column of the trace while tool and object touch."""
    values: NDArray[np.float64] = getattr(trace_of(table, case), name)[contact_of(table, case) > 0]
    return values


def before_contact(table: Table, case: str, name: str) -> NDArray[np.float64]:
    """Return a column of the trace before tool and object touch first."""
    first = int(np.argmax(contact_of(table, case) > 0))
    values: NDArray[np.float64] = getattr(trace_of(table, case), name)[:first]
    return values


def duration_of_contact(table: Table, case: str) -> float:
    """Return how long the first contact lasts, s."""
    return float(np.ptp(trace_of(table, case).time[contact_of(table, case) == 1]))


def deceleration(table: Table, case: str, tool_mass: float) -> float:
    """Return the largest deceleration of the tool during contact, m/s^2 (paper, eq. 17)."""
    force = during_contact(table, case, "contact_force") - during_contact(table, case, "coupling_force")
    return float(force.max()) / tool_mass


def force_peaks(table: Table, case: str) -> int:
    """Count the peaks of the contact force that are higher than a tenth of the highest."""
    force = trace_of(table, case).contact_force
    inner = force[1:-1]
    return int(np.sum((inner > force[:-2]) & (inner >= force[2:]) & (inner > 0.1 * force.max())))


def running_impulse(table: Table, case: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return time since the first contact began (s) and the impulse of the coupling until then (N s; eq. 21).

    By the trapezoidal rule over the trace, contacts only: between two of them the impulse stays where it is.
    """
    trace, contact = trace_of(table, case), contact_of(table, case)
    touching = contact > 0
    both = touching[1:] & touching[:-1] & (contact[1:] == contact[:-1])
    pieces = np.where(both, 0.5 * (trace.coupling_force[1:] + trace.coupling_force[:-1]) * np.diff(trace.time), 0.0)
    begin, end = np.flatnonzero(touching)[[0, -1]]
    total = np.concatenate([[0.0], np.cumsum(pieces)])[begin : end + 1]
    return trace.time[begin : end + 1] - trace.time[begin], total
