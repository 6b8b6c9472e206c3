"""The layout of Fig. 20 and 24: what the coupling has given the tool since the contact began, a curve per case."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from experiments.lab.charts import SERIES
from experiments.paper import time_history as history
from experiments.paper.scenes import OBJECT_MASS, TOOL_MASS
from experiments.paper.tables import Table, contact_of, trace_of, where
from impact_gym.physics import impact


def draw(table: Table, titles: Mapping[str, str]) -> Figure:
    """Draw the running impulse of the cases named in `titles`."""
    figure = Figure(figsize=(7.0, 4.4))
    axes = figure.subplots()
    for colour, (case, title) in zip(SERIES, titles.items(), strict=False):
        time, impulse = history.running_impulse(table, case)
        axes.plot(time, impulse, color=colour, label=f"{title}: {impulse[-1]:.4f} N s")
        axes.plot(time[-1], impulse[-1], "o", color=colour, markeredgecolor="black")
        last = np.flatnonzero(history.during_contact(table, case, "contact_force"))[-1]
        axes.plot(time[last], impulse[last], "D", color=colour, markersize=5)
    axes.plot([], [], "o", color="none", markeredgecolor="black", label="end of the contact")
    axes.plot([], [], "D", color="black", markersize=5, label="contact force has fallen to zero")
    axes.set(xlabel="time since the contact began (s)", ylabel="impulse of the coupling (N s)")
    axes.legend()
    return figure


def final_impulse(table: Table, case: str) -> float:
    """Return eq. 21 as the simulation integrated it, N s."""
    return float(where(table, case=case)["impulse"][-1])


def quadrature_error(table: Table, case: str) -> float:
    """Return how far the last value of the running impulse is off that, relative to it."""
    return abs(float(history.running_impulse(table, case)[1][-1]) / final_impulse(table, case) - 1.0)


def equation_22(table: Table, case: str, restitution: float | None = None) -> float:
    """Return V_p after eq. 22 with the simulated impulse, m/s; None: with the restitution that the contact had."""
    if history.contacts(table, case) != 1:
        raise ValueError(f"case {case!r}: eq. 22 is about one contact")
    v_t, v_p = (float(history.during_contact(table, case, f"{name}_velocity")[0]) for name in ("tool", "object"))
    e = parting_over_approach(table, case) if restitution is None else restitution
    return float(impact.free_tool(TOOL_MASS, OBJECT_MASS, v_t, v_p, e, final_impulse(table, case))[1])


def parting_over_approach(table: Table, case: str) -> float:
    """Return the restitution that the first contact had: separation over approach velocity."""
    trace, first = trace_of(table, case), contact_of(table, case) == 1
    rate = (trace.tool_velocity - trace.object_velocity)[first]
    return float(-rate[-1] / rate[0])
