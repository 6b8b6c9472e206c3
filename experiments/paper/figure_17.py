"""Fig. 17: velocities and forces for two contact stiffnesses; k_t = 150 N/m, zeta = 1, e = 1."""

from functools import partial

import numpy as np

from experiments.paper.layouts import velocities_and_forces
from experiments.paper.scenes import MOTION, decoupled
from experiments.paper.statements import Statements, section_4_2
from experiments.paper.tables import Run, Table, histories

TITLE = "Velocities and forces for two contact stiffnesses, e = 1"
ALT = """Two columns, velocities above and forces below, against time. Left, the stiff contact: two short force peaks,
the object leaves at 0.90 m/s. Right, the softer contact: one longer force peak, the object leaves at 0.94 m/s."""
CASES = {"a": "(a, c) k_c = $10^5$ N/m$^{1.5}$", "b": "(b, d) k_c = $10^4$ N/m$^{1.5}$"}

compute = partial(histories, {"a": decoupled(1e5, 1.0, 150.0), "b": decoupled(1e4, 1.0, 150.0)})
plot = partial(velocities_and_forces, titles=CASES, window=(0.25, 0.75))


def statements(table: Table) -> Statements:
    a, b = (Run(table, case) for case in CASES)
    before = a.before_contact
    stretch = before.tool_position - before.flange_position
    steady = (before.tool_velocity - before.flange_velocity)[before.time > MOTION.speed / MOTION.acceleration]
    share = np.mean(steady > 0.0)  # the trace has a point a millisecond in flight
    yield section_4_2.claim(
        "The end-effector is compressed by the inertia force during the acceleration of the robot",
        stretch.min() < 0.0 and stretch.max() <= 1e-12,
        f"by up to {-1e3 * stretch.min():.2f} mm",
        "the tool lags behind the flange, and never runs ahead of it before the impact",
    )
    yield section_4_2.claim(
        "The velocity of the tool is slightly higher than the robot velocity when the latter is constant",
        share > 0.95 and steady[-1] > 0.0 and steady.max() < 0.1,
        f"higher during {100 * share:.0f} % of that time, by {steady.max():.3f} m/s at most, by {steady[-1]:.4f} m/s "
        "at the impact",
        "higher during at least 95 % of the time from the acceleration to the impact, by less than a tenth",
    )
    yield from _two_contact_stiffnesses(a, b)
    yield section_4_2.claim(
        "Since e = 1, the relative velocity before and after the impact are equal",
        max(abs(run.restitution - 1.0) for run in (a, b)) < 0.05,
        f"after over before: {a.restitution:.4f} in the first contact of (a), {b.restitution:.4f} in (b)",
        "equal within 5 %, in both cases",
        why="Eq. 1 is about two bodies left to themselves. Here the compressed coupling pushes the tool after the "
        "object while they touch, the more the longer the contact lasts. Eq. 22, which puts eq. 1 into eq. 20, "
        "inherits this.",
    )


def _two_contact_stiffnesses(a: Run, b: Run) -> Statements:
    contacts = a.first_contact, b.first_contact
    compressions = [trace.flange_position - trace.tool_position for trace in contacts]
    reached = [
        np.interp(a.duration_of_contact, trace.time - trace.time[0], compression)
        for trace, compression in zip(contacts, compressions, strict=True)
    ]
    yield section_4_2.identified.claim(
        "Fig. 17c highlights two clear peaks in the contact force: multiple impacts",
        a.force_peaks == 2 and a.contacts == 2,
        f"{a.force_peaks} peaks in {a.contacts} contacts",
        "two peaks above a tenth of the highest, in two contacts",
    )
    yield section_4_2.identified.claim(
        "At k_c = 1e4 (Fig. 17d) there is a single contact (implied: two peaks are remarked on in 17c only)",
        b.force_peaks == 1 and b.contacts == 1,
        f"{b.force_peaks} peak in {b.contacts} contact",
        "one peak above a tenth of the highest, in one contact",
    )
    yield section_4_2.claim(
        "The increase in contact stiffness increases the deceleration of the tool",
        a.deceleration > b.deceleration,
        f"{a.deceleration:.0f} m/s^2 against {b.deceleration:.0f} m/s^2",
        "largest deceleration in (a) above that in (b)",
    )
    yield section_4_2.claim(
        "An increase in k_c produces an increase in the contact force",
        a.trace.contact_force.max() > b.trace.contact_force.max(),
        f"up to {a.trace.contact_force.max():.1f} N in (a), {b.trace.contact_force.max():.1f} N in (b)",
        "largest contact force in (a) above that in (b)",
    )
    yield section_4_2.claim(
        "... which generates a large compression of the decoupling system, which moves backwards",
        compressions[0].max() > compressions[1].max(),
        f"at most {1e3 * compressions[0].max():.1f} mm in (a), {1e3 * compressions[1].max():.1f} mm in (b)",
        "largest compression during the first contact in (a) above that in (b)",
        why="The stiffer contact throws the tool back faster, and is over sooner.",
    ).read_as(
        "the compression that the contact has brought about when the shorter one ends, equally long after the touch",
        reached[0] > reached[1],
        f"{1e3 * reached[0]:.1f} mm in (a), {1e3 * reached[1]:.1f} mm in (b), {1e3 * a.duration_of_contact:.1f} ms on",
    )
    yield section_4_2.repeated.claim(
        "An increase in k_c leads to a decrease in V_p (e = 1)",
        a.final_velocity < b.final_velocity,
        f"{a.final_velocity:.4f} m/s at 1e5, {b.final_velocity:.4f} m/s at 1e4",
        "V_p in (a) below that in (b)",
    )
