"""Section 3, the compliant robot (3.1 model, 3.2 impacts): Fig. 13 and 14."""

from collections.abc import Iterator
from copy import copy
from functools import partial

import numpy as np
import polars as pl

import impact_gym as ig
from experiments.lab.scenes import CONSTANT_SPEED, HEAVY_MASS, MOTION, OBJECT_MASS, ROBOT, scene
from experiments.lab.study import Row
from experiments.studies.paper.models import PAPER, Model
from experiments.studies.paper.runs import Array, Run, histories, runs_of, two_runs
from experiments.studies.paper.statements import Figure, Reading, Statement
from impact_gym.physics.impact import sliding_distance
from impact_gym.robot import Arm, default_approach

FRICTION = 0.3  # coefficient of friction between object and plane; the paper gives no number


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
    rows: list[Row] = []
    for used, gravity in ((arm, True), (arm, False), (slow, True)):
        blow = all_joints.simulate(used, default_approach(), approach, motion, duration=0.6, gravity=gravity)
        rows.append({"object_velocity": blow.object_velocity})
    return rows


def _statements_joints(frame: pl.DataFrame) -> Iterator[Statement]:
    every, *without = frame["object_velocity"].to_list()
    weight, coriolis = (abs(velocity - every) for velocity in without)
    yield Statement(
        "negligible", "eq. 11", "It is possible to neglect centrifugal and Coriolis forces and the effect of gravity",
        rule="without each of them, V_p of Fig. 13b changes by less than 0.005 m/s (printed: 1.94 m/s)",
        holds=max(weight, coriolis) < 0.005, wrong="tool 4 times as heavy",
        ours=f"with all six joints V_p is {every:.4f} m/s; without weight it changes by {weight:.4f} m/s, without "
        f"centrifugal and Coriolis forces by {coriolis:.4f} m/s")  # fmt: skip


def figure_13(model: Model = PAPER) -> pl.DataFrame:
    """Simulate Fig. 13a and 13b, each also with friction between object and plane."""
    cases = {}
    for case, robot in (("a", None), ("b", ROBOT)):
        cases[case] = smooth = scene(1e5, 1.0, robot=robot)
        rough = ig.Object(OBJECT_MASS, smooth.object.distance, FRICTION)
        cases[f"{case}, friction"] = ig.Scene(smooth.tool, rough, smooth.contact, smooth.coupling, robot)
    return histories(model, cases)


def _statements_13(frame: pl.DataFrame) -> Iterator[Statement]:
    rigid, compliant = runs_of(frame)
    yield Statement(
        "twice", "Fig. 13a", "The object velocity is exactly twice the approach velocity, 2 m/s",
        rule="2.00 m/s, as exact as the 1.94 m/s printed for Fig. 13b", holds=abs(rigid.final_velocity - 2.0) <= 0.005,
        ours=f"{rigid.final_velocity:.6f} m/s", wrong="e has no effect (0.1)")  # fmt: skip
    time, command, ends = rigid.trace.time, rigid.trace.command_velocity, rigid.during_contact.time[-1]
    slower = (time > rigid.first_contact.time[0]) & (command < MOTION.speed)
    begins = time[slower][0] if slower.any() else np.inf
    yield Statement(
        "brakes_after", "Fig. 13a", "The robot actuators start braking after the impact",
        rule="the contact is over when the braking begins", holds=bool(begins > ends),
        ours=f"the contact lasts {rigid.duration:.1f} ms, the last {1e3 * (ends - begins):.1f} ms with braking",
        why="The printed values alone give this: 3.218 (m_p v^2/k_c)^(2/5)/v is 18.5 ms, and the delay is 16 ms. The "
        "force is small by then, so V_p changes in the fifth digit only.",
        wrong="linear spring (m = 1)")  # fmt: skip
    without = [rigid.final_velocity, compliant.final_velocity]
    rough = [Run(frame, f"{case}, friction") for case in "ab"]
    left = [run.trace.object_velocity[run.contact == 1][-1] for run in rough]
    losses = 100.0 * (1.0 - np.divide(left, without))
    slide = sliding_distance(left[0], FRICTION)
    yield Statement(
        "friction", "Section 3.1",
        "Friction between object and plane is neglected; it may cause small (and beneficial) reductions in V_p",
        rule="with mu = 0.3 (ours), the object leaves slower by less than 5 %, in Fig. 13a and 13b",
        holds=bool((losses > -1e-6).all() and (losses < 5.0).all()), wrong="e has no effect (0.1)",
        ours=f"the object leaves slower by {losses[0]:.2f} and {losses[1]:.2f} %, and slides {slide:.2f} m",
        why="An elastic contact gives back what friction takes; a long, inelastic contact does not.")  # fmt: skip


def figure_14(model: Model = PAPER) -> pl.DataFrame:
    """Simulate Fig. 14a and 14b with and without a brake, and Fig. 13b."""
    soft, stiff = (scene(k_c, 1.0, robot=ROBOT, object_mass=HEAVY_MASS) for k_c in (1e5, 1e6))
    braking = histories(model, {"a": soft, "b": stiff, "13b": scene(1e5, 1.0, robot=ROBOT)})
    return pl.concat([braking, histories(model, {"a, no brake": soft, "b, no brake": stiff}, CONSTANT_SPEED)])


