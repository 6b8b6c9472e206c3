"""Fig. 5 to 7: the two limit cases of the paper's Fig. 4 at 1 m/s and without a brake, over k_c and e.

Two free masses meet as an imposed tool meets one object of their reduced mass: same penetration, same force. The
impulse on that object is the impulse on the free one.
"""

from collections.abc import Iterable

import numpy as np

import impact_gym as ig
from experiments.lab.charts import SERIES
from experiments.paper.layouts import Panels
from experiments.paper.scenes import MOTION, OBJECT_MASS, TOOL_MASS, rigid
from experiments.paper.tables import Table, from_rows, where

REDUCED_MASS = TOOL_MASS * OBJECT_MASS / (TOOL_MASS + OBJECT_MASS)  # kg
STEADY = ig.Trapezoid(MOTION.speed, MOTION.acceleration)  # without a brake
TITLES = {0: "(a) tool fixed to the robot", 1: "(b) tool decoupled from the robot"}
STIFFNESSES = np.logspace(3.0, 6.0, 25)  # N/m^1.5
NAMES = (
    "free", "contact_stiffness", "restitution", "peak_force", "duration", "object_velocity", "penetration",
    "separation_velocity",
)  # fmt: skip
RESTITUTIONS = (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)  # as given to eq. 7


def sweep(pairs: Iterable[tuple[float, float]]) -> Table:
    """Simulate both cases for every (contact stiffness, restitution)."""
    rows = []
    for stiffness, restitution in pairs:
        for free, mass in enumerate((OBJECT_MASS, REDUCED_MASS)):
            outcome = ig.simulate(rigid(stiffness, restitution, object_mass=mass), STEADY, duration=2.0, trace=True)
            (contact,) = outcome.contacts
            if contact.end is None:
                raise RuntimeError(f"k_c = {stiffness:g}, e = {restitution:g}: the contact lasts beyond the run")
            results = contact.peak_force, contact.end - contact.start, contact.impulse / OBJECT_MASS
            penetration = np.max(outcome.trace.tool_position - outcome.trace.object_position)
            rows.append((free, stiffness, restitution, *results, penetration, contact.separation_velocity))
    return from_rows(NAMES, rows)


def draw(grid: Panels, table: Table, column: str, label: str) -> None:
    """Draw `column` against k_c, a panel of `grid` (2,) per limit case and a curve per restitution."""
    for free, axes in zip(TITLES, grid, strict=True):
        for colour, e, values in zip(SERIES, RESTITUTIONS, gridded(table, column, free), strict=True):
            axes.loglog(STIFFNESSES, values, color=colour, label=f"e = {e:g}")
        axes.set(title=TITLES[free], xlabel="contact stiffness k_c (N/m$^{1.5}$)", ylabel=label)
        axes.legend(ncols=2, fontsize=9)
    limits = [axes.get_ylim() for axes in grid]
    for axes in grid:
        axes.set_ylim(np.min(limits), np.max(limits))


def gridded(table: Table, column: str, free: int) -> np.ndarray:
    """Return `column` of one limit case over (restitution, contact stiffness)."""
    rows = [where(table, free=free, restitution=e) for e in RESTITUTIONS]  # each by rising stiffness
    return np.array([row[column][np.isin(row["contact_stiffness"], STIFFNESSES)] for row in rows])
