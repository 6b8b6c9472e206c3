"""Section 3, the compliant robot (3.1 its model, 3.2 its impacts): Fig. 11 to 14."""

from functools import partial

import numpy as np
import polars as pl

from experiments.lab.charts import FLANGE, OBJECT, TOOL
from experiments.lab.scenes import (
    HEAVY_MASS,
    MOTION,
    OBJECT_MASS,
    ROBOT,
    ROBOT_AND_TOOL,
    STEADY,
    TOOL_MASS,
    scene,
    simulate_with_trace,
)  # fmt: skip
from experiments.studies.paper.layouts import Panels, Reproduction, imposed_and_actual, panels
from experiments.studies.paper.runs import Numbers, Run, histories, where
from impact_gym.physics.impact import GRAVITY, sliding_distance
from impact_gym.robot import IMPACT, default_approach

FRICTION = 0.3  # between object and plane; the paper prints none
JOINTS = {"a": "(a) rigid joints", "b": "(b) compliant joints"}
HEAVY = {"a": "(a) k_c = $10^5$ N/m$^{1.5}$", "b": "(b) k_c = $10^6$ N/m$^{1.5}$"}


def figure_11() -> pl.DataFrame:
    """Simulate the approach of Fig. 13b; positions in the base frame of our robot model."""
    outcome, trace = simulate_with_trace(scene(1e5, 1.0, robot=ROBOT))
    position = default_approach().x[0] + trace.command_position
    columns = {"time": trace.time, "position": position, "velocity": trace.command_velocity}
    events = pl.lit(outcome.contacts[0].start).alias("impact"), pl.lit(outcome.detection_time).alias("detection")
    return pl.DataFrame(columns).with_columns(events)


@panels(10.4, 3.8, columns=2, sharex=True)
def _plot_11(frame: pl.DataFrame, grid: Panels) -> None:
    columns = where(frame)
    time, impact = columns["time"], columns["impact"][0]
    labels = {"position": "imposed position x_r (m)", "velocity": "imposed velocity v_r (m/s)"}
    for axes, (column, label) in zip(grid, labels.items(), strict=True):
        before, values = time <= impact, columns[column]
        axes.plot(time[before], values[before], color=FLANGE)
        axes.plot(time[~before], values[~before], color=FLANGE, linestyle=":", linewidth=1.0, label="after it")
        axes.plot(impact, np.interp(impact, time, values), "o", color=OBJECT, markersize=8, label="impact")
        axes.set(xlabel="time (s)", ylabel=label, xlim=(0.0, 0.6))
        axes.legend(loc="center right")


def _numbers_11(frame: pl.DataFrame) -> Numbers:
    time, _, velocity, (impact, *_), (detection, *_) = where(frame).values()
    falling = np.flatnonzero((velocity[1:] < velocity[:-1]) & (time[:-1] > impact))
    braking = (velocity < 0.9) & (velocity > 0.1) & (time > impact)
    slope, offset = np.polyfit(time[braking], velocity[braking], 1)
    return {
        "impact": impact,
        "at_impact": np.interp(impact, time, velocity),
        "falls_from": time[falling[0]],
        "delay": 1e3 * ((MOTION.speed - offset) / slope - detection),
    }


def figure_12() -> pl.DataFrame:
    """Read the approach that ships with the robot model."""
    approach = default_approach()
    names = ("position", "x", "held", "damping", "stiffness", "effective", "effective_stiffness")
    columns = {name: np.array(getattr(approach, name)) for name in names}
    return pl.DataFrame({**columns, "at_impact": approach.position == IMPACT})


@panels(12.6, 3.8, columns=3, sharex=True)
def _plot_12(frame: pl.DataFrame, grid: Panels) -> None:
    at = where(frame, at_impact=True)
    columns = {
        "held": ("m_r (kg)", "effective", "1/(M$_X^{-1}$)$_{11}$"),
        "damping": ("c_r (N s/m)", None, ""),
        "stiffness": ("k_r (N/m)", "effective_stiffness", "1/(K$_X^{-1}$)$_{11}$"),
    }
    for axes, (column, (label, effective, note)) in zip(grid, columns.items(), strict=True):
        axes.plot(frame["x"], frame[column], color=TOOL, label="element (1,1), as in the paper")
        if effective:
            axes.plot(frame["x"], frame[effective], color=TOOL, linestyle="--", linewidth=1.0, label=f"ours: {note}")
        axes.plot(at["x"], at[column], "o", color=OBJECT, markersize=8, label="impact")
        axes.set(xlabel="imposed position x_r (m)", ylabel=label, ylim=(0, None))
        axes.legend(fontsize=9, loc="upper left")


def _numbers_12(frame: pl.DataFrame) -> Numbers:
    columns, at = where(frame), where(frame, at_impact=True)
    return {
        "mass": at["held"][0] + TOOL_MASS, "stiffness": at["stiffness"][0], "damping": at["damping"][0],
        "factors": [columns[name].max() / columns[name].min() for name in ("held", "damping", "stiffness")],
    }  # fmt: skip


