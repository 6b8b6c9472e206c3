"""Fig. 17: velocities and forces for two contact stiffnesses; k_t = 150 N/m, zeta = 1, e = 1."""

import numpy as np
from matplotlib.figure import Figure

from experiments.paper import impulse
from experiments.paper import time_history as history
from experiments.paper.scenes import DURATION, MOTION, TOOL_MASS, decoupled
from experiments.paper.statements import Statement, claim
from experiments.paper.tables import Table, histories

TITLE = "Velocities and forces for two contact stiffnesses, e = 1"
ALT = (
    "Two columns, velocities above and forces below, against time. Left, the stiff contact: two short force peaks, the "
    "object leaves at 0.90 m/s. Right, the softer contact: one longer force peak, the object leaves at 0.94 m/s."
)
CASES = {"a": "(a, c) k_c = $10^5$ N/m$^{1.5}$", "b": "(b, d) k_c = $10^4$ N/m$^{1.5}$"}


def compute() -> Table:
    """Simulate both cases."""
    return histories({"a": decoupled(1e5, 1.0, 150.0), "b": decoupled(1e4, 1.0, 150.0)}, MOTION, DURATION)


def plot(table: Table) -> Figure:
    """Draw both cases side by side."""
    return history.draw(table, CASES, window=(0.25, 0.75))


def statements(table: Table) -> tuple[Statement, ...]:
    """Compare with section 4.2."""
    excess = history.before_contact(table, "a", "tool_velocity") - history.before_contact(table, "a", "flange_velocity")
    time = history.before_contact(table, "a", "time")
    steady = excess[time > MOTION.speed / MOTION.acceleration]
    share = float(np.mean(steady > 0.0))  # the trace has a point a millisecond in flight
    stretch = history.before_contact(table, "a", "tool_position") - history.before_contact(
        table, "a", "flange_position"
    )
    slower = {case: history.deceleration(table, case, TOOL_MASS) for case in CASES}
    peaks = {case: history.force_peaks(table, case) for case in CASES}
    parting = {case: impulse.parting_over_approach(table, case) for case in CASES}
    velocity = {case: history.final_velocity(table, case) for case in CASES}
    return (
        claim(
            "4.2",
            "The end-effector is compressed by the inertia force during the acceleration of the robot",
            bool(stretch.min() < 0.0 and stretch.max() <= 1e-12),
            f"by up to {-1e3 * stretch.min():.2f} mm",
            "the tool lags behind the flange, and never runs ahead of it before the impact",
        ),
        claim(
            "4.2",
            "The velocity of the tool is slightly higher than the robot velocity when the latter is constant",
            share > 0.95 and steady[-1] > 0.0 and steady.max() < 0.1,
            f"higher during {100 * share:.0f} % of that time, by {steady.max():.3f} m/s at most, by {steady[-1]:.4f} "
            "m/s "
            "at the impact",
            "higher during at least 95 % of the time from the acceleration to the impact, by less than a tenth",
        ),
        claim(
            "4.2",
            "Fig. 17c highlights two clear peaks in the contact force: multiple impacts",
            peaks["a"] == 2 and history.contacts(table, "a") == 2,
            f"{peaks['a']} peaks in {history.contacts(table, 'a')} contacts",
            "two peaks above a tenth of the highest, in two contacts",
            fitted=True,
        ),
        claim(
            "4.2",
            "At k_c = 1e4 (Fig. 17d) there is a single contact (implied: two peaks are remarked on in 17c only)",
            peaks["b"] == 1 and history.contacts(table, "b") == 1,
            f"{peaks['b']} peak in {history.contacts(table, 'b')} contact",
            "one peak above a tenth of the highest, in one contact",
            fitted=True,
        ),
        claim(
            "4.2",
            "The increase in contact stiffness increases the deceleration of the tool",
            slower["a"] > slower["b"],
            f"{slower['a']:.0f} m/s^2 against {slower['b']:.0f} m/s^2",
            "largest deceleration in (a) above that in (b)",
        ),
        claim(
            "4.2",
            "An increase in k_c leads to a decrease in V_p (e = 1)",
            velocity["a"] < velocity["b"],
            f"{velocity['a']:.4f} m/s at 1e5, {velocity['b']:.4f} m/s at 1e4",
            "V_p in (a) below that in (b)",
        ),
        claim(
            "4.2",
            "Since e = 1, the relative velocity before and after the impact are equal",
            max(abs(ratio - 1.0) for ratio in parting.values()) < 0.05,
            f"after over before: {parting['a']:.4f} in the first contact of (a), {parting['b']:.4f} in (b)",
            "equal within 5 %, in both cases",
            why="Eq. 1 is about two bodies left to themselves. Here the compressed coupling pushes the tool after "
            "the object "
            "while they touch, the more the longer the contact lasts. Eq. 22, which puts eq. 1 into eq. 20, inherits "
            "this.",
        ),
    )
