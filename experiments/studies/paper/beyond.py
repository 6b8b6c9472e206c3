"""Claims of the paper about other speeds, objects and delays, and about detection of the touch."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import polars as pl

import impact_gym as ig
from experiments.lab import scenes
from experiments.lab.scenes import BISTABLE, BRAKE, CONSTANT_SPEED, LINEAR, MOTION, OBJECT_MASS, scene
from experiments.lab.study import Row
from experiments.studies.paper.runs import PAPER, Model, where
from experiments.studies.paper.statements import Figure, Finding
from impact_gym.couplings import Coupling

COUPLINGS: dict[str, Coupling] = {"rigid": ig.Rigid(), "spring": LINEAR, "bistable": BISTABLE}
OBJECTS = {"light": 0.25, "heavy": 1.0}  # kg, masses
DELAYS = np.array([0, 4, 8, 12, 16, 20, 30, 40, 50, 75, 100, 125, 150, 200, 250, 300, 400, 500]) / 1000  # s, of a brake
STIFFNESS = np.logspace(2, 8, 25)  # N/m^1.5, with a restitution of 0.1
RESTITUTIONS = np.round(np.arange(0.1, 1.001, 0.05), 2)  # with k_c = 1e5 N/m^1.5
PERSON = 0.2  # s, reaction time of a person to an expected signal
MASSES = np.unique(np.append(np.geomspace(0.1, scenes.HEAVY_MASS, 41), OBJECT_MASS))  # kg, of the object
SIZES = {0.25: 500.0, 1.0: 1e3, 4.0: 2e3}  # k_c (N/m^1.5), by the ratio of the object's radius to that in the paper
CHANGES = np.linspace(0.9, 1.1, 9)  # factors that multiply the mechanism's height H and its front stop
ENOUGH = 40.0  # %, least reduction that we accept as 'about 50 %'
SPEEDS = np.round(np.arange(0.2, 2.0001, 0.02), 2)  # m/s, of the approach
CRUISE = scenes.DISTANCE / MOTION.speed - MOTION.speed / (2.0 * MOTION.acceleration)  # s, time at full speed in Fig. 23


def beyond_delay(model: Model = PAPER) -> pl.DataFrame:
    """Simulate each coupling and object with each delay of the brake; vary k_c, then restitution."""
    k_c = np.append(STIFFNESS, np.full(RESTITUTIONS.size, 1e5))[:, None]
    e = np.append(np.full(STIFFNESS.size, 0.1), RESTITUTIONS)[:, None]
    varied = {"contact.stiffness": k_c, "contact.restitution": e, "motion.brake.delay": DELAYS[None]}
    frames, rigid = [], np.empty(0)
    for (what, mass), (name, coupling) in product(OBJECTS.items(), COUPLINGS.items()):
        approach = scene(1e5, 0.1, coupling, object_mass=mass)
        velocity = model.sweep(approach, varied, 4.0).object_velocity
        rigid = velocity if name == "rigid" else rigid
        restitution, delay, of_rigid = map(np.ravel, np.broadcast_arrays(e, DELAYS, velocity / rigid))
        columns = {"restitution": restitution, "delay": delay, "of_rigid": of_rigid}
        frames.append(pl.DataFrame({**columns, "object": what, "coupling": name}))
    return pl.concat(frames)


def _statements_delay(frame: pl.DataFrame) -> Iterator[Finding]:
    light = frame.filter(coupling="spring", delay=PERSON, object="light")[STIFFNESS.size :]
    late = [light.filter(restitution=e)["of_rigid"].item() for e in (0.1, 0.3, 1.0)]
    for who, when, since in (("robot", pl.col("delay") <= BRAKE.delay, "with a brake up to 16 ms late"),
                             ("operator", pl.col("delay") >= PERSON, "with a brake at least 200 ms late")):  # fmt: skip
        share = 100.0 * np.mean(frame.filter(pl.col("coupling") != "rigid", when)["of_rigid"].to_numpy() < 1.0)
        ours = f"V_p is below the rigid tool's in {share:.1f} % of combinations {since}"
        yield Finding(who, share > 95.0, ours, why=late)


def beyond_detection(model: Model = PAPER) -> list[Row]:
    """Brake 16 ms after the contact force ("tool") or the change of the coupling's force ("robot") exceeds 1 N."""
    approach = scene(1e3, 0.1, BISTABLE)
    outcome, trace = model.trace(approach, CONSTANT_SPEED)
    time = trace.time - outcome.contacts[0].start
    change = np.abs(trace.coupling_force - np.interp(0.0, time, trace.coupling_force))
    by_tool, by_robot = (
        float(time[(time >= 0.0) & (force > scenes.THRESHOLD)][0]) for force in (trace.contact_force, change)
    )
    rows: list[Row] = []
    for delay in (by_tool, by_robot):
        motion = replace(MOTION, brake=replace(BRAKE, delay=BRAKE.delay + delay - by_tool))
        velocity = model.simulate(approach, motion, duration=2.0).object_velocity
        rows.append({"delay": delay, "object_velocity": velocity})
    return rows


