"""What must not matter: units, frame, order of rows, number of threads, the process. As numbers, over storm scenes."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import count as numbers_from
from itertools import islice
from typing import Any

import numpy as np

import impact_gym as ig
from experiments.speed_vs_error.records import Row
from experiments.speed_vs_error.scenes import Approach
from experiments.stability.agreement import relative_error
from experiments.stability.frame import velocity_in_frame
from experiments.stability.rivals import eligible
from experiments.stability.scenes import draw

RTOL = 1e-8  # of the runs
BOOST = 2.0  # m/s
UNITS = {
    "units scaled by powers of two": (8.0, 0.25, 2.0),
    "units scaled by 3, 0.7 and 1.3": (3.0, 0.7, 1.3),
}
"""Factors of mass, length and time."""
CONVERGED = 10 * RTOL  # relative, that a different sequence of steps may change
ROUNDING = 1e-12  # relative, in the median
SWEPT = ("object.mass", "object.distance", "contact.stiffness", "contact.restitution", "motion.speed")
SLOWEST = 1e-5  # m/s, ten times the floor of v_in, which no unit scales
MAX_STEPS = 20_000


def scaled(approach: Approach, mass: float, length: float, time: float) -> Approach:
    """Return the approach with its numbers in other units: each mass so many times as large, and so on."""
    speed, acceleration, force = length / time, length / time**2, mass * length / time**2
    scene, motion, contact, coupling, robot = (
        approach.scene, approach.motion, approach.scene.contact, approach.scene.coupling, approach.scene.robot,
    )  # fmt: skip
    if isinstance(coupling, ig.SpringDamper):
        coupling = replace(coupling, stiffness=coupling.stiffness * force / length)
    if isinstance(coupling, ig.Bistable):
        lengths = {name: getattr(coupling, name) * length for name in ("free_length", "height")}
        lengths |= {name: getattr(coupling, name) * length for name in ("front_stop", "rear_stop")}
        stiffness = {name: getattr(coupling, name) * force / length for name in ("stiffness", "stop_stiffness")}
        coupling = replace(coupling, **lengths, **stiffness)
    if robot is not None:
        factors = {"mass": mass, "stiffness": force / length, "damping": force / speed}
        if isinstance(robot, ig.RobotTable):
            factors["position"] = length
        robot = type(robot)(**{name: _times(getattr(robot, name), factor) for name, factor in factors.items()})
    brake = motion.brake
    if brake is not None:
        deceleration = None if brake.deceleration is None else brake.deceleration * acceleration
        brake = ig.Brake(brake.threshold * force, brake.delay * time, deceleration)
    stiffness_unit = force / length**contact.stiffness_exponent
    return replace(
        approach,
        scene=ig.Scene(
            ig.Tool(scene.tool.mass * mass),
            ig.Object(scene.object.mass * mass, scene.object.distance * length),
            replace(contact, stiffness=contact.stiffness * stiffness_unit),
            coupling,
            robot,
        ),
        motion=ig.Trapezoid(motion.speed * speed, motion.acceleration * acceleration, brake),
        duration=approach.duration * time,
    )


def _times(value: float | tuple[float, ...], factor: float) -> Any:
    return tuple(one * factor for one in value) if isinstance(value, tuple) else value * factor


def velocity(approach: Approach) -> float:
    """V_p, m/s."""
    return ig.simulate(approach.scene, approach.motion, approach.duration, RTOL).object_velocity


def candidates(plain: bool = False) -> Iterator[Approach]:
    """Storm scenes with a contact, none of them slower than SLOWEST, that need no more steps than MAX_STEPS.

    With `plain` only those with m = n = 3/2 and a rigid robot.
    """
    for number in numbers_from():
        approach = draw(number)
        if plain and not eligible(approach):
            continue
        try:
            outcome = ig.simulate(approach.scene, approach.motion, approach.duration, RTOL)
        except RuntimeError:
            continue
        slowest = min((contact.approach_velocity for contact in outcome.contacts), default=0.0)
        if slowest > SLOWEST and outcome.steps < MAX_STEPS:
            yield approach


def line(name: str, differences: Sequence[float], bar: str, met: bool) -> Row:
    """Return a row of the table: what must not matter, by how much it does, and by how much it may."""
    values = np.array(differences)
    return {
        "contender": name,
        "scenes": len(values),
        "equal": float(np.mean(values == 0.0)),
        "median": float(np.median(values)),
        "largest": float(values.max()),
        "description": bar,
        "met": int(met),
    }


def to_rounding(name: str, differences: Sequence[float]) -> Row:
    """Return the row of what rounding may change, and with it the sequence of steps."""
    bar = f"median below {ROUNDING:g}, none above {CONVERGED:g}"
    return line(name, differences, bar, float(np.median(differences)) < ROUNDING and max(differences) < CONVERGED)


def to_the_bit(name: str, differences: Sequence[float]) -> Row:
    """Return the row of what may change nothing."""
    return line(name, differences, "no difference at all", not np.any(differences))


def units(name: str, approaches: Iterable[Approach]) -> Row:
    """Other units change only the numbers."""
    mass, length, time = UNITS[name]
    unit = length / time
    return to_rounding(
        name,
        [
            relative_error(velocity(scaled(a, mass, length, time)) / unit, velocity(a), a.motion.speed)
            for a in approaches
        ],
    )


def frame(approaches: Iterable[Approach]) -> Row:
    """A room that moves at BOOST changes nothing within it; over V_p or BOOST, whose rounding comes in."""
    found = []
    for approach in approaches:
        here, moving = (velocity_in_frame(approach, boost, RTOL) for boost in (0.0, BOOST))
        found.append(abs(moving - here) / max(abs(here), BOOST))
    return to_rounding(f"frame moving at {BOOST:g} m/s", found)


def sweep_of(rows: int, coupling: ig.SpringDamper | ig.Rigid, order: Any, threads: int) -> Any:
    """Return V_p of a sweep over storm values, rows taken in `order`."""
    approaches = [draw(number) for number in range(rows)]
    values = {
        "object.mass": [a.scene.object.mass / a.scene.tool.mass for a in approaches],
        "object.distance": [a.scene.object.distance for a in approaches],
        "contact.stiffness": [a.scene.contact.stiffness for a in approaches],
        "contact.restitution": [max(a.scene.contact.restitution, 0.05) for a in approaches],
        "motion.speed": [a.motion.speed for a in approaches],
    }
    template = ig.Scene(ig.Tool(1.0), ig.Object(1.0, 0.1), ig.Contact(1e5, 0.5), coupling)
    varied = {name: np.array(values[name])[order] for name in SWEPT}
    duration = np.array([a.duration for a in approaches])[order]
    found = ig.sweep(template, ig.Trapezoid(1.0, 8.0, ig.Brake()), varied, duration, RTOL, threads)
    return np.nan_to_num(found.object_velocity, nan=-1.0)  # a run that does not finish must not finish always


def sweeps(rows: int) -> Iterator[Row]:
    """Rows in another order, and on other numbers of threads."""
    coupling = ig.SpringDamper(150.0, 0.5)
    plain, order = np.arange(rows), np.random.default_rng(0).permutation(rows)
    first = sweep_of(rows, coupling, plain, 1)
    mixed = np.empty(rows)
    mixed[order] = sweep_of(rows, coupling, order, 1)
    yield to_the_bit("order of the rows of a sweep", np.abs(mixed - first).tolist())
    for threads in (2, 7):
        there = sweep_of(rows, coupling, plain, threads)
        yield to_the_bit(f"{threads} threads instead of 1", np.abs(there - first).tolist())


def repeated(storm_velocities: dict[int, float]) -> Row:
    """A scene computed again, here and not in the process that wrote its row."""
    found = []
    for number, before in storm_velocities.items():
        found.append(abs(velocity(draw(number)) - before) if math.isfinite(before) else 0.0)
    return to_the_bit("another process, another order of scenes", found)


def table(size: int, storm_velocities: dict[int, float], trace_changes: Sequence[float]) -> list[Row]:
    """Return all rows, over `size` scenes each."""
    approaches = list(islice(candidates(), size))
    found = [units(name, approaches) for name in UNITS]
    found.append(frame(islice(candidates(plain=True), size)))
    found += sweeps(max(size, 32))
    found.append(repeated(storm_velocities))
    found.append(to_the_bit("with a trace", trace_changes))
    return found
