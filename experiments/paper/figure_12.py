"""Fig. 12: m_r, c_r and k_r against the imposed position x_r; the dot marks the impact. Our estimates of the robot."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.lab.charts import OBJECT, TOOL
from experiments.paper.scenes import TOOL_MASS
from experiments.paper.statements import Statement, claim, number, undecided
from experiments.paper.tables import Table
from impact_gym.robot import default_approach

TITLE = "Lumped components of the robot along the imposed position"
ALT = (
    "Three panels against the position: mass, damping and stiffness fall to a minimum and rise steeply towards the "
    "end of "
    "the reach; a dot marks the impact at 5.2 kg. Dashed, the effective mass and stiffness lie well below."
)


def compute() -> Table:
    """Read the approach that ships with the robot model."""
    approach = default_approach()
    names = ("travel", "x", "mass", "damping", "stiffness", "effective_mass", "effective_stiffness")
    table: Table = {name: np.array(getattr(approach, name)) for name in names}
    table["at_impact"] = (np.arange(approach.travel.size) == approach.impact_row).astype(float)
    return table


def plot(table: Table) -> Figure:
    """Draw the three parameters and, dashed, what a force along x meets."""
    figure = Figure(figsize=(12.6, 3.8))
    grid: Any = figure.subplots(1, 3, sharex=True)
    at = int(np.argmax(table["at_impact"]))
    panels = {
        "mass": ("m_r (kg)", "effective_mass", "1/(M$_X^{-1}$)$_{11}$"),
        "damping": ("c_r (N s/m)", None, ""),
        "stiffness": ("k_r (N/m)", "effective_stiffness", "1/(K$_X^{-1}$)$_{11}$"),
    }
    for axes, (column, (label, other, other_label)) in zip(grid, panels.items(), strict=True):
        axes.plot(table["x"], table[column], color=TOOL, label="element (1,1), as in the paper")
        if other:
            axes.plot(table["x"], table[other], color=TOOL, linestyle="--", linewidth=1.0, label=f"ours: {other_label}")
        axes.plot(table["x"][at], table[column][at], "o", color=OBJECT, markersize=8, label="impact")
        axes.set(xlabel="imposed position x_r (m)", ylabel=label, ylim=(0, None))
        axes.legend(fontsize=9, loc="upper left")
    return figure


def statements(table: Table) -> tuple[Statement, ...]:
    """Compare with sections 3.1 and 3.2."""
    at = int(np.argmax(table["at_impact"]))
    varies = {name: float(table[name].max() / table[name].min()) for name in ("mass", "damping", "stiffness")}
    return (
        number(
            "3.2",
            "m_r + m_t is equal to 5.35 kg just before the impact",
            "5.35",
            float(table["mass"][at]) + TOOL_MASS,
            "kg",
            fitted=True,
            why="The line of approach in front of the robot is not printed; ours was chosen such that this comes true.",
        ),
        claim(
            "3.1",
            "The terms in eq. 16 depend on the robot configuration",
            min(varies.values()) > 1.1,
            ", ".join(f"{name} by a factor {factor:.1f}" for name, factor in varies.items()) + " over the line",
            "each varies by more than 10 % over the line",
        ),
        undecided(
            "3.2",
            "The trends of m_r, c_r, k_r as functions of x_r are depicted in Fig. 12",
            f"k_r = {table['stiffness'][at]:.3g} N/m, c_r = {table['damping'][at]:.3g} N s/m at the impact",
            "The paper took the inertia from the manufacturer's CAD and joint stiffness and damping from a modal "
            "analysis; the "
            "text prints none of them, nor the line. Ours are estimates and show what such curves look like.",
        ),
    )
