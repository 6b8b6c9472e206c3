"""Fig. 3: velocities after an instantaneous impact of a free tool against its mass (paper, eq. 3, 4); no simulation.

Marked: the tool of the paper, 0.125 kg, and robot and tool together, 5.35 kg.
"""

import numpy as np

from experiments.lab.charts import SERIES
from experiments.paper.layouts import Panels, panels
from experiments.paper.scenes import OBJECT_MASS, ROBOT_AND_TOOL, TOOL_MASS
from experiments.paper.statements import Statements, section_2_1, section_3_2
from experiments.paper.tables import Table, where
from impact_gym.physics import impact

TITLE = "Influence of the moving mass on the final velocities"
ALT = """Two panels against the mass of the tool from 0.01 to 10 kg, a curve per restitution. The object's velocity
rises with the mass towards 1 + e; the tool's rises from -e to 1 m/s."""
RESTITUTIONS = (0.0, 0.25, 0.5, 0.75, 1.0)
MASSES = np.logspace(-2.0, 1.0, 121)  # kg


def compute() -> Table:
    """Evaluate the closed forms at v_t = 1 m/s, v_p = 0."""
    every_mass = np.sort(np.append(MASSES, (TOOL_MASS, ROBOT_AND_TOOL)))
    restitution, mass = (axis.ravel() for axis in np.meshgrid(RESTITUTIONS, every_mass, indexing="ij"))
    tool, hit = (np.asarray(velocity) for velocity in impact.free_tool(mass, OBJECT_MASS, 1.0, 0.0, restitution))
    return {"restitution": restitution, "tool_mass": mass, "tool_velocity": tool, "object_velocity": hit}


@panels(10.4, 4.2, columns=2, sharex=True)
def plot(table: Table, grid: Panels) -> None:
    columns = {"object_velocity": "object, V_p (m/s)", "tool_velocity": "tool, V_t (m/s)"}
    for axes, (column, label) in zip(grid, columns.items(), strict=True):
        for colour, restitution in zip(SERIES, RESTITUTIONS, strict=False):
            rows = where(table, restitution=restitution)
            axes.semilogx(rows["tool_mass"], rows[column], color=colour, label=f"e = {restitution:g}")
        for mass in (TOOL_MASS, ROBOT_AND_TOOL):
            axes.axvline(mass, color="#888888", linewidth=0.8, linestyle=":")
            placing = {"xytext": (-3, 4), "textcoords": "offset points", "rotation": 90, "ha": "right", "va": "bottom"}
            axes.annotate(f"{mass:g} kg", (mass, 0.0), xycoords=("data", "axes fraction"), fontsize=8, **placing)
        axes.set(xlabel="mass of the tool m_t (kg)", ylabel=label)
        axes.legend()


def statements(table: Table) -> Statements:
    curves = [where(table, restitution=e)["object_velocity"] for e in RESTITUTIONS]
    heavy = where(table, restitution=1.0, tool_mass=ROBOT_AND_TOOL)["object_velocity"][0]
    yield section_2_1.given.claim(
        "A decrease in the mass of the tool causes a decrease in V_p for every value of e",
        all((np.diff(curve) > 0).all() for curve in curves),
        f"at e = 1, V_p falls from {curves[-1][-1]:.3f} m/s at {MASSES[-1]:g} kg to {curves[-1][0]:.3f} m/s at "
        f"{MASSES[0]:g} kg",
        "falls from each mass to the next smaller one, at every e",
    )
    yield section_3_2.given.claim(
        "Eq. 4 shows that V_p increases asymptotically towards the limit case when the tool mass becomes large",
        0.9 * 2.0 < heavy < 2.0,
        f"{heavy:.4f} at 5.35 kg and e = 1; the limit is 2 m/s",
        "at 5.35 kg and e = 1 above 90 % of the limit and below it",
    )
