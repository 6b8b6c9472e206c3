"""Claims of the paper about other speeds, objects and delays, and about detection of the touch."""

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import polars as pl

import impact_gym as ig
from experiments.lab import scenes
from experiments.lab.scenes import BRAKE, LINEAR, MECHANISM, MOTION, OBJECT_MASS, STEADY, scene
from experiments.lab.study import Row
from experiments.studies.paper.runs import Numbers, changes, enclose_changes, where
from impact_gym.scene import Coupling

COUPLINGS: dict[str, Coupling] = {"rigid": ig.Rigid(), "spring": LINEAR, "bistable": MECHANISM}
OBJECTS = {"light": 0.25, "heavy": 1.0}  # kg, masses
DELAYS = np.array([0, 4, 8, 12, 16, 20, 30, 40, 50, 75, 100, 125, 150, 200, 250, 300, 400, 500]) / 1000  # s, of a brake
STIFFNESS = np.logspace(2, 8, 25)  # N/m^1.5
RESTITUTIONS = np.round(np.arange(0.1, 1.001, 0.05), 2)
MIDDLE_STIFFNESS, SMALL_RESTITUTION = 1e5, 0.1  # k_c (N/m^1.5) if the restitution varies; restitution if k_c varies
NEVER = -1.0  # s, the value of `delay` in rows without a brake
PERSON = 0.2  # s, reaction time of a person to an expected signal
FROM_TOUCH = np.round(np.arange(0.002, 0.1001, 0.002), 3)  # s, from the touch to the start of braking
MASSES = np.unique(np.append(np.geomspace(0.1, scenes.HEAVY_MASS, 41), OBJECT_MASS))  # kg, of the object
SIZES = {0.25: 500.0, 1.0: 1e3, 4.0: 2e3}  # k_c (N/m^1.5), by the ratio of the object's radius to that in the paper
CHANGES = np.linspace(0.9, 1.1, 9)  # factors that multiply the mechanism's height H and its front stop
ENOUGH = 40.0  # %, least reduction that we accept as 'about 50 %'
SPEEDS = np.round(np.arange(0.2, 2.0001, 0.02), 2)  # m/s, of the approach
CRUISE = scenes.DISTANCE / MOTION.speed - MOTION.speed / (2.0 * MOTION.acceleration)  # s, time at full speed in Fig. 23


def beyond_delay() -> pl.DataFrame:
    """Simulate each coupling and object with each delay of the brake and without brake; vary k_c, then restitution."""
    rows: list[Row] = []
    braking = replace(MOTION, brake=replace(BRAKE, delay=0.0))
    lines = {
        "stiffness": [(k_c, SMALL_RESTITUTION) for k_c in STIFFNESS],
        "restitution": [(MIDDLE_STIFFNESS, e) for e in RESTITUTIONS],
    }
    for (coupling, what), (kind, mass), (over, points) in product(COUPLINGS.items(), OBJECTS.items(), lines.items()):
        k_c, e = np.array(points).T[:, :, None]
        approach = scene(MIDDLE_STIFFNESS, SMALL_RESTITUTION, what, object_mass=mass)
        contact = {"contact.stiffness": k_c, "contact.restitution": e}
        free = ig.sweep(approach, STEADY, contact, duration=4.0)
        braked = ig.sweep(approach, braking, {**contact, "motion.brake.delay": DELAYS[None]}, duration=4.0)
        grid = np.hstack([free.object_velocity, braked.object_velocity])
        for (point, delay), found in zip(product(points, (NEVER, *DELAYS)), grid.flat, strict=True):
            about = {"coupling": coupling, "object": kind, "over": over, "delay": delay}
            rows.append(about | {"stiffness": point[0], "restitution": point[1], "object_velocity": found})
    velocity, scenario = pl.col("object_velocity"), ("object", "over", "stiffness", "restitution")
    of_rigid = velocity / velocity.filter(coupling="rigid").first().over(*scenario, "delay")
    of_free = velocity / velocity.filter(delay=NEVER).first().over("coupling", *scenario)
    brakes = pl.when(pl.col("delay") != NEVER)
    return pl.DataFrame(rows).with_columns(of_rigid=brakes.then(of_rigid), of_free=brakes.then(of_free))


