"""Section 2.2, contacts that take time, and section 3, the compliant robot: Fig. 6, 13 and 14.

In section 2.2 the tool approaches at 1 m/s without a brake. In case (a) it is fixed to the robot, in case (b) it is
free. Penetration and force of case (b) are those of a fixed tool and an object with the reduced mass of tool and
object. So case (b) is simulated with a fixed tool and this object.
"""

from collections.abc import Iterator
from copy import copy
from functools import partial
from itertools import product

import numpy as np
import polars as pl

import impact_gym as ig
from experiments.lab import scenes
from experiments.lab.scenes import CONSTANT_SPEED, MOTION, OBJECT_MASS, ROBOT, TOOL_MASS, scene
from experiments.lab.study import Row
from experiments.studies.paper.runs import PAPER, Array, Model, Run, histories, runs_of, two_runs, where
from experiments.studies.paper.statements import Figure, Finding
from impact_gym.physics import impact
from impact_gym.robot import Arm, default_approach

STIFFNESSES = (1e3, 1e4, 1e5, 1e6)  # N/m^1.5
VANISHING = (0.005, 0.01, 0.02)  # restitutions close to 0
RESTITUTIONS = np.round(np.arange(0.05, 1.0001, 0.025), 3).tolist()  # arguments of eq. 7
EXPONENTS = (1.0, 1.5, 2.0)  # n of eq. 5; m is 1.5
MASSES = (0.1, OBJECT_MASS, 2.5)  # kg, of the object
SMALL = np.round(np.arange(0.01, 0.3, 0.01), 2)  # small restitutions; the paper gives no number
FRICTION = 0.3  # coefficient of friction between object and plane; the paper gives no number


def figure_06(model: Model = PAPER) -> list[Row]:
    """Simulate contacts of the fixed and of the free tool for several contact stiffnesses and restitutions."""
    rows: list[Row] = []
    cases = {"a": OBJECT_MASS, "b": scenes.REDUCED_MASS}
    for (case, mass), k_c, e in product(cases.items(), STIFFNESSES, [*VANISHING, *RESTITUTIONS]):
        (contact,) = model.simulate(scene(k_c, e, object_mass=mass), CONSTANT_SPEED, duration=2.0).contacts
        assert contact.end is not None  # the contact ends during the run
        rows.append({
            "case": case, "contact_stiffness": k_c, "restitution": e, "peak_force": contact.peak_force,
            "duration": contact.end - contact.start, "object_velocity": contact.impulse / OBJECT_MASS,
            "parting": contact.separation_velocity / contact.approach_velocity,
        })  # fmt: skip
    return rows


def _statements_06(frame: pl.DataFrame) -> Iterator[Finding]:
    grid = frame.filter(pl.col("restitution") >= RESTITUTIONS[0])
    force = where(grid, case="a", contact_stiffness=1e5)["peak_force"]
    lowest = int(np.argmin(force))
    yield Finding("force", (np.diff(force) < 0).all(),
        f"{force[-1]:.1f} N at e = 1, {force[lowest]:.1f} N at {RESTITUTIONS[lowest]:g}, {force[0]:.1f} N at 0.05"
    )  # fmt: skip
    durations = np.array([where(grid, case=case, contact_stiffness=k_c)["duration"]
                          for case, k_c in product("ab", STIFFNESSES)])  # fmt: skip
    yield Finding("duration", (np.diff(durations) < 0).all(),
        f"{durations[0, 2] / durations[0, -1]:.2f} times as long at e = 0.1 as at e = 1")  # fmt: skip
    parting = where(frame.filter(pl.col("restitution") <= RESTITUTIONS[0]), case="b", contact_stiffness=1e5)["parting"]
    yield Finding("together", (np.diff(parting) > 0).all() and parting[0] < 0.01,
        f"{parting[-1]:.3f} of the approach velocity at e = 0.05, {parting[0]:.4f} at e = 0.005")  # fmt: skip
    free = where(grid.filter(pl.col("restitution") >= 0.1), case="b", contact_stiffness=1e3)
    theory = impact.free_tool(TOOL_MASS, OBJECT_MASS, 1.0, 0.0, free["restitution"])[1]
    error = 100.0 * np.abs(free["object_velocity"] / theory - 1.0)
    yield Finding("instantaneous", error.max() < 5.0,
        f"eq. 4 is off by at most {error.max():.1f} % (at e = {free['restitution'][error.argmax()]:g})")  # fmt: skip


def _contact(model: Model, contact: ig.Contact, mass: float) -> Row:
    """Simulate one contact; return `chi` (eq. 5), and the force at its ends over the largest force."""
    approach = ig.Scene(ig.Tool(TOOL_MASS), ig.Object(mass, 0.25), contact)
    outcome, trace = model.trace(approach, CONSTANT_SPEED)
    (record,), used = outcome.contacts, model.scene(approach).contact
    depth, rate = trace.tool_position - trace.object_position, trace.tool_velocity - trace.object_velocity
    inside = (trace.contact_force > 0.0) & (depth > 0.0) & (trace.time >= record.start)
    force, depth, rate = (column[inside] for column in (trace.contact_force, depth, rate))
    elastic, path = used.stiffness * depth**used.stiffness_exponent, depth**used.damping_exponent * rate
    chi = (force - elastic)[path.argmax()] / path.max()
    return {"n": contact.damping_exponent, "chi": chi, "ends": max(force[0], elastic[-1]) / force.max()}


