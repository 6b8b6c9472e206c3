"""Fig. 5: contact force and its two parts, tool fixed to the robot (a) and free (b); k_c = 1e5, e = 0.5, no brake."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

import impact_gym as ig
from experiments.charts import FORCE, OBJECT, TOOL
from experiments.paper.scenes import MOTION, OBJECT_MASS, TOOL_MASS, rigid
from experiments.paper.tables import Table, histories, trace_of

STIFFNESS, RESTITUTION = 1e5, 0.5
CASES = {"a": "(a) tool fixed to the robot", "b": "(b) tool decoupled from the robot"}


def compute() -> Table:
    """Simulate both limit cases.

    Two free masses meet as an imposed tool meets one object of their reduced mass: same penetration, same force.
    """
    reduced = TOOL_MASS * OBJECT_MASS / (TOOL_MASS + OBJECT_MASS)
    scenes = {"a": rigid(STIFFNESS, RESTITUTION), "b": rigid(STIFFNESS, RESTITUTION, object_mass=reduced)}
    return histories(scenes, ig.Trapezoid(MOTION.speed, MOTION.acceleration), duration=0.5)


def plot(table: Table) -> Figure:
    """Draw force against time."""
    figure = Figure(figsize=(10.4, 3.8))
    grid: Any = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, (case, title) in zip(grid, CASES.items(), strict=True):
        trace = trace_of(table, case)
        penetration = np.maximum(trace.tool_position - trace.object_position, 0.0)
        elastic = np.where(trace.contact_force > 0.0, STIFFNESS * penetration**1.5, 0.0)
        axes.plot(trace.time, trace.contact_force, color=FORCE, label="contact force")
        axes.plot(trace.time, elastic, color=TOOL, linestyle="--", label="elastic part")
        axes.plot(trace.time, trace.contact_force - elastic, color=OBJECT, linestyle=":", label="damping part")
        axes.set(title=title, xlabel="time (s)", ylabel="force (N)", xlim=(0.31, 0.335))
        axes.legend()
    return figure
