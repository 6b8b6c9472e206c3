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
from experiments.studies.paper.statements import Figure, Finding
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
    slide = sliding_distance(left[0], FRICTION)
    yield Finding("friction", (losses > -1e-6).all() and (losses < 5.0).all(),
        f"the object leaves slower by {losses[0]:.2f} and {losses[1]:.2f} %, and slides {slide:.2f} m")  # fmt: skip


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
    Figure(beyond_joints, _statements_joints),
    Figure(figure_13, _statements_13, partial(
        two_runs, titles=("(a) rigid joints", "(b) compliant joints"), common="e = 1, k_c = 1e5", forces=False)),
    Figure(figure_14, _statements_14, partial(
        two_runs, titles=("(a) k_c = 1e5 N/m^1.5", "(b) k_c = 1e6 N/m^1.5"), forces=False,
        common="heavy object, 2.5 kg, and compliant joints; e = 1")),
)  # fmt: skip
