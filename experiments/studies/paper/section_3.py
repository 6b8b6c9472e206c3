"""Section 3, the compliant robot (3.1 model, 3.2 impacts): Fig. 11 to 14."""

import numpy as np
import polars as pl

from experiments.lab import scenes
from experiments.studies.paper.runs import Numbers, Run, histories, where
from impact_gym.physics.impact import GRAVITY, sliding_distance
from impact_gym.robot import IMPACT, default_approach

FRICTION = 0.3  # coefficient of friction between object and plane; the paper gives no number
# keys: columns that Fig. 12 draws as solid lines; values: columns of the dashed lines beside them, or None
COMPONENTS = {"held": "effective", "damping": None, "stiffness": "effective_stiffness"}


def figure_11() -> pl.DataFrame:
    """Simulate the approach of Fig. 13b; `position` is in the base frame of our robot model."""
    outcome, trace = scenes.simulate_with_trace(scenes.scene(1e5, 1.0, robot=scenes.ROBOT))
    position = default_approach().start[0] + trace.command_position
    columns = {"time": trace.time, "position": position, "velocity": trace.command_velocity}
    events = {"impact": outcome.contacts[0].start, "detection": outcome.detection_time}
    return pl.DataFrame({**columns, **events}).with_columns(at_impact=pl.col("time") == pl.col("impact"))


def _numbers_figure_11(frame: pl.DataFrame) -> Numbers:
    time, _, velocity, (impact, *_), (detection, *_), _ = where(frame).values()
    falling = np.flatnonzero((velocity[1:] < velocity[:-1]) & (time[:-1] > impact))
    braking = (velocity < 0.9) & (velocity > 0.1) & (time > impact)
    slope, offset = np.polyfit(time[braking], velocity[braking], 1)
    return {
        "impact": impact, "at_impact": np.interp(impact, time, velocity), "falls_from": time[falling[0]],
        "delay": 1e3 * ((scenes.MOTION.speed - offset) / slope - detection),
    }  # fmt: skip


def figure_12() -> pl.DataFrame:
    """Tabulate the shipped robot model along its approach."""
    approach = default_approach()
    columns = {"position": approach.position, "x": approach.start[0] + approach.position * approach.direction[0]}
    names = ("held", "damping", "stiffness", "effective", "effective_stiffness")
    columns |= {name: getattr(approach, name) for name in names}
    return pl.DataFrame({**columns, "at_impact": approach.position == IMPACT})


def _numbers_figure_12(frame: pl.DataFrame) -> Numbers:
    columns, at = where(frame), where(frame, at_impact=True)
    factors = [columns[name].max() / columns[name].min() for name in COMPONENTS]
    return {"mass": at["held"][0] + scenes.TOOL_MASS, "at": at, "factors": factors}


def figure_13() -> pl.DataFrame:
    """Simulate Fig. 13a and 13b, and 13b with our robot model, whose parameters are constant ("frozen") or vary."""
    approach = default_approach()
    robots = {"a": None, "b": scenes.ROBOT, "frozen": approach.at(IMPACT), "along": approach.robot_table()}
    approaches = {case: scenes.scene(1e5, 1.0, robot=robot) for case, robot in robots.items()}
    for case in ("b", "along"):  # with the object out of reach
        approaches[f"{case}, unhindered"] = scenes.scene(1e5, 1.0, robot=robots[case], distance=10.0)
    return histories(approaches)


def _nearest_minimum(frame: pl.DataFrame, case: str) -> Numbers:
    """Return the minimum of the tool's velocity, with the object out of reach, nearest to the impact time of `case`."""
    impact_time = Run(frame, case).during_contact.time[0]
    unhindered = where(frame, case=f"{case}, unhindered")
    time, velocity = unhindered["time"], unhindered["tool_velocity"]
    minima = np.flatnonzero((velocity[1:-1] < velocity[:-2]) & (velocity[1:-1] <= velocity[2:])) + 1
    nearest = minima[np.argmin(np.abs(time[minima] - impact_time))]
    delay = impact_time - time[nearest]
    return {"velocity": velocity[nearest], "apart": 1e3 * abs(delay), "order": "after" if delay > 0 else "before"}


