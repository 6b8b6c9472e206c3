"""Section 2.1, instantaneous impact: closed forms at v_t = 1 m/s, v_p = 0 (paper, eq. 1-4); no simulation."""

import numpy as np
import polars as pl

from experiments.lab.charts import FLANGE, OBJECT, SERIES, TOOL
from experiments.lab.scenes import OBJECT_MASS, ROBOT_AND_TOOL, TOOL_MASS
from experiments.studies.paper.layouts import Panels, Reproduction, panels
from experiments.studies.paper.runs import Numbers, where
from impact_gym.physics import impact

RESTITUTIONS = (0.0, 0.25, 0.5, 0.75, 1.0)
MASSES = np.logspace(-2.0, 1.0, 121)  # kg


def figure_02() -> pl.DataFrame:
    """Evaluate eq. 1, 3 and 4 over the restitution."""
    restitution = np.linspace(0.0, 1.0, 101)
    tool, hit = impact.free_tool(TOOL_MASS, OBJECT_MASS, 1.0, 0.0, restitution)
    fixed = impact.rigid_tool(1.0, 0.0, restitution)
    columns = {"tool_velocity": tool, "object_velocity": hit, "object_velocity_fixed": fixed}
    return pl.DataFrame({"restitution": restitution, **{name: np.asarray(column) for name, column in columns.items()}})


@panels(7.0, 4.4)
def _plot_02(frame: pl.DataFrame, axes: Panels) -> None:
    e = frame["restitution"]
    axes.plot(e, frame["object_velocity_fixed"], color=FLANGE, linestyle="--", label="object, tool fixed (eq. 1)")
    axes.plot(e, frame["object_velocity"], color=OBJECT, label="object, tool free (eq. 4)")
    axes.plot(e, frame["tool_velocity"], color=TOOL, label="free tool (eq. 3)")
    axes.set(xlabel="restitution e", ylabel="velocity after the impact (m/s)")
    axes.legend()


def _numbers_02(frame: pl.DataFrame) -> Numbers:
    columns = where(frame)
    fixed, hit, tool = columns["object_velocity_fixed"], columns["object_velocity"], columns["tool_velocity"]
    return {
        "fixed_elastic": fixed[-1],
        "fixed_inelastic": fixed[0],
        "object_steps": np.diff(hit),
        "tool_change_steps": np.diff(np.abs(tool - 1.0)),
        "object_ends": hit[[0, -1]],
        "tool_ends": tool[[0, -1]],
        "share": hit / fixed,
        "residual": np.abs(TOOL_MASS * tool + OBJECT_MASS * hit - TOOL_MASS).max(),
    }


def figure_03() -> pl.DataFrame:
    """Evaluate eq. 3 and 4 over restitution and mass of the tool; with the paper's tool, and robot and tool."""
    every_mass = np.sort(np.append(MASSES, (TOOL_MASS, ROBOT_AND_TOOL)))
    restitution, mass = (axis.ravel() for axis in np.meshgrid(RESTITUTIONS, every_mass, indexing="ij"))
    tool, hit = (np.asarray(velocity) for velocity in impact.free_tool(mass, OBJECT_MASS, 1.0, 0.0, restitution))
    columns = {"restitution": restitution, "tool_mass": mass, "tool_velocity": tool, "object_velocity": hit}
    return pl.DataFrame(columns)


@panels(10.4, 4.2, columns=2, sharex=True)
def _plot_03(frame: pl.DataFrame, grid: Panels) -> None:
    columns = {"object_velocity": "object, V_p (m/s)", "tool_velocity": "tool, V_t (m/s)"}
    for axes, (column, label) in zip(grid, columns.items(), strict=True):
        for colour, restitution in zip(SERIES, RESTITUTIONS, strict=False):
            rows = where(frame, restitution=restitution)
            axes.semilogx(rows["tool_mass"], rows[column], color=colour, label=f"e = {restitution:g}")
        for mass in (TOOL_MASS, ROBOT_AND_TOOL):
            axes.axvline(mass, color="#888888", linewidth=0.8, linestyle=":")
            placing = {"xytext": (-3, 4), "textcoords": "offset points", "rotation": 90, "ha": "right", "va": "bottom"}
            axes.annotate(f"{mass:g} kg", (mass, 0.0), xycoords=("data", "axes fraction"), fontsize=8, **placing)
        axes.set(xlabel="mass of the tool m_t (kg)", ylabel=label)
        axes.legend()


def _numbers_03(frame: pl.DataFrame) -> Numbers:
    curves = [where(frame, restitution=e)["object_velocity"] for e in RESTITUTIONS]
    return {
        "steps": np.diff(curves),
        "ends": curves[-1][[0, -1]],
        "heavy": where(frame, restitution=1.0, tool_mass=ROBOT_AND_TOOL)["object_velocity"][0],
    }


FIGURES = {
    "figure_02": Reproduction(figure_02, _plot_02, _numbers_02),
    "figure_03": Reproduction(figure_03, _plot_03, _numbers_03),
}
