"""Section 5, the bistable mechanism: Fig. 22 to 25; e = 0.1, k_c = 1e3."""

from functools import partial
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure

import impact_gym as ig
from experiments.lab.charts import COUPLING, OBJECT, SERIES, velocities
from experiments.lab.scenes import HOLD, LINEAR, MECHANISM, MOTION, scene
from experiments.studies.paper.layouts import Panels, Reproduction, impulses, panels, velocities_and_forces
from experiments.studies.paper.runs import Numbers, Row, Run, histories, where

HEIGHTS = (0.020, 0.024, 0.028, 0.032, 0.035)  # m
POSITIONS = np.linspace(-0.06, 0.06, 241)  # m, within the stroke of every H
TITLES = {"a": "(a, c) bistable mechanism", "b": "(b, d) linear spring-damper"}
IMPULSES = {"a": "bistable mechanism", "b": "linear spring-damper"}


def figure_22() -> list[Row]:
    """Evaluate eq. 23-24."""
    rows: list[Row] = []
    for height in HEIGHTS:
        mechanism = ig.Bistable(MECHANISM.stiffness, MECHANISM.free_length, height)
        for x in sorted({*POSITIONS.tolist(), mechanism.peak_position, -mechanism.peak_position, MECHANISM.front_stop}):
            rows.append({"height": height, "position": x, "force": float(mechanism.force(x))})
    return rows


@panels(7.6, 4.8)
def _plot_22(frame: pl.DataFrame, axes: Panels) -> None:
    for low, high in ((-60.0, 1e3 * MECHANISM.rear_stop), (1e3 * MECHANISM.front_stop, 60.0)):
        axes.axvspan(low, high, color="#E69F00", alpha=0.15, linewidth=0)
        axes.annotate("barred by a stop", (0.5 * (low + high), 1.55), ha="center", va="bottom", fontsize=8)
    for colour, height in zip(SERIES, HEIGHTS, strict=False):
        rows = where(frame, height=height)
        used = height == MECHANISM.height
        label = f"H = {1e3 * height:g} mm" + (" (used)" if used else "")
        axes.plot(1e3 * rows["position"], rows["force"], color=colour, linewidth=2.4 if used else 1.3, label=label)
    axes.axhline(HOLD, color="#888888", linewidth=0.8, linestyle=":")
    axes.annotate(f"m_t a = {HOLD:g} N", (-58.0, HOLD), (0, 3), textcoords="offset points", fontsize=8)
    axes.set(xlabel="position of the slider from the alignment x (mm)", ylabel="force on the tool F_T (N)")
    axes.set(xlim=(-60.0, 60.0), ylim=(-1.7, 1.75))
    axes.legend(loc="lower right")


def _numbers_22(frame: pl.DataFrame) -> Numbers:
    columns, used = where(frame), where(frame, height=MECHANISM.height)
    x, force, own = columns["position"], columns["force"], used["force"]
    peaks = [where(frame, height=height)["force"].max() for height in HEIGHTS]
    return {
        "signs_of_force": np.sign(force[x != 0.0]),
        "signs_of_position": np.sign(x[x != 0.0]),
        "relaxed": 1e3 * MECHANISM.equilibria[2],
        "peak_steps": np.diff(peaks),
        "peak_ends": [peaks[0], peaks[-1]],
        "peak": own.max(),
        "peak_at": 1e3 * used["position"][np.argmax(own)],
        "stop": own[used["position"] == MECHANISM.front_stop][0],
        "hold": HOLD,
    }


def figure_23() -> pl.DataFrame:
    """Simulate both."""
    return histories({"a": scene(1e3, 0.1, MECHANISM), "b": scene(1e3, 0.1, LINEAR)})


class SliderRun(Run):
    """Case (a) of the frame, with what its slider does."""

    def __init__(self, frame: pl.DataFrame) -> None:
        """Pick the rows of the case."""
        super().__init__(frame, "a")
        self.time, self.tool = self.trace.time, self.trace.tool_velocity
        # at t = 0 the preload presses the slider a little into its stop; the trace counts from there
        start = MECHANISM.front_stop + float(MECHANISM.force(MECHANISM.front_stop)) / MECHANISM.stop_stiffness
        self.x = x = start + self.trace.tool_position - self.trace.flange_position  # m, from the alignment
        passed = np.flatnonzero((x[:-1] > 0.0) & (x[1:] <= 0.0))
        self.snap = float(self.time[passed[0] + 1]) if passed.size else np.inf  # s, when it first passes that
        self.touch = int(np.argmax(self.contact > 0))  # point of the trace
        self.first_phase = (self.time >= self.time[self.touch]) & (self.time < self.snap)
        self.slowed = int(np.argmax(self.first_phase & (self.tool <= 0.4)))  # point of the trace

    @property
    def plateau(self) -> float:
        """Velocity of the tool where it changes least between 0.4 m/s and the alignment, m/s."""
        distinct = np.append(np.diff(self.time) > 0.0, False)  # events are in it twice
        steady = self.first_phase & (self.time >= self.time[self.slowed]) & distinct
        rate = np.abs(np.diff(self.tool)[steady[:-1]] / np.diff(self.time)[steady[:-1]])
        return float(self.tool[steady][np.argmin(rate)])