def _statements_detection(frame: pl.DataFrame) -> Iterator[Finding]:
    (tool, by_tool), (robot, by_robot) = frame.select("delay", "object_velocity").rows()
    change = 100.0 * (by_robot / by_tool - 1.0)
    yield Finding("torque_sensor", abs(change) < 5.0,
        f"the mechanism's force on the robot has changed by 1 N {1e3 * (robot - tool):.1f} ms after the "
        f"contact force reaches 1 N; V_p changes by {change:.1f} %")  # fmt: skip


def beyond_objects(model: Model = PAPER) -> pl.DataFrame:
    """Simulate the fixed tool, the mechanism, and each mechanism changed by CHANGES that still holds the tool."""
    height, stop = BISTABLE.height, BISTABLE.front_stop
    candidates = [replace(BISTABLE, height=h * height, front_stop=s * stop) for h, s in product(CHANGES, CHANGES)]
    holding = [coupling for coupling in candidates if coupling.holding_force >= scenes.HOLD]
    couplings: list[Coupling] = [ig.Rigid(), BISTABLE, *holding]
    frames = []
    for stiffness in SIZES.values():
        fixed, used, *changed = (
            model.sweep(scene(stiffness, 0.1, coupling), {"object.mass": MASSES}, 2.0) for coupling in couplings
        )
        least = np.min([outcomes.object_velocity for outcomes in changed], axis=0)
        less = [100.0 * (1.0 - velocity / fixed.object_velocity) for velocity in (used.object_velocity, least)]
        columns = {"object_mass": MASSES, "snap_count": used.snap_count}
        frames.append(pl.DataFrame({**columns, "as_it_is_less": less[0], "changed_less": less[1]}))
    return pl.concat(frames)


def _statements_objects(frame: pl.DataFrame) -> Iterator[Finding]:
    heavy = frame.filter(pl.col("object_mass") >= OBJECT_MASS)
    changed, unchanged = heavy["changed_less"].to_numpy(), heavy["as_it_is_less"].to_numpy()
    least = frame["changed_less"].to_numpy().min()
    stuck = frame.filter(pl.col("snap_count") != 1)["object_mass"].to_numpy().max(initial=0.0)
    yield Finding("small_modifications", changed.min() >= ENOUGH,
        f"V_p falls by {changed.min():.0f} to {changed.max():.0f} %, and by {unchanged.min():.0f} to "
        f"{unchanged.max():.0f} % without any modification",
        why=[stuck],
        reading=(least >= ENOUGH, f"V_p falls by {least:.0f} % at the lightest"))  # fmt: skip


def beyond_speed(model: Model = PAPER) -> pl.DataFrame:
    """Simulate each coupling at SPEEDS."""
    distance = SPEEDS**2 / (2.0 * MOTION.acceleration) + SPEEDS * CRUISE
    varied = {"motion.speed": SPEEDS, "object.distance": distance}
    frames = []
    for name, coupling in COUPLINGS.items():
        found = model.sweep(scene(1e3, 0.1, coupling), varied, 2.0)
        columns = {"speed": SPEEDS, "object_velocity": found.object_velocity, "passes": found.snap_count}
        frames.append(pl.DataFrame({**columns, "coupling": name}))
    return pl.concat(frames)


def _statements_speed(frame: pl.DataFrame) -> Iterator[Finding]:
    rows, linear = where(frame, coupling="bistable"), where(frame, coupling="spring")
    speed, velocity = rows["speed"], rows["object_velocity"]
    fixed = where(frame, coupling="rigid", speed=MOTION.speed)["object_velocity"][0]
    faster = speed[velocity <= fixed].max(initial=0.0)
    yield Finding("faster", faster > 1.0,
        f"up to {faster:.2f} m/s with no more V_p than the fixed tool gives at 1 m/s, {fixed:.3f} m/s")  # fmt: skip
    passes = [int(rows["passes"][np.abs(speed - at).argmin()]) for at in (1.0, 1.1)]
    fails_below = speed[(speed < MOTION.speed) & (rows["passes"] % 2 == 0)].max(initial=0.0)
    yield Finding("second_configuration", 0.0 < fails_below < 1.0 and passes[0] == 1,
        f"the slider does not stay behind the alignment at {fails_below:.2f} m/s, but at 1 m/s")  # fmt: skip
    better = speed[velocity < np.interp(speed, linear["speed"], linear["object_velocity"])]
    ends = (better.min(), better.max()) if better.size else (np.nan, np.nan)
    yield Finding("tuned", ends[0] > speed[0] and ends[1] < speed[-1],
        f"the mechanism of Fig. 23 is worse below {ends[0]:.2f} and above {ends[1]:.2f} m/s")  # fmt: skip
    at_10, at_11, at_12 = np.interp([1.0, 1.1, 1.2], speed, velocity)
    change, change_12 = 100.0 * (at_11 / at_10 - 1.0), 100.0 * (at_12 / at_10 - 1.0)
    yield Finding("small_increase", abs(change) < 10.0 and passes[1] == 1, f"at 1.1 m/s V_p changes by {change:.1f} %",
        reading=(abs(change_12) < 10.0, f"V_p changes by {change_12:.0f} %"))  # fmt: skip


FIGURES = (
    Figure(beyond_delay, _statements_delay),
    Figure(beyond_detection, _statements_detection),
    Figure(beyond_objects, _statements_objects),
    Figure(beyond_speed, _statements_speed),
)