def beyond_contact(model: Model = PAPER) -> list[Row]:
    """Simulate the linear contact, that of the paper, and other exponents n with several masses."""
    linear = ig.Contact(5e3, 0.5, "exact", stiffness_exponent=1.0, damping_exponent=0.0)
    cases = [("linear", PAPER, linear, OBJECT_MASS), ("paper", model, ig.Contact(1e5, 0.5), OBJECT_MASS)]
    others = ((ig.Contact(1e5, 0.5, "exact", damping_exponent=n), mass) for n, mass in product(EXPONENTS, MASSES))
    cases += [("exponents", model, contact, mass) for contact, mass in others]
    return [{"case": case, **_contact(used, contact, mass)} for case, used, contact, mass in cases]


def laws(model: Model = PAPER) -> pl.DataFrame:
    """Evaluate the restitution that eq. 7 and the law of Hunt and Crossley deliver, at small nominal restitutions."""
    used = model.scene(scene(1e5, 0.5)).contact.dissipation
    errors = [np.abs(ig.effective_restitution(law, SMALL) - SMALL) for law in (used, "hunt-crossley")]
    return pl.DataFrame({"equation_7": errors[0], "earlier": errors[1]})


def _statements_contact(frame: pl.DataFrame) -> Iterator[Finding]:
    ends = frame["ends"]
    yield Finding("overcomes", ends[1] < 1e-3,
        f"at most {ends[1]:.0e} of the largest force; with the linear contact {ends[0]:.2f}")  # fmt: skip
    chi = {n: where(frame, case="exponents", n=n)["chi"] for n in EXPONENTS}
    spread = {n: values.max() / values.min() - 1.0 for n, values in chi.items()}
    yield Finding("exponents", spread[1.5] < 1e-6 and min(spread[1.0], spread[2.0]) > 0.1,
        f"from 0.1 to 2.5 kg chi varies by {100 * spread[1.0]:.0f} % with n = 1, by {100 * spread[1.5]:.4f} % "
        f"with n = m = 1.5, by {100 * spread[2.0]:.0f} % with n = 2")  # fmt: skip


def _statements_laws(frame: pl.DataFrame) -> Iterator[Finding]:
    ours, earlier = frame["equation_7"].to_numpy(), frame["earlier"].to_numpy()
    yield Finding("equation_7", (ours < earlier).all() and ours.max() < 0.05,
        f"eq. 7 is off by at most {ours.max():.3f}, Hunt and Crossley by up to {earlier.max():.2f}")  # fmt: skip


class _Slow(Arm):
    """An arm without centrifugal and Coriolis forces, as in eq. 11."""

    def move(self, angles: Array, rates: Array) -> tuple[Array, Array]:
        """Set the joint angles, and rates of 0."""
        return super().move(angles, 0.0 * rates)


def beyond_joints(model: Model = PAPER) -> list[Row]:
    """Simulate Fig. 13b with all six joints (eq. 10), without weight, and without centrifugal and Coriolis forces."""
    from impact_gym.robot import all_joints, viper  # here, because they need MuJoCo

    approach, motion = model.scene(scene(1e5, 1.0)), model.motion(MOTION)
    arm = viper.viper()
    slow = copy(arm)
    slow.__class__ = _Slow
    hits = (all_joints.simulate(used, default_approach(), approach, motion, duration=0.6, gravity=gravity)
            for used, gravity in ((arm, True), (arm, False), (slow, True)))  # fmt: skip
    return [{"object_velocity": hit.object_velocity} for hit in hits]


def _statements_joints(frame: pl.DataFrame) -> Iterator[Finding]:
    every, *without = frame["object_velocity"].to_list()
    weight, coriolis = (abs(velocity - every) for velocity in without)
    yield Finding("negligible", max(weight, coriolis) < 0.005,
        f"with all six joints V_p is {every:.4f} m/s; without weight it changes by {weight:.4f} m/s, without "
        f"centrifugal and Coriolis forces by {coriolis:.4f} m/s")  # fmt: skip


def figure_13(model: Model = PAPER) -> pl.DataFrame:
    """Simulate Fig. 13a and 13b, each also with friction between object and plane."""
    cases = {}
    for case, robot in (("a", None), ("b", ROBOT)):
        cases[case] = smooth = scene(1e5, 1.0, robot=robot)
        rough = ig.Object(OBJECT_MASS, smooth.object.distance, FRICTION)
        cases[f"{case}, friction"] = ig.Scene(smooth.tool, rough, smooth.contact, smooth.coupling, robot)
    return histories(model, cases)