def _plot_23(frame: pl.DataFrame) -> Figure:
    figure = velocities_and_forces(frame, titles=TITLES, window=(0.25, 0.6))
    top, bottom = figure.axes[0], figure.axes[2]
    placing: dict[str, Any] = {"xytext": (-6, 0), "textcoords": "offset points", "ha": "right", "fontsize": 8}
    snap = SliderRun(frame).snap
    top.axvline(snap, color=COUPLING, linestyle=":", linewidth=1.0)
    top.annotate("slider passes\nthe alignment", (snap, -0.25), **placing)
    bistable, linear = (Run(frame, case).trace for case in TITLES)
    highest = 1.15 * max(bistable.contact_force.max(), linear.contact_force.max())
    bottom.set_ylim(-3.0, highest)  # shared with (d)
    strongest = int(np.argmax(bistable.coupling_force))
    text = f"rear stop, up to {bistable.coupling_force[strongest]:.0f} N"
    bottom.annotate(text, (bistable.time[strongest], 0.8 * highest), **placing)
    return figure


def _numbers_23(frame: pl.DataFrame) -> Numbers:
    run, linear = SliderRun(frame), Run(frame, "b")
    time, tool, x, snap, trace = run.time, run.tool, run.x, run.snap, run.trace
    at_stop = int(np.argmax((time > snap) & (x <= MECHANISM.rear_stop)))
    ahead = np.abs(tool - trace.flange_velocity)
    gap = (trace.object_position - trace.tool_position)[np.flatnonzero(run.contact)[-1] + 1 :]
    moving_back = trace.coupling_force[(run.contact > 0) & (x < MECHANISM.front_stop) & (x > 0.0)]
    fall, tool_felt = time[run.slowed] - time[run.touch], run.felt_contact.tool_velocity[-1]
    return {
        "lag": ahead[: run.touch].max(),
        "struck_with": tool[run.touch], "plateau": run.plateau,
        "fall": 1e3 * fall, "fall_rate": 0.6 / fall, "fall_over_brake": 0.6 / fall / MOTION.deceleration,
        "share": 100 * trace.object_velocity[run.slowed] / run.final_velocity,
        "tool_felt": tool_felt, "tool_felt_from_04": abs(tool_felt - 0.4),
        "change": np.ptp(tool[run.first_phase & (time >= time[run.slowed])]), "snap": snap,
        "loss": run.plateau - tool[(time > snap) & (time < time[at_stop])].min(initial=np.inf),
        "at_stop": at_stop, "stop_time": time[at_stop], "difference": ahead[time > time[at_stop] + 0.02].max(),
        "from_stop": np.abs(x[time > time[-1] - 0.5] - MECHANISM.rear_stop), "x_last": 1e3 * x[-1],
        "largest": run.during_contact.coupling_force.max(),
        "largest_linear": linear.during_contact.coupling_force.max(),
        "force_steps": np.diff(moving_back), "force_ends": moving_back[[0, -1]],
        "contacts": run.contacts, "gap": gap, "gap_last": gap[-1],
        "bistable": run.final_velocity, "linear": linear.final_velocity,
    }  # fmt: skip


def _numbers_24(frame: pl.DataFrame) -> Numbers:
    a, b = (Run(frame, case) for case in "ab")
    identity = max(abs(run.equation_22() / run.final_velocity - 1.0) for run in (a, b))
    return {"impulse_a": a.impulse, "impulse_b": b.impulse, "identity": identity}


def figure_25() -> pl.DataFrame:
    """Simulate the tool fixed to the robot, and behind the mechanism."""
    return histories({"rigid": scene(1e3, 0.1), "bistable": scene(1e3, 0.1, MECHANISM)})


@panels(7.0, 4.0)
def _plot_25(frame: pl.DataFrame, axes: Panels) -> None:
    velocities(axes, Run(frame, "rigid").trace)
    bistable = Run(frame, "bistable").trace
    axes.plot(bistable.time, bistable.object_velocity, color=OBJECT, linestyle=":", label="object, Fig. 23a")
    axes.set_xlim(0.25, 0.75)
    axes.legend(loc="center right", bbox_to_anchor=(1.0, 0.66))


def _numbers_25(frame: pl.DataFrame) -> Numbers:
    fixed, bistable = (Run(frame, case).final_velocity for case in ("rigid", "bistable"))
    return {"fixed": fixed, "bistable": bistable, "reduction": 100.0 * (1.0 - bistable / fixed)}


FIGURES = {
    "figure_22": Reproduction(figure_22, _plot_22, _numbers_22),
    "figure_23": Reproduction(figure_23, _plot_23, _numbers_23),
    "figure_24": Reproduction(figure_23, partial(impulses, titles=IMPULSES), _numbers_24),  # the same two runs
    "figure_25": Reproduction(figure_25, _plot_25, _numbers_25),
}
