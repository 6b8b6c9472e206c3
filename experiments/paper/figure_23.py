"""Fig. 23: velocities and forces, bistable mechanism (a, c) and linear spring-damper (b, d); e = 0.1, k_c = 1e3."""

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from experiments.lab.charts import COUPLING
from experiments.paper import time_history as history
from experiments.paper.scenes import DURATION, LINEAR, MECHANISM, MOTION, held
from experiments.paper.statements import Statement, claim, number
from experiments.paper.tables import Table, contact_of, histories, trace_of

TITLE = "End-effector with bistable mechanism and with linear spring-damper"
ALT = (
    "Two columns, velocities above and forces below, against time. Left, bistable: the tool falls from 1.0 to 0.4 m/s, "
    "crosses the alignment and is pulled back to the flange; the object leaves at 0.45 m/s. Right, linear: 0.69 m/s."
)
CASES = {"a": "(a, c) bistable mechanism", "b": "(b, d) linear spring-damper"}
STIFFNESS, RESTITUTION = 1e3, 0.1


def compute() -> Table:
    """Simulate both end-effectors."""
    couplings = {"a": MECHANISM, "b": LINEAR}
    scenes = {case: held(coupling, STIFFNESS, RESTITUTION) for case, coupling in couplings.items()}
    return histories(scenes, MOTION, DURATION)


def slider(table: Table) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return time (s) and the slider's position from the alignment (m) in case (a)."""
    trace = trace_of(table, "a")
    # at t = 0 the preload presses the slider a little into its stop; the trace counts from there
    start = MECHANISM.front_stop + float(MECHANISM.force(MECHANISM.front_stop)) / MECHANISM.stop_stiffness
    return trace.time, start + trace.tool_position - trace.flange_position


def snap(table: Table) -> float:
    """Return when the slider first passes the alignment, s; infinite if it never does."""
    time, x = slider(table)
    passed = np.flatnonzero((x[:-1] > 0.0) & (x[1:] <= 0.0))
    return float(time[passed[0] + 1]) if passed.size else np.inf


def plot(table: Table) -> Figure:
    """Draw both cases side by side."""
    figure = history.draw(table, CASES, window=(0.25, 0.6))
    top, bottom = figure.axes[0], figure.axes[2]
    top.axvline(snap(table), color=COUPLING, linestyle=":", linewidth=1.0)
    top.annotate(
        "slider passes\nthe alignment",
        (snap(table), -0.25),
        (-6, 0),
        textcoords="offset points",
        ha="right",
        fontsize=8,
    )
    highest = 1.15 * float(max(trace_of(table, case).contact_force.max() for case in CASES))
    bottom.set_ylim(-3.0, highest)  # shared with (d)
    bistable = trace_of(table, "a")
    strongest = int(np.argmax(bistable.coupling_force))
    place = (float(bistable.time[strongest]), 0.8 * highest)
    text = f"rear stop, up to {bistable.coupling_force[strongest]:.0f} N"
    bottom.annotate(text, place, (-6, 0), textcoords="offset points", ha="right", fontsize=8)
    return figure


