"""Fig. 23: velocities and forces, bistable mechanism (a, c) and linear spring-damper (b, d); e = 0.1, k_c = 1e3."""

from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.lab.charts import COUPLING
from experiments.paper.layouts import velocities_and_forces
from experiments.paper.scenes import LINEAR, MECHANISM, MOTION, scene
from experiments.paper.statements import Statements, section_5
from experiments.paper.tables import FELT, Run, Table, histories

TITLE = "End-effector with bistable mechanism and with linear spring-damper"
ALT = """Two columns, velocities above and forces below, against time. Left, bistable: the tool falls from 1.0 to 0.4
m/s, crosses the alignment and is pulled back to the flange; the object leaves at 0.45 m/s. Right, linear: 0.69 m/s."""
CASES = {"a": "(a, c) bistable mechanism", "b": "(b, d) linear spring-damper"}

compute = partial(histories, {"a": scene(1e3, 0.1, MECHANISM), "b": scene(1e3, 0.1, LINEAR)})


class SliderRun(Run):
    """Case (a) of the table, with what its slider does."""

    def __init__(self, table: Table) -> None:
        """Pick the rows of the case."""
        super().__init__(table, "a")
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


def plot(table: Table) -> Figure:
    figure = velocities_and_forces(table, titles=CASES, window=(0.25, 0.6))
    top, bottom = figure.axes[0], figure.axes[2]
    placing: dict[str, Any] = {"xytext": (-6, 0), "textcoords": "offset points", "ha": "right", "fontsize": 8}
    snap = SliderRun(table).snap
    top.axvline(snap, color=COUPLING, linestyle=":", linewidth=1.0)
    top.annotate("slider passes\nthe alignment", (snap, -0.25), **placing)
    bistable, linear = (Run(table, case).trace for case in CASES)
    highest = 1.15 * max(bistable.contact_force.max(), linear.contact_force.max())
    bottom.set_ylim(-3.0, highest)  # shared with (d)
    strongest = int(np.argmax(bistable.coupling_force))
    text = f"rear stop, up to {bistable.coupling_force[strongest]:.0f} N"
    bottom.annotate(text, (bistable.time[strongest], 0.8 * highest), **placing)
    return figure


def statements(table: Table) -> Statements:
    bistable, linear = SliderRun(table), Run(table, "b")
    yield from _collision(bistable)
    time, tool, x, snap = bistable.time, bistable.tool, bistable.x, bistable.snap
    change = np.ptp(tool[bistable.first_phase & (time >= time[bistable.slowed])])
    at_stop = int(np.argmax((time > snap) & (x <= MECHANISM.rear_stop)))
    loss = bistable.plateau - tool[(time > snap) & (time < time[at_stop])].min(initial=np.inf)
    settled = time > time[at_stop] + 0.02
    difference = np.abs(tool - bistable.trace.flange_velocity)[settled].max()
    yield section_5.claim(
        "When the velocity seems to stabilize, the tool crosses the vertical alignment and is pulled back",
        change < 0.05 and snap < np.inf and loss > 0.2,
        f"changes by {change:.3f} m/s from 0.4 m/s to the crossing at {snap:.4f} s, then by {loss:.2f} m/s",
        "by less than 0.05 m/s before the crossing, by more than 0.2 m/s between crossing and rear stop",
    )
    yield section_5.claim(
        "Then the tool velocity suddenly adapts to the robot velocity when the tool hits the robot flange",
        at_stop > 0 and difference < 0.05,
        f"hits the rear stop at {time[at_stop]:.4f} s; from 20 ms later on they differ by {difference:.3f} m/s at most",
        "within 0.05 m/s of the robot's from 20 ms after the rear stop on",
    )
    yield section_5.claim(
        "The tool is pulled back against the left constraint and is kept there by the elastic force",
        (np.abs(x[time > time[-1] - 0.5] - MECHANISM.rear_stop) < 1e-4).all(),
        f"at {1e3 * x[-1]:.2f} mm during the last half second",
        "within 0.1 mm of the rear stop from 0.5 s before the end of the run on",
    )
    largest, largest_linear = (run.during_contact.coupling_force.max() for run in (bistable, linear))
    moving_back = bistable.trace.coupling_force[(bistable.contact > 0) & (x < MECHANISM.front_stop) & (x > 0.0)]
    gap = bistable.trace.object_position - bistable.trace.tool_position
    gap_after = gap[np.flatnonzero(bistable.contact)[-1] + 1 :]
    yield section_5.claim(
        "The force of the bistable mechanism is lower than that of the linear spring-damper",
        largest < largest_linear,
        f"at most {largest:.2f} N against {largest_linear:.2f} N during the contact",
        "largest force during the contact in (a) below that in (b)",
    )
    yield section_5.claim(
        "The force generated in the bistable mechanism decreases when the end-effector is compressed",
        (np.diff(moving_back) < 0.0).all(),
        f"from {moving_back[0]:.2f} N to {moving_back[-1]:.2f} N",
        "falls from each point to the next while the slider moves from the front stop to the alignment",
    )
    yield section_5.claim(
        "The tool is separated from the object after the collision",
        bistable.contacts == 1 and (gap_after > -1e-9).all(),
        f"{bistable.contacts} contact; {gap_after[-1]:.2f} m apart at the end of the run",
        "one contact, and the faces never meet again",
    )
    yield section_5.claim(
        "The bistable mechanism gives a lower final velocity of the object than the linear spring-damper",
        bistable.final_velocity < linear.final_velocity,
        f"{bistable.final_velocity:.5f} m/s against {linear.final_velocity:.6f} m/s",
        "V_p in (a) below that in (b)",
    )


def _collision(run: SliderRun) -> Statements:
    """Compare what the text says up to the passage of the alignment."""
    lag = np.abs(run.tool - run.trace.flange_velocity)[: run.touch].max()
    fall = run.time[run.slowed] - run.time[run.touch]
    share = run.trace.object_velocity[run.slowed] / run.final_velocity
    tool_after = run.felt_contact.tool_velocity[-1]
    yield section_5.identified.claim(
        "The tool follows the movement of the robot during the acceleration phase, without oscillating",
        lag < 0.01,
        f"the velocities differ by {lag:.1g} m/s at most until the impact",
        "by less than 1 % of 1 m/s until the impact",
        why="The front stop and the acceleration, both identified, let the preload outweigh the tool's inertia.",
    )
    yield section_5.given.number(
        "The velocity of the tool changes from 1.0 m/s ...",
        "1.0 m/s",
        run.tool[run.touch],
        why="The speed is an input.",
    )
    yield section_5.number(
        "... to 0.4 m/s",
        "0.4 m/s",
        run.plateau,
        why="Where the velocity changes least between the impact and the snap-through.",
    )
    yield section_5.claim(
        "The tool is subjected to a hard deceleration: its velocity changes nearly instantaneously",
        0.6 / fall > 2.0 * MOTION.deceleration,
        f"from 1.0 to 0.4 m/s in {1e3 * fall:.1f} ms, {0.6 / fall:.0f} m/s^2 on average",
        "more than twice the deceleration of the robot",
    )
    yield section_5.claim(
        "When the tool reaches 0.4 m/s, the effect of the collision is complete",
        share > 0.95,
        f"the object has {100 * share:.0f} % of its final velocity by then",
        "at least 95 % of V_p at that instant",
        why="The surface is still recovering: at e = 0.1 the contact force has a long tail, which brings the rest.",
    ).read_as(
        FELT, abs(tool_after - 0.4) <= 0.05, f"when it ends the tool has {tool_after:.3f} m/s, 0.4 to the digit printed"
    )
