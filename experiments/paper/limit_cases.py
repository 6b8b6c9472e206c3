"""Fig. 5 to 7: the two limit cases of the paper's Fig. 4 at 1 m/s and without a brake, over k_c and e.

Two free masses meet as an imposed tool meets one object of their reduced mass: same penetration, same force. The
impulse on that object is the impulse on the free one.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import impact_gym as ig
from experiments.lab.charts import SERIES
from experiments.paper.scenes import MOTION, OBJECT_MASS, TOOL_MASS, rigid
from experiments.paper.tables import Table, from_rows, where

REDUCED_MASS = TOOL_MASS * OBJECT_MASS / (TOOL_MASS + OBJECT_MASS)  # kg
STEADY = ig.Trapezoid(MOTION.speed, MOTION.acceleration)  # without a brake
TITLES = {0: "(a) tool fixed to the robot", 1: "(b) tool decoupled from the robot"}
STIFFNESSES = np.logspace(3.0, 6.0, 25)  # N/m^1.5
RESTITUTIONS = (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)  # as given to eq. 7


def sweep(pairs: Iterable[tuple[float, float]]) -> Table:
    """Simulate both cases for every (contact stiffness, restitution)."""
    rows = []
    for stiffness, restitution in pairs:
        for free, mass in enumerate((OBJECT_MASS, REDUCED_MASS)):
            outcome = ig.simulate(rigid(stiffness, restitution, object_mass=mass), STEADY, duration=2.0)
            (contact,) = outcome.contacts
            if contact.end is None:
                raise RuntimeError(f"k_c = {stiffness:g}, e = {restitution:g}: the contact lasts beyond the run")
            velocity = contact.impulse / OBJECT_MASS
            rows.append((free, stiffness, restitution, contact.peak_force, contact.end - contact.start, velocity))
    names = ("free", "contact_stiffness", "restitution", "peak_force", "duration", "object_velocity")
    return from_rows(names, rows)


def draw(table: Table, column: str, label: str, panels: int = 2) -> tuple[Figure, Any]:
    """Draw `column` against k_c, a panel per limit case and a curve per restitution; return the panels too."""
    figure = Figure(figsize=(5.0 * panels, 4.2))
    grid: Any = figure.subplots(1, panels)
    for free, axes in zip(TITLES, grid, strict=False):
        for colour, restitution in zip(SERIES, RESTITUTIONS, strict=True):
            rows = where(table, free=free, restitution=restitution)
            on_grid = np.isin(rows["contact_stiffness"], STIFFNESSES)
            axes.loglog(
                rows["contact_stiffness"][on_grid], rows[column][on_grid], color=colour, label=f"e = {restitution:g}"
            )
        axes.set(title=TITLES[free], xlabel="contact stiffness k_c (N/m$^{1.5}$)", ylabel=label)
        axes.legend(ncols=2, fontsize=9)
    shared = (min(a.get_ylim()[0] for a in grid[:2]), max(a.get_ylim()[1] for a in grid[:2]))
    for axes in grid[:2]:
        axes.set_ylim(shared)
    return figure, grid


def gridded(table: Table, column: str, free: int) -> Any:
    """Return `column` of one limit case as an array over (restitution, contact stiffness)."""
    return np.array(
        [
            [where(table, free=free, restitution=e, contact_stiffness=k)[column][0] for k in STIFFNESSES]
            for e in RESTITUTIONS
        ]
    )