def _numbers_beyond_delay(frame: pl.DataFrame) -> Numbers:
    rows = frame.filter(pl.col("delay") != NEVER)
    at_16_ms = where(rows, coupling="rigid", object="light", over="stiffness", delay=BRAKE.delay)
    stiffness, gains = at_16_ms["stiffness"], 100.0 * (1.0 - at_16_ms["of_free"])
    free = [where(frame, coupling="rigid", object=kind, delay=NEVER)["object_velocity"] for kind in OBJECTS]
    numbers: Numbers = {
        "gain": np.abs(gains[stiffness >= 1e6]).max(), "gains": np.interp([3.0, 5.0], np.log10(stiffness), gains),
        "mass_effect": np.abs(free[1] / free[0] - 1.0).max(),
    }  # fmt: skip
    for who, when in {"robot": pl.col("delay") <= BRAKE.delay, "operator": pl.col("delay") >= PERSON}.items():
        own = rows.filter(pl.col("coupling") != "rigid", when)
        worst = own.row(own["of_rigid"].arg_max(), named=True)
        below = own.filter(pl.col("of_rigid") < 1.0)
        numbers[who] = {"share": 100 * below.height / own.height, "worst": worst, "mass": OBJECTS[worst["object"]]}
    late = rows.filter(coupling="spring", over="restitution", delay=PERSON)
    at = {f"{e:.1f}": late.filter(restitution=e, object="light")["of_rigid"].item() for e in (0.1, 0.3, 0.5, 1.0)}
    return numbers | {"late": at}


def _notice_delays(approach: ig.Scene) -> tuple[float, float]:
    """Return when (s after the touch) the contact force and the change of the coupling force first exceed THRESHOLD."""
    outcome, trace = scenes.simulate_with_trace(approach, STEADY)
    time = trace.time - outcome.contacts[0].start
    change = np.abs(trace.coupling_force - np.interp(0.0, time, trace.coupling_force))
    if isinstance(approach.coupling, ig.Rigid):
        change = trace.contact_force  # a fixed tool transmits the contact force to the robot
    felt = [force > scenes.THRESHOLD for force in (trace.contact_force, change)]
    by_tool, by_robot = (float(time[(time >= 0.0) & above][0]) for above in felt)
    return by_tool, by_robot


def beyond_detection() -> list[Row]:
    """Brake at all FROM_TOUCH that are not before detection by the tool, and 16 ms after detection by tool or robot."""
    rows: list[Row] = []
    for name, coupling in COUPLINGS.items():
        approach = scene(1e3, 0.1, coupling)
        by_tool, by_robot = _notice_delays(approach)
        delays = [(delay, "grid") for delay in FROM_TOUCH.tolist() if delay >= by_tool]
        delays += [(by_tool + BRAKE.delay, "tool"), (by_robot + BRAKE.delay, "robot")]
        for delay, source in delays:
            motion = replace(MOTION, brake=replace(BRAKE, delay=delay - by_tool))
            velocity = ig.simulate(approach, motion, duration=2.0).object_velocity
            rows.append({"coupling": name, "delay": delay, "object_velocity": velocity, "noticed_by": source})
    return rows


def _numbers_beyond_detection(frame: pl.DataFrame) -> Numbers:
    bistable = frame.filter(coupling="bistable")
    grid, tool, robot = (where(bistable, noticed_by=source) for source in ("grid", "tool", "robot"))
    (tool_delay,), (robot_delay,) = tool["delay"], robot["delay"]
    (by_tool,), (by_robot,) = tool["object_velocity"], robot["object_velocity"]
    (fixed,) = where(frame, coupling="rigid", noticed_by="tool")["object_velocity"]
    return {
        "later": 1e3 * (robot_delay - tool_delay), "change": 100 * (by_robot / by_tool - 1.0),
        "free": 1e3 * grid["delay"][grid["object_velocity"] < 1.05 * by_tool].max(), "robot_delay": 1e3 * robot_delay,
        "velocity": by_robot, "fixed": fixed, "share": by_robot / fixed,
    }  # fmt: skip


