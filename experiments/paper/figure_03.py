"""Fig. 3: velocities after an instantaneous impact of a free tool against its mass (paper, eq. 3, 4); no simulation.

Marked: the tool of the paper, 0.125 kg, and robot and tool together, 5.35 kg.
"""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.lab.charts import SERIES
from experiments.paper.scenes import OBJECT_MASS, TOOL_MASS
from experiments.paper.statements import Statement, claim
from experiments.paper.tables import Table, from_rows, where
from impact_gym.physics import impact

TITLE = "Influence of the moving mass on the final velocities"
ALT = (
    "Two panels against the mass of the tool from 0.01 to 10 kg, a curve per restitution. The object's velocity rises "
    "with the mass towards 1 + e; the tool's rises from -e to 1 m/s."
)
RESTITUTIONS = (0.0, 0.25, 0.5, 0.75, 1.0)
MASSES = np.logspace(-2.0, 1.0, 121)  # kg
ROBOT_AND_TOOL = 5.35  # kg, printed in section 3.2


def compute() -> Table:
    """Evaluate the closed forms at v_t = 1 m/s, v_p = 0."""
    rows: list[tuple[float, ...]] = []
    for restitution in RESTITUTIONS:
        for mass in (*MASSES, TOOL_MASS, ROBOT_AND_TOOL):
            tool, hit = impact.free_tool(mass, OBJECT_MASS, 1.0, 0.0, restitution)
            rows.append((restitution, float(mass), float(tool), float(hit)))
    return from_rows(("restitution", "tool_mass", "tool_velocity", "object_velocity"), sorted(rows))


def plot(table: Table) -> Figure:
    """Draw both velocities against the tool's mass."""
    figure = Figure(figsize=(10.4, 4.2))
    grid: Any = figure.subplots(1, 2, sharex=True)
    panels = {"object_velocity": "object, V_p (m/s)", "tool_velocity": "tool, V_t (m/s)"}
    for axes, (column, label) in zip(grid, panels.items(), strict=True):
        for colour, restitution in zip(SERIES, RESTITUTIONS, strict=False):
            rows = where(table, restitution=restitution)
            axes.semilogx(rows["tool_mass"], rows[column], color=colour, label=f"e = {restitution:g}")
        for mass in (TOOL_MASS, ROBOT_AND_TOOL):
            axes.axvline(mass, color="#888888", linewidth=0.8, linestyle=":")
            axes.annotate(
                f"{mass:g} kg", (mass, 0.0), (-3, 4), xycoords=("data", "axes fraction"),
                textcoords="offset points", rotation=90, ha="right", va="bottom", fontsize=8,
            )  # fmt: skip
        axes.set(xlabel="mass of the tool m_t (kg)", ylabel=label)
        axes.legend()
    return figure


def statements(table: Table) -> tuple[Statement, ...]:
    """Compare with sections 2.1 and 3.2."""
    curves = [where(table, restitution=e)["object_velocity"].astype(float) for e in RESTITUTIONS]
    elastic = where(table, restitution=1.0)
    heavy = float(elastic["object_velocity"][elastic["tool_mass"] == ROBOT_AND_TOOL][0])
    return (
        claim(
            "2.1",
            "A decrease in the mass of the tool causes a decrease in V_p for every value of e",
            all(bool((np.diff(curve) > 0).all()) for curve in curves),
            f"at e = 1, V_p falls from {curves[-1][-1]:.3f} m/s at {MASSES[-1]:g} kg to {curves[-1][0]:.3f} m/s "
            f"at {MASSES[0]:g} kg",
            "falls from each mass to the next smaller one, at every e",
        ),
        claim(
            "3.2",
            "Eq. 4 shows that V_p increases asymptotically towards the limit case when the tool mass becomes large",
            0.9 * 2.0 < heavy < 2.0,
            f"{heavy:.4f} at 5.35 kg and e = 1; the limit is 2",
            "at 5.35 kg and e = 1 above 90 % of the limit and below it",
            unit="m/s",
        ),
    )