def _statements_13(frame: pl.DataFrame) -> Iterator[Finding]:
    rigid, compliant = runs_of(frame)
    yield Finding("twice", abs(rigid.final_velocity - 2.0) <= 0.005, f"{rigid.final_velocity:.6f} m/s")
    time, command, ends = rigid.trace.time, rigid.trace.command_velocity, rigid.during_contact.time[-1]
    slower = (time > rigid.first_contact.time[0]) & (command < MOTION.speed)
    begins = time[slower][0] if slower.any() else np.inf
    yield Finding("brakes_after", begins > ends,
        f"the contact lasts {rigid.duration:.1f} ms, the last {1e3 * (ends - begins):.1f} ms with braking")  # fmt: skip
    without = [rigid.final_velocity, compliant.final_velocity]
    rough = [Run(frame, f"{case}, friction") for case in "ab"]
    left = [run.trace.object_velocity[run.contact == 1][-1] for run in rough]
    losses = 100.0 * (1.0 - np.divide(left, without))
    slide = impact.sliding_distance(left[0], FRICTION)
    yield Finding("friction", (losses > -1e-6).all() and (losses < 5.0).all(),
        f"the object leaves slower by {losses[0]:.2f} and {losses[1]:.2f} %, and slides {slide:.2f} m")  # fmt: skip


def figure_14(model: Model = PAPER) -> pl.DataFrame:
    """Simulate Fig. 14a and 14b with and without a brake, and Fig. 13b."""
    soft, stiff = (scene(k_c, 1.0, robot=ROBOT, object_mass=scenes.HEAVY_MASS) for k_c in (1e5, 1e6))
    braking = histories(model, {"a": soft, "b": stiff, "13b": scene(1e5, 1.0, robot=ROBOT)})
    return pl.concat([braking, histories(model, {"a, no brake": soft, "b, no brake": stiff}, CONSTANT_SPEED)])


def _ranges(run: Run) -> tuple[float, float]:
    """Return max - min of tool minus commanded velocity (m/s) for the 50 ms before and after the first contact."""
    relative, time = run.trace.tool_velocity - run.trace.command_velocity, run.trace.time
    start, end = run.first_contact.time[[0, -1]]
    before, after = (time > start - 0.05) & (time < start), (time > end) & (time < end + 0.05)
    return np.ptp(relative[before]), np.ptp(relative[after])


def _statements_14(frame: pl.DataFrame) -> Iterator[Finding]:
    a, b, light, *steady = (Run(frame, case) for case in ("a", "b", "13b", "a, no brake", "b, no brake"))
    yield Finding("impact_velocity", abs(a.impact_velocity - 0.95) <= 0.01,
        f"{a.impact_velocity:.4f} m/s, as in Fig. 13b")  # fmt: skip
    less = 100.0 * (1.0 - a.final_velocity / light.final_velocity)
    yield Finding("close", abs(less) < 5.0,
        f"{a.final_velocity:.4f} against {light.final_velocity:.4f} m/s, {less:.1f} % less")  # fmt: skip
    yields = [100.0 * run.deflection / run.way for run in (a, b)]
    yield Finding("does_not_deflect", yields[0] < 5.0,
        f"{a.deflection:.2f} mm, {yields[0]:.1f} % of the motion; in (b) {b.deflection:.2f} mm, {yields[1]:.0f} %"
    )  # fmt: skip
    lost = [run.impact_velocity - run.first_contact.tool_velocity.min() for run in (a, b, *steady)]
    yield Finding("deceleration", lost[1] > 0.25 * b.impact_velocity and lost[1] > 2.0 * lost[0],
        f"loses {lost[1]:.3f} m/s in (b), {lost[0]:.3f} m/s in (a)",
        reading=(lost[3] > 2.0 * lost[2], f"without a brake {lost[3]:.3f} m/s in (b), {lost[2]:.3f} m/s in (a)")
    )  # fmt: skip
    before, after = _ranges(b)
    yield Finding("vibration", after > 2.0 * before,
        f"range of the tool's velocity against the imposed one {before:.3f} m/s before, {after:.3f} m/s after"
    )  # fmt: skip
    yield Finding("slower", b.final_velocity < min(a.final_velocity, light.final_velocity) - 1e-9,
        f"{b.final_velocity:.4f} against {a.final_velocity:.4f} and {light.final_velocity:.4f} m/s")  # fmt: skip
    touching = b.first_contact
    energy = 0.5e3 * ROBOT.stiffness * (touching.command_position - touching.tool_position) ** 2  # mJ
    yield Finding("pushed", energy[-1] < 0.9 * energy.max(),
        f"it rises to {energy.max():.0f} mJ and falls to {energy[-1]:.0f} mJ when the object leaves")  # fmt: skip


FIGURES = (
    Figure(figure_06, _statements_06),
    Figure(beyond_contact, _statements_contact),
    Figure(laws, _statements_laws),
    Figure(beyond_joints, _statements_joints),
    Figure(figure_13, _statements_13, partial(
        two_runs, titles=("(a) rigid joints", "(b) compliant joints"), common="e = 1, k_c = 1e5", forces=False)),
    Figure(figure_14, _statements_14, partial(
        two_runs, titles=("(a) k_c = 1e5 N/m^1.5", "(b) k_c = 1e6 N/m^1.5"), forces=False,
        common="heavy object, 2.5 kg, and compliant joints; e = 1")),
)  # fmt: skip