def beyond_objects() -> pl.DataFrame:
    """Simulate the fixed tool, the mechanism, and each mechanism changed by CHANGES that still holds the tool."""
    height, stop = MECHANISM.height, MECHANISM.front_stop
    candidates = [replace(MECHANISM, height=h * height, front_stop=s * stop) for h, s in product(CHANGES, CHANGES)]
    holding = [coupling for coupling in candidates if coupling.holding_force >= scenes.HOLD]
    couplings: list[Coupling] = [ig.Rigid(), MECHANISM, *holding]
    frames = []
    for size, stiffness in SIZES.items():
        fixed, used, *changed = (
            ig.sweep(scene(stiffness, 0.1, coupling), MOTION, {"object.mass": MASSES}, duration=2.0)
            for coupling in couplings
        )
        least = np.min([outcomes.object_velocity for outcomes in changed], axis=0)
        columns = {"object_mass": MASSES, "rigid": fixed.object_velocity, "as_it_is": used.object_velocity}
        frames.append(pl.DataFrame({**columns, "changed": least, "snap_count": used.snap_count, "size": size}))
    less = ((pl.col("as_it_is", "changed") / pl.col("rigid") - 1.0) * -100.0).name.suffix("_less")
    return pl.concat(frames).with_columns(less)


def _numbers_beyond_objects(frame: pl.DataFrame) -> Numbers:
    papers = frame.filter(pl.col("object_mass") >= OBJECT_MASS)
    changed, unchanged = papers["changed_less"], papers["as_it_is_less"]
    return {
        "changed": changed.to_numpy(), "changed_ends": [changed.min(), changed.max()],
        "unchanged_ends": [unchanged.min(), unchanged.max()],
        "stuck": frame.filter(pl.col("snap_count") != 1)["object_mass"].max() or 0.0,
        "lightest": frame.filter(pl.col("changed_less") >= ENOUGH)["object_mass"].min(),  # kg
        "least": frame["changed_less"].min(),
    }  # fmt: skip


def _row(coupling: str, speed: float) -> Row:
    distance = speed**2 / (2.0 * MOTION.acceleration) + speed * CRUISE
    approach = scene(1e3, 0.1, COUPLINGS[coupling], distance=distance)
    outcome = ig.simulate(approach, replace(MOTION, speed=speed), duration=2.0)
    return {
        "coupling": coupling, "speed": float(speed), "object_velocity": outcome.object_velocity,
        "ratio": outcome.object_velocity / speed,
        "contacts": len(outcome.contacts), "passes": len(outcome.snap_through),
        "alarm": int(outcome.detection_time is not None),
    }  # fmt: skip


def beyond_speed() -> list[Row]:
    """Simulate each coupling at SPEEDS, and around each speed where the count of contacts, passes or alarms changes."""
    counts = ("contacts", "passes", "alarm")
    return [row for name in COUPLINGS for row in enclose_changes(SPEEDS, partial(_row, name), "speed", *counts)]


def _numbers_beyond_speed(frame: pl.DataFrame) -> Numbers:
    rows, linear = where(frame, coupling="bistable"), where(frame, coupling="spring")
    speed, velocity = rows["speed"], rows["object_velocity"]
    turns = changes(rows, "speed", "passes")
    at_10, at_11, at_12 = np.interp([1.0, 1.1, 1.2], speed, velocity)
    better = speed[velocity < np.interp(speed, linear["speed"], linear["object_velocity"])]
    ratio, other_ratios = rows["ratio"], [where(frame, coupling=name)["ratio"] for name in ("rigid", "spring")]
    fixed = where(frame, coupling="rigid", speed=MOTION.speed)["object_velocity"][0]
    return {
        "fixed": fixed, "faster": speed[velocity <= fixed].max(),
        "fails_below": speed[(speed < MOTION.speed) & (rows["passes"] % 2 == 0)].max(initial=0.0),
        "turns": "".join(f"; {before} to {after} passes of the alignment at {v:.3f} m/s" for v, before, after in turns),
        "better": [better.min(), better.max()] if better.size else [np.nan, np.nan],
        "slowest": speed[0], "fastest": speed[-1],
        "change": 100 * (at_11 / at_10 - 1.0), "change_12": 100 * (at_12 / at_10 - 1.0),
        "passes": int(rows["passes"][np.argmin(np.abs(speed - 1.1))]),
        "passes_at_1": int(rows["passes"][np.argmin(np.abs(speed - 1.0))]),
        "spread": np.ptp(ratio), "spread_of_others": max(map(np.ptp, other_ratios)),
        "ratio_ends": [ratio.min(), ratio.max()], "best_at": speed[int(np.argmin(ratio))],
    }  # fmt: skip
