"""Section 2.1, instantaneous impact: closed forms at v_t = 1 m/s, v_p = 0 (paper, eq. 1-4); no simulation."""

import numpy as np
import polars as pl

from experiments.lab.charts import FLANGE, OBJECT, SERIES, TOOL
from experiments.lab.scenes import OBJECT_MASS, ROBOT_AND_TOOL, TOOL_MASS
from experiments.studies.paper.layouts import Panels, Reproduction
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


def _draw_02(frame: pl.DataFrame, axes: Panels) -> None:
    e = frame["restitution"]
    axes.plot(e, frame["object_velocity_fixed"], color=FLANGE, linestyle="--", label="object, tool fixed (eq. 1)")
    axes.plot(e, frame["object_velocity"], color=OBJECT, label="object, tool free (eq. 4)")
    axes.plot(e, frame["tool_velocity"], color=TOOL, label="free tool (eq. 3)")


def _numbers_02(frame: pl.DataFrame) -> Numbers:
    _, tool, hit, fixed = where(frame).values()
    return {
        "fixed_ends": fixed[[0, -1]],
        "object_ends": hit[[0, -1]],
        "object_steps": np.diff(hit),
        "tool_ends": tool[[0, -1]],
        "tool_change_steps": np.diff(np.abs(tool - 1.0)),
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


def _draw_03(frame: pl.DataFrame, grid: Panels) -> None:
    for axes, column in zip(grid, ("object_velocity", "tool_velocity"), strict=True):
        for colour, restitution in zip(SERIES, RESTITUTIONS, strict=False):
            rows = where(frame, restitution=restitution)
            axes.semilogx(rows["tool_mass"], rows[column], color=colour, label=f"e = {restitution:g}")
        for mass in (TOOL_MASS, ROBOT_AND_TOOL):
            axes.axvline(mass, color="#888888", linewidth=0.8, linestyle=":")
            placing = {"xytext": (-3, 4), "textcoords": "offset points", "rotation": 90, "ha": "right", "va": "bottom"}
            axes.annotate(f"{mass:g} kg", (mass, 0.0), xycoords=("data", "axes fraction"), fontsize=8, **placing)


def _numbers_03(frame: pl.DataFrame) -> Numbers:
    curves = [where(frame, restitution=e)["object_velocity"] for e in RESTITUTIONS]
    heavy = where(frame, restitution=1.0, tool_mass=ROBOT_AND_TOOL)["object_velocity"][0]
    return {"steps": np.diff(curves), "ends": curves[-1][[0, -1]], "heavy": heavy}


FIGURES = {
    "figure_02": Reproduction(figure_02, _draw_02, _numbers_02),
    "figure_03": Reproduction(figure_03, _draw_03, _numbers_03),
}