def _ranges(run: Run) -> tuple[float, float]:
    """Return max - min of tool minus commanded velocity (m/s) for the 50 ms before and after the first contact."""
    relative, time = run.trace.tool_velocity - run.trace.command_velocity, run.trace.time
    start, end = run.first_contact.time[[0, -1]]
    before, after = (time > start - 0.05) & (time < start), (time > end) & (time < end + 0.05)
    return np.ptp(relative[before]), np.ptp(relative[after])


def _statements_14(frame: pl.DataFrame) -> Iterator[Statement]:
    a, b, light, *steady = (Run(frame, case) for case in ("a", "b", "13b", "a, no brake", "b, no brake"))
    yield Statement(
        "impact_velocity", "Fig. 14a", "The impact velocity is about 0.95 m/s",
        rule="within one unit of the last digit, 0.01 m/s", holds=abs(a.impact_velocity - 0.95) <= 0.01,
        ours=f"{a.impact_velocity:.4f} m/s, as in Fig. 13b",
        why="For Fig. 13b the paper prints 0.98 m/s. Nothing before the impact depends on the object's mass, so only "
        "one velocity can be right. The robot's stiffness was identified with 0.98 m/s.",
        wrong="robot 10 times as soft")  # fmt: skip
    less = 100.0 * (1.0 - a.final_velocity / light.final_velocity)
    yield Statement(
        "close", "Fig. 14a",
        "The final velocity is very close to that in Fig. 13b, despite the difference in the masses of the objects",
        rule="within 5 %", holds=abs(less) < 5.0, wrong="robot 10 times as soft",
        ours=f"{a.final_velocity:.4f} against {light.final_velocity:.4f} m/s, {less:.1f} % less")  # fmt: skip
    yields = [100.0 * run.deflection / run.way for run in (a, b)]
    yield Statement(
        "does_not_deflect", "Fig. 14a", "The contact force is not able to significantly deflect the robot arm",
        rule="deflection below 5 % of the imposed motion during the contact", holds=yields[0] < 5.0,
        ours=f"{a.deflection:.2f} mm, {yields[0]:.1f} % of the motion; in (b) {b.deflection:.2f} mm, {yields[1]:.0f} %",
        wrong="robot 10 times as soft")  # fmt: skip
    lost = [run.impact_velocity - run.first_contact.tool_velocity.min() for run in (a, b, *steady)]
    yield Statement(
        "deceleration", "Fig. 14b",
        "In the second scenario the tool is subjected to a significant deceleration during the impact",
        rule="loses more than a quarter of its velocity in (b), and more than twice as much as in (a)",
        holds=bool(lost[1] > 0.25 * b.impact_velocity and lost[1] > 2.0 * lost[0]), wrong="rigid robot",
        ours=f"loses {lost[1]:.3f} m/s in (b), {lost[0]:.3f} m/s in (a)",
        why="In (a) the robot brakes during the contact, and braking slows the tool, too.",
        reading=Reading("the effect of the impact without the braking", bool(lost[3] > 2.0 * lost[2]),
                        f"without a brake {lost[3]:.3f} m/s in (b), {lost[2]:.3f} m/s in (a)"))  # fmt: skip
    before, after = _ranges(b)
    yield Statement(
        "vibration", "Fig. 14b", "This phenomenon generates an increment in the amplitude of vibrations of the tool",
        rule="more than doubled, 50 ms before the contact against 50 ms after it", holds=after > 2.0 * before,
        ours=f"range of the tool's velocity against the imposed one {before:.3f} m/s before, {after:.3f} m/s after",
        wrong="rigid robot")  # fmt: skip
    yield Statement(
        "slower", "Fig. 14b", "The velocity of the object decreases with respect to the previous cases",
        rule="V_p below that of Fig. 14a and of Fig. 13b", wrong="rigid robot",
        holds=bool(b.final_velocity < min(a.final_velocity, light.final_velocity) - 1e-9),
        ours=f"{b.final_velocity:.4f} against {a.final_velocity:.4f} and {light.final_velocity:.4f} m/s")  # fmt: skip
    touching = b.first_contact
    energy = 0.5e3 * ROBOT.stiffness * (touching.command_position - touching.tool_position) ** 2  # mJ
    yield Statement(
        "pushed", "Fig. 14b",
        "Restitution of part of the stored elastic energy occurs during the collision; the object is pushed away",
        rule="the energy of the robot's spring is largest within the contact, and then falls by a tenth or more",
        holds=bool(energy[-1] < 0.9 * energy.max()), wrong="rigid robot",
        ours=f"it rises to {energy.max():.0f} mJ and falls to {energy[-1]:.0f} mJ when the object leaves")  # fmt: skip


FIGURES = (
    Figure(beyond_joints, _statements_joints),
    Figure(figure_13, _statements_13, partial(
        two_runs, titles=("(a) rigid joints", "(b) compliant joints"), common="e = 1, k_c = 1e5", forces=False)),
    Figure(figure_14, _statements_14, partial(
        two_runs, titles=("(a) k_c = 1e5 N/m^1.5", "(b) k_c = 1e6 N/m^1.5"), forces=False,
        common="heavy object, 2.5 kg, and compliant joints; e = 1")),
)  # fmt: skip
