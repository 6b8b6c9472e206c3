"""Section 5, the bistable mechanism: Fig. 22 to 25. The restitution is 0.1, the contact stiffness 1e3 N/m^1.5."""

import math

import numpy as np
import polars as pl

import impact_gym as ig
from experiments.lab.scenes import HOLD, LINEAR, MECHANISM, MOTION, scene
from experiments.lab.study import Row
from experiments.studies.paper.runs import Array, Numbers, Run, histories, runs_of, where

HEIGHTS = (0.020, 0.024, 0.028, 0.032, 0.035)  # m, heights H of the mechanism
POSITIONS = np.linspace(-0.06, 0.06, 241)  # m, of the slider, within the stroke of every H


def figure_22() -> list[Row]:
    """Evaluate the force of eq. 23-24 over the slider's position, for each height H."""
    rows: list[Row] = []
    for height in HEIGHTS:
        mechanism = ig.Bistable(MECHANISM.stiffness, MECHANISM.free_length, height)
        peak = math.sqrt((mechanism.free_length * height**2) ** (2 / 3) - height**2)  # m, position of the largest force
        for x in sorted({*POSITIONS.tolist(), peak, -peak, MECHANISM.front_stop}):
            rows.append({"height": height, "position": x, "force": float(mechanism.force(x))})
    return rows


def _numbers_figure_22(frame: pl.DataFrame) -> Numbers:
    columns, used = where(frame), where(frame, height=MECHANISM.height)
    product, force = columns["position"] * columns["force"], used["force"]
    peaks = [where(frame, height=height)["force"].max() for height in HEIGHTS]
    return {
        "product": product[columns["position"] != 0.0], "relaxed": 1e3 * MECHANISM.stroke,
        "peak_steps": np.diff(peaks), "peak_ends": [peaks[0], peaks[-1]],
        "peak": force.max(), "peak_at": 1e3 * used["position"][np.argmax(force)],
        "stop": force[used["position"] == MECHANISM.front_stop][0], "hold": HOLD,
    }  # fmt: skip


def figure_23() -> pl.DataFrame:
    """Simulate Fig. 23a (mechanism) and 23b (spring and damper)."""
    return histories({"a": scene(1e3, 0.1, MECHANISM), "b": scene(1e3, 0.1, LINEAR)})


def _slider(trace: ig.Trace) -> tuple[Array, float]:
    """Return the slider's positions from the alignment (m), and the time of its first passage (s; inf: no passage)."""
    # the trace begins with the slider at rest, pressed slightly into its elastic front stop
    start = MECHANISM.front_stop + float(MECHANISM.force(MECHANISM.front_stop)) / MECHANISM.stop_stiffness
    x = start + trace.tool_position - trace.flange_position
    passed = np.flatnonzero((x[:-1] > 0.0) & (x[1:] <= 0.0))
    return x, float(trace.time[passed[0] + 1]) if passed.size else np.inf


def _numbers_figure_23(frame: pl.DataFrame) -> Numbers:
    (run, linear), (x, snap) = runs_of(frame), _slider(Run(frame, "a").trace)
    trace, time, tool = run.trace, run.trace.time, run.trace.tool_velocity
    touch = int(np.argmax(run.contact > 0))
    first_phase = (time >= time[touch]) & (time < snap)
    slowed = int(np.argmax(first_phase & (tool <= 0.4)))
    settling = first_phase & (time >= time[slowed])  # from tool velocity 0.4 m/s until the slider passes its alignment
    steady = settling & np.append(np.diff(time) > 0.0, False)  # an event has two points at one time
    rate = np.abs(np.diff(tool)[steady[:-1]] / np.diff(time)[steady[:-1]])
    plateau = tool[steady][np.argmin(rate)]  # m/s, tool velocity at the smallest `rate`
    at_stop = int(np.argmax((time > snap) & (x <= MECHANISM.rear_stop)))
    ahead = np.abs(tool - trace.flange_velocity)
    gap = (trace.object_position - trace.tool_position)[np.flatnonzero(run.contact)[-1] + 1 :]
    moving_back = trace.coupling_force[(run.contact > 0) & (x < MECHANISM.front_stop) & (x > 0.0)]
    fall, tool_felt = time[slowed] - time[touch], run.felt_contact.tool_velocity[-1]
    return {
        "bistable": run, "linear": linear, "lag": ahead[:touch].max(), "plateau": plateau,
        "fall": 1e3 * fall, "fall_rate": 0.6 / fall, "fall_over_brake": 0.6 / fall / MOTION.deceleration,
        "share": 100 * trace.object_velocity[slowed] / run.final_velocity,
        "tool_felt": tool_felt, "tool_felt_from_04": abs(tool_felt - 0.4),
        "change": np.ptp(tool[settling]), "snap": snap,
        "loss": plateau - tool[(time > snap) & (time < time[at_stop])].min(initial=np.inf),
        "at_stop": at_stop, "stop_time": time[at_stop], "difference": ahead[time > time[at_stop] + 0.02].max(),
        "from_stop": np.abs(x[time > time[-1] - 0.5] - MECHANISM.rear_stop), "x_last": 1e3 * x[-1],
        "largest": run.during_contact.coupling_force.max(),
        "largest_linear": linear.during_contact.coupling_force.max(),
        "force_steps": np.diff(moving_back), "force_ends": moving_back[[0, -1]], "gap": gap, "gap_last": gap[-1],
        "parting_time": run.during_contact.time[-1],
    }  # fmt: skip


figure_24 = figure_23


def _numbers_figure_24(frame: pl.DataFrame) -> Numbers:
    both = a, b = runs_of(frame)
    equation_22 = [run.equation_22(run.restitution, run.impulse) / run.final_velocity for run in both]
    return {"a": a, "b": b, "identity": max(abs(ratio - 1.0) for ratio in equation_22)}


def figure_25() -> pl.DataFrame:
    """Simulate a tool that is fixed to the robot, and a tool on the mechanism."""
    return histories({"rigid": scene(1e3, 0.1), "bistable": scene(1e3, 0.1, MECHANISM)})


def _numbers_figure_25(frame: pl.DataFrame) -> Numbers:
    fixed, bistable = (Run(frame, case) for case in ("rigid", "bistable"))
    reduction = 100.0 * (1.0 - bistable.final_velocity / fixed.final_velocity)
    return {"fixed": fixed, "bistable": bistable, "reduction": reduction}