def statements(table: Table) -> tuple[Statement, ...]:
    """Compare with section 5."""
    trace = trace_of(table, "a")
    time, x = slider(table)
    tool, snapped = trace.tool_velocity, snap(table)
    apart = np.abs(tool - trace.flange_velocity)
    touch = int(np.argmax(contact_of(table, "a") > 0))
    lag = float(apart[:touch].max())
    first_phase = (time >= time[touch]) & (time < snapped)
    slowed = int(np.argmax(first_phase & (tool <= 0.4)))
    steady = first_phase & (time >= time[slowed]) & np.append(np.diff(time) > 0.0, False)  # events are in it twice
    rate = np.abs(np.diff(tool)[steady[:-1]] / np.diff(time)[steady[:-1]])
    plateau = float(tool[steady][np.argmin(rate)])
    fall = float(time[slowed] - time[touch])
    share = float(trace.object_velocity[slowed] / trace.object_velocity[-1])
    change = float(np.ptp(tool[first_phase & (time >= time[slowed])]))
    at_stop = int(np.argmax((time > snapped) & (x <= MECHANISM.rear_stop)))
    loss = plateau - float(tool[(time > snapped) & (time < time[at_stop])].min(initial=np.inf))
    caught = float(apart[time > time[at_stop] + 0.02].max())
    forces = [history.during_contact(table, case, "coupling_force") for case in CASES]
    moving_back = (contact_of(table, "a") > 0) & (x < MECHANISM.front_stop) & (x > 0.0)
    steps = np.diff(trace.coupling_force[moving_back])
    gap = trace.object_position - trace.tool_position
    after = gap[np.flatnonzero(contact_of(table, "a"))[-1] + 1 :]
    velocity = {case: history.final_velocity(table, case) for case in CASES}
    return (
        claim(
            "5",
            "The tool follows the movement of the robot during the acceleration phase, without oscillating",
            lag < 0.01,
            f"the velocities differ by {lag:.1g} m/s at most until the impact",
            "by less than 1 % of 1 m/s until the impact",
            fitted=True,
            why="The front stop and the acceleration, both identified, let the preload outweigh the tool's inertia.",
        ),
        number(
            "5",
            "The velocity of the tool changes from 1.0 m/s ...",
            "1.0",
            float(tool[touch]),
            "m/s",
            why="The speed is an input.",
        ),
        number(
            "5",
            "... to 0.4 m/s",
            "0.4",
            plateau,
            "m/s",
            why="Where the velocity changes least between the impact and the snap-through.",
        ),
        claim(
            "5",
            "The tool is subjected to a hard deceleration: its velocity changes nearly instantaneously",
            0.6 / fall > 2.0 * MOTION.deceleration,
            f"from 1.0 to 0.4 m/s in {1e3 * fall:.1f} ms, {0.6 / fall:.0f} m/s^2 on average",
            "more than twice the deceleration of the robot",
        ),
        claim(
            "5",
            "When the tool reaches 0.4 m/s, the effect of the collision is complete",
            share > 0.95,
            f"the object has {100 * share:.0f} % of its final velocity by then",
            "at least 95 % of V_p at that instant",
            why="The surface is still recovering: at e = 0.1 the contact force has a long tail, which brings the rest.",
        ),
        claim(
            "5",
            "When the velocity seems to stabilize, the tool crosses the vertical alignment and is pulled back",
            change < 0.05 and snapped < np.inf and loss > 0.2,
            f"changes by {change:.3f} m/s from 0.4 m/s to the crossing at {snapped:.4f} s, then by {loss:.2f} m/s",
            "by less than 0.05 m/s before the crossing, by more than 0.2 m/s between crossing and rear stop",
        ),
        claim(
            "5",
            "Then the tool velocity suddenly adapts to the robot velocity when the tool hits the robot flange",
            at_stop > 0 and caught < 0.05,
            f"hits the rear stop at {time[at_stop]:.4f} s; from 20 ms later on they differ by {caught:.3f} m/s at most",
            "within 0.05 m/s of the robot's from 20 ms after the rear stop on",
        ),
        claim(
            "5",
            "The tool is pulled back against the left constraint and is kept there by the elastic force",
            bool((np.abs(x[time > time[-1] - 0.5] - MECHANISM.rear_stop) < 1e-4).all()),
            f"at {1e3 * x[-1]:.2f} mm during the last half second",
            "within 0.1 mm of the rear stop from 0.5 s before the end of the run on",
        ),
        claim(
            "5",
            "The force of the bistable mechanism is lower than that of the linear spring-damper",
            float(forces[0].max()) < float(forces[1].max()),
            f"at most {forces[0].max():.2f} N against {forces[1].max():.2f} N during the contact",
            "largest force during the contact in (a) below that in (b)",
        ),
        claim(
            "5",
            "The force generated in the bistable mechanism decreases when the end-effector is compressed",
            bool((steps < 0.0).all()),
            f"from {trace.coupling_force[moving_back][0]:.2f} N to {trace.coupling_force[moving_back][-1]:.2f} N",
            "falls from each point to the next while the slider moves from the front stop to the alignment",
        ),
        claim(
            "5",
            "The tool is separated from the object after the collision",
            history.contacts(table, "a") == 1 and bool((after > -1e-9).all()),
            f"{history.contacts(table, 'a')} contact; {after[-1]:.2f} m apart at the end of the run",
            "one contact, and the faces never meet again",
        ),
        claim(
            "5",
            "The bistable mechanism gives a lower final velocity of the object than the linear spring-damper",
            velocity["a"] < velocity["b"],
            f"{velocity['a']:.5f} m/s against {velocity['b']:.6f} m/s",
            "V_p in (a) below that in (b)",
        ),
    )