def figure_13() -> pl.DataFrame:
    """Simulate both, and the second again with our estimates of the robot: frozen at the impact, and along the line."""
    approach = default_approach()
    robots = {"a": None, "b": ROBOT, "frozen": approach.at(IMPACT), "along": approach.robot_table()}
    scenes = {case: scene(1e5, 1.0, robot=robot) for case, robot in robots.items()}
    for case in ("b", "along"):  # beyond reach: nothing is struck within the run
        scenes[f"{case}, unhindered"] = scene(1e5, 1.0, robot=robots[case], distance=10.0)
    return histories(scenes)


def _order(delay: float) -> str:
    return "after" if delay > 0 else "before"


def _numbers_13(frame: pl.DataFrame) -> Numbers:
    rigid, run, frozen, along = (Run(frame, case) for case in ("a", "b", "frozen", "along"))
    commanded = rigid.trace.command_velocity
    delay, minimum = run.nearest_minimum(Run(frame, "b, unhindered"))
    delay_along, minimum_along = along.nearest_minimum(Run(frame, "along, unhindered"))
    friction_loss = FRICTION * GRAVITY * run.duration_of_contact
    return {
        "rigid": rigid.final_velocity, "contact_ends": rigid.during_contact.time[-1],
        "braking": rigid.trace.time[(commanded < MOTION.speed) & (rigid.trace.time > 0.2)][0],
        "impact_velocity": run.impact_velocity, "compliant": run.final_velocity,
        "delay": 1e3 * abs(delay), "order": _order(delay), "minimum": minimum,
        "times": run.final_velocity / MOTION.speed,
        "lower": 100.0 * (1.0 - run.final_velocity / rigid.final_velocity),
        "deflection": 1e3 * run.deflection, "peak": run.trace.contact_force.max(),
        "friction": FRICTION * OBJECT_MASS * GRAVITY, "friction_loss": friction_loss,
        "friction_share": friction_loss / run.final_velocity,
        "slide": float(sliding_distance(run.final_velocity, FRICTION)),
        "along": along.final_velocity, "frozen": frozen.final_velocity,
        "impact_along": along.impact_velocity, "impact_frozen": frozen.impact_velocity,
        "change": abs(frozen.final_velocity - along.final_velocity),
        "impact_change": abs(frozen.impact_velocity - along.impact_velocity),
        "delay_along": 1e3 * abs(delay_along), "order_along": _order(delay_along), "minimum_along": minimum_along,
    }  # fmt: skip


def figure_14() -> pl.DataFrame:
    """Simulate both, Fig. 13b beside them, and (b) once more with a robot that never brakes."""
    soft, stiff = (scene(k_c, 1.0, robot=ROBOT, object_mass=HEAVY_MASS) for k_c in (1e5, 1e6))
    braking = histories({"a": soft, "b": stiff, "13b": scene(1e5, 1.0, robot=ROBOT)})
    return pl.concat([braking, histories({"b, no brake": stiff}, STEADY)])


def _numbers_14(frame: pl.DataFrame) -> Numbers:
    a, b, light, without_brake = (Run(frame, case) for case in ("a", "b", "13b", "b, no brake"))
    touching, impact = a.first_contact, a.impact_velocity
    lost_a, lost_b = (impact - run.first_contact.tool_velocity.min() for run in (a, b))
    before, after = b.vibration
    after_without_brake = without_brake.vibration[1]
    return {
        "share": 100.0 * HEAVY_MASS / ROBOT_AND_TOOL,
        "impact": impact, "impact_light": light.impact_velocity,
        "mean": np.trapezoid(touching.tool_velocity, touching.time) / a.duration_of_contact,
        "a": a.final_velocity, "b": b.final_velocity, "light": light.final_velocity,
        "less": 100.0 * (1.0 - a.final_velocity / light.final_velocity),
        "force_a": a.trace.contact_force.max(), "force_b": b.trace.contact_force.max(),
        "deflection_a": 1e3 * a.deflection, "deflection_b": 1e3 * b.deflection,
        "lost_a": lost_a, "lost_b": lost_b, "lost_share": lost_b / impact, "lost_ratio": lost_b / lost_a,
        "before": before, "after": after, "growth": after / before,
        "after_without_brake": after_without_brake, "growth_without_brake": after_without_brake / before,
    }  # fmt: skip


FIGURES = {
    "figure_11": Reproduction(figure_11, _plot_11, _numbers_11),
    "figure_12": Reproduction(figure_12, _plot_12, _numbers_12),
    "figure_13": Reproduction(figure_13, partial(imposed_and_actual, titles=JOINTS), _numbers_13),
    "figure_14": Reproduction(figure_14, partial(imposed_and_actual, titles=HEAVY), _numbers_14),
}