def _numbers_figure_13(frame: pl.DataFrame) -> Numbers:
    rigid, compliant, frozen, along = (Run(frame, case) for case in ("a", "b", "frozen", "along"))
    commanded, time = rigid.trace.command_velocity, rigid.trace.time
    friction = {run.final_velocity: FRICTION * GRAVITY * np.ptp(run.first_contact.time) for run in (rigid, compliant)}
    return {
        "rigid": rigid, "compliant": compliant, "frozen": frozen, "along": along,
        "contact_ends": rigid.during_contact.time[-1],
        "braking": time[(commanded < scenes.MOTION.speed) & (time > 0.2)][0],
        "minimum": _nearest_minimum(frame, "b"), "minimum_along": _nearest_minimum(frame, "along"),
        "times": compliant.final_velocity / scenes.MOTION.speed,
        "lower": 100.0 * (1.0 - compliant.final_velocity / rigid.final_velocity),
        "friction": FRICTION * scenes.OBJECT_MASS * GRAVITY, "friction_loss": max(friction.values()),
        "friction_share": max(loss / velocity for velocity, loss in friction.items()),
        "slide": float(sliding_distance(compliant.final_velocity, FRICTION)),
        "change": abs(frozen.final_velocity - along.final_velocity),
        "impact_change": abs(frozen.impact_velocity - along.impact_velocity),
    }  # fmt: skip


def figure_14() -> pl.DataFrame:
    """Simulate Fig. 14a and 14b with and without a brake, and Fig. 13b."""
    soft, stiff = (scenes.scene(k_c, 1.0, robot=scenes.ROBOT, object_mass=scenes.HEAVY_MASS) for k_c in (1e5, 1e6))
    braking = histories({"a": soft, "b": stiff, "13b": scenes.scene(1e5, 1.0, robot=scenes.ROBOT)})
    return pl.concat([braking, histories({"a, no brake": soft, "b, no brake": stiff}, scenes.STEADY)])


def _ranges(run: Run) -> tuple[float, float]:
    """Return max - min of tool minus commanded velocity (m/s) for the 50 ms before and after the first contact."""
    relative, time = run.trace.tool_velocity - run.trace.command_velocity, run.trace.time
    start, end = run.first_contact.time[[0, -1]]
    before, after = (time > start - 0.05) & (time < start), (time > end) & (time < end + 0.05)
    return np.ptp(relative[before]), np.ptp(relative[after])


def _numbers_figure_14(frame: pl.DataFrame) -> Numbers:
    a, b, light, *steady = (Run(frame, case) for case in ("a", "b", "13b", "a, no brake", "b, no brake"))
    touching = a.first_contact
    lost = [a.impact_velocity - run.first_contact.tool_velocity.min() for run in (a, b, *steady)]
    (before, after), (_, after_without_brake) = _ranges(b), _ranges(steady[1])
    lower = np.array([1.0 - run.final_velocity / (2.0 * scenes.MOTION.speed) for run in (light, a, b)])
    return {
        "a": a, "b": b, "light": light,
        "share": 100.0 * scenes.HEAVY_MASS / scenes.ROBOT_AND_TOOL,
        "mean": np.trapezoid(touching.tool_velocity, touching.time) / np.ptp(touching.time),
        "less": 100.0 * (1.0 - a.final_velocity / light.final_velocity),
        "lost": lost, "lost_share": lost[1] / a.impact_velocity, "lost_ratio": lost[1] / lost[0],
        "lost_ratio_without_brake": lost[3] / lost[2],
        "yields": [100.0 * run.deflection / run.way for run in (a, b)],
        "lower": 100.0 * lower, "nearly_rigid": np.sum(lower < 0.1),
        "before": before, "after": after, "growth": after / before,
        "after_without_brake": after_without_brake, "growth_without_brake": after_without_brake / before,
    }  # fmt: skip
