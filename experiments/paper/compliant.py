"""Fig. 13 and 14: the tool fixed to a compliant robot; what their tables hold, how they look, and what is read off."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import impact_gym as ig
from experiments.lab.charts import FLANGE, OBJECT, TOOL
from experiments.paper.scenes import DURATION, MOTION
from experiments.paper.tables import Table, contact_of, stack, trace_of, where


def simulate(scenes: Mapping[str, ig.Scene]) -> Table:
    """Return the traces of the scenes, with the velocity at which each strikes as one more column."""
    outcomes = {case: ig.simulate(scene, MOTION, DURATION, trace=True) for case, scene in scenes.items()}
    table = stack(outcomes)
    velocity = {case: o.contacts[0].approach_velocity if o.contacts else np.nan for case, o in outcomes.items()}
    table["impact_velocity"] = np.array([velocity[case] for case in table["case"].tolist()])
    return table


def draw(table: Table, titles: Mapping[str, str]) -> Figure:
    """Draw velocities against time, a panel per case."""
    figure = Figure(figsize=(5.2 * len(titles), 4.0))
    grid: Any = figure.subplots(1, len(titles), sharex=True, sharey=True)
    for axes, (case, title) in zip(grid, titles.items(), strict=True):
        trace = trace_of(table, case)
        axes.plot(trace.time, trace.command_velocity, color=FLANGE, linestyle=(0, (4, 2)), label="imposed")
        axes.plot(trace.time, trace.tool_velocity, color=TOOL, label="tool")
        axes.plot(trace.time, trace.object_velocity, color=OBJECT, label="object")
        axes.set(title=title, xlabel="time (s)", ylabel="velocity (m/s)", xlim=(0.0, 0.6))
        axes.legend(loc="upper left")
    return figure


def impact_velocity(table: Table, case: str) -> float:
    """Return the approach velocity of the first contact, m/s."""
    return float(where(table, case=case)["impact_velocity"][0])


def nearest_minimum(table: Table, case: str, unhindered: str) -> tuple[float, float]:
    """Return by how much the impact of `case` follows the local minimum of the tool's velocity nearest to it.

    In s, negative if the minimum would have come later, and that minimum in m/s, both from `unhindered`: the same
    approach with nothing in the way.
    """
    impact = float(trace_of(table, case).time[contact_of(table, case) > 0][0])
    trace = trace_of(table, unhindered)
    velocity = trace.tool_velocity
    minima = np.flatnonzero((velocity[1:-1] < velocity[:-2]) & (velocity[1:-1] <= velocity[2:])) + 1
    nearest = minima[np.argmin(np.abs(trace.time[minima] - impact))]
    return impact - float(trace.time[nearest]), float(velocity[nearest])


def slowest_during_contact(table: Table, case: str) -> float:
    """Return the least velocity of the tool during the first contact, m/s."""
    return float(trace_of(table, case).tool_velocity[contact_of(table, case) == 1].min())


def deflection(table: Table, case: str) -> float:
    """Return by how much the robot gives way to the contact: largest x_r - x_t less its value at the impact, m."""
    trace, touching = trace_of(table, case), contact_of(table, case) == 1
    behind = (trace.command_position - trace.tool_position)[touching]
    return float(behind.max() - behind[0])


def vibration(table: Table, case: str) -> tuple[float, float]:
    """Return the range of x_t' - x_r' at constant imposed velocity before, and in the 16 ms after the contact, m/s."""
    trace, contact = trace_of(table, case), contact_of(table, case)
    relative = trace.tool_velocity - trace.command_velocity
    start, end = trace.time[contact == 1][[0, -1]]
    before = (trace.time > start - 0.05) & (trace.time < start)
    after = (trace.time > end) & (trace.time < end + 0.05)
    return float(np.ptp(relative[before])), float(np.ptp(relative[after]))
