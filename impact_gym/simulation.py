"""Approaches from rest: `simulate` runs one, `sweep` runs many on all cores, `advise` compares simplified models."""

import math
from collections import namedtuple
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from time import perf_counter
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.couplings import warn_of_stroke
from impact_gym.kernels import APPROACH, CHAIN, CONTACT, TRACE, approach_rows
from impact_gym.motion import Motion, Trapezoid
from impact_gym.outcome import Advice, Advised, Array, ContactRecord, Model, Outcome, Outcomes, Trace
from impact_gym.quantities import QUANTITIES
from impact_gym.robot import Approach, Arm
from impact_gym.robot.approach import Mass
from impact_gym.scene import RobotTable, Scene
from impact_gym.task.nested import flatten, parts, replaced
from impact_gym.threads import CORES, over_rows
from impact_gym.to_kernel import LOCAL_SHARE, STATUS_MESSAGES, approach_to_kernel, to_bytes
from impact_gym.validation import WrongTypeError, array, choice, number, one_of, shown, whole

MAX_STEPS = 1_000_000
"""Integration steps after which the solver gives up a run."""

APPROACHES_PER_THREAD = 16  # least number of approaches per thread, if a sweep uses several threads
_CONTACT_ROWS, _SNAP_ROWS, _TRACE_ROWS = 4096, 64, 4096  # rows of the arrays in the first try of a run
_NO_TRACE, _NO_SNAPS = np.empty(0, TRACE), np.empty(0)
NOTHING_RECORDED = np.empty(0, CONTACT), _NO_TRACE, _NO_SNAPS, 1.0
"""A recorder of the compiled program that stores nothing."""


def simulate(
    scene: Scene, motion: Trapezoid | Motion, duration: float = 1.5, rtol: float = 1e-8, trace: bool = False
) -> Outcome:
    """Simulate one approach and return its result.

    Args:
        scene: the bodies and their connections, at rest at t = 0.
        motion: imposed motion of the robot.
        duration: length of the run, s.
        rtol: relative error allowed in the results of contacts. Between contacts, the motion is integrated to `rtol`
            with a bistable coupling, stops, a `RobotTable`, or a `SpringDamper` on a `Robot`; otherwise it is exact.
        trace: whether to return time histories; other results do not change. Between contacts their points are at most
            1 ms apart, or 1e-5 of `duration` if that is longer. A contact has 8 or 12 points per integration step.

    Raises:
        RuntimeError: the run cannot finish.
    """
    one_of("scene", scene, Scene)
    one_of("motion", motion, Trapezoid, Motion)
    duration = QUANTITIES["duration"].check(duration)
    rtol = QUANTITIES["rtol"].check(rtol)
    warn_of_stroke(scene.coupling, scene.tool.mass, motion.acceleration)
    plan, table = approach_to_kernel(scene, motion, duration)
    plans, chains = to_bytes(plan), np.empty(1, CHAIN)
    contacts, snaps = np.empty(_CONTACT_ROWS, CONTACT), np.empty(_SNAP_ROWS)
    points = np.empty(_TRACE_ROWS, TRACE) if trace else _NO_TRACE
    while True:
        recorder = contacts, points, snaps, max(1e-3, duration / 1e5)
        approach_rows(plans, table, chains, 0, 1, LOCAL_SHARE * rtol, MAX_STEPS, recorder)
        end = _End._make(chains.item())
        if end.logged <= len(contacts) and end.traced <= len(points) and end.snaps <= len(snaps):
            break  # otherwise repeat the run with larger arrays; the run is deterministic
        contacts, points, snaps = np.empty(end.logged, CONTACT), np.empty(end.traced, TRACE), np.empty(end.snaps)
    if end.status < 0:
        raise RuntimeError(f"the run stopped at t = {end.time:.6g} s: {STATUS_MESSAGES[end.status]}")
    rows = contacts[: end.logged].tolist()
    return Outcome(
        end.final_object_velocity,
        end.final_tool_velocity,
        end.final_flange_velocity,
        end.peak_force,
        end.detection if end.detection < math.inf else None,
        tuple(ContactRecord(start, None if stop != stop else stop, *rest) for start, stop, *rest in rows),
        end.coupling_impulse,
        end.momentum_error,
        end.steps,
        "ok",
        Trace.of(points[: end.traced]) if trace else None,
        tuple(snaps[: end.snaps].tolist()),
        end.peak_object_velocity,
        *((end.slide, end.rest_time) if scene.object.friction else (None, None)),
    )


_namedtuple: Any = namedtuple  # Any: mypy wants the field names as literals
_End = _namedtuple("_End", CHAIN.names)  # a record CHAIN as Python numbers


def sweep(
    scene: Scene, motion: Trapezoid, varied: Mapping[str, ArrayLike], duration: ArrayLike = 1.5, rtol: float = 1e-8,
    threads: int | None = None,
) -> Outcomes:  # fmt: skip
    """Simulate many approaches that differ from `scene` and `motion` in the numbers of `varied`.

    The results are equal, bit for bit, to those of `simulate`; if a run cannot finish, its floats are nan.

    Args:
        scene: the common scene; the types of coupling and robot cannot be varied.
        motion: the common motion.
        varied: arrays of values by dotted path, such as "object.mass" or "motion.brake.delay". The arrays are
            broadcast against each other. A field that is None, and the numbers of a `RobotTable`, cannot be varied.
        duration: length of the runs, s; broadcast with the values of `varied`.
        rtol: see `simulate`.
        threads: number of threads, which changes no result; None: one per core.
    """
    one_of("scene", scene, Scene)
    one_of("motion", motion, Trapezoid)
    one_of("varied", varied, Mapping)
    rtol = QUANTITIES["rtol"].check(rtol)
    threads = CORES if threads is None else whole("threads", threads, at_least=1)
    template = {**parts(scene), "motion": motion}
    known = list(flatten(template))
    for name in varied:
        if name not in known:
            raise ValueError(f"varied has no number named {name!r}; there are {', '.join(known)}")
    columns = {name: array(f"varied[{name!r}]", values) for name, values in varied.items()}
    columns["duration"] = array("duration", duration)
    try:
        shape = np.broadcast_shapes(*(column.shape for column in columns.values()))
    except ValueError:
        shapes = {name: column.shape for name, column in columns.items()}
        raise ValueError(f"varied values must broadcast against each other, got shapes {shapes}") from None
    approaches = list(_approaches(template, {name: np.broadcast_to(column, shape) for name, column in columns.items()}))
    chains = np.zeros(len(approaches), CHAIN)
    if approaches:
        tables = np.concatenate([table for _, table in approaches])
        plans = np.array([plan for plan, _ in approaches], APPROACH)
        limits = {"tolerance": LOCAL_SHARE * rtol, "max_steps": MAX_STEPS, "recorder": NOTHING_RECORDED}
        run = partial(approach_rows, plans, tables, chains, **limits)
        over_rows(run, len(approaches), threads, APPROACHES_PER_THREAD)
    chains = chains.reshape(shape)
    results = {field: chains[name] for field, name in _OUTCOMES.items()}
    for field, values in results.items():
        unknown = (chains["status"] < 0) | ~np.isfinite(values)
        results[field] = np.where(unknown, np.nan, values) if values.dtype == np.float64 else values.copy()
    sentences = np.vectorize(lambda status: STATUS_MESSAGES.get(status, "ok"), otypes=[object])
    return Outcomes(**(results | {"status": sentences(chains["status"])}))


_FIELDS_OF_CHAIN = {f"{body}_velocity": f"final_{body}_velocity" for body in ("object", "tool", "flange")}
_FIELDS_OF_CHAIN |= {"contact_count": "contacts", "snap_count": "snaps", "detection_time": "detection"}
_OUTCOMES = {field: _FIELDS_OF_CHAIN.get(field, field) for field in Outcomes.__dataclass_fields__}


def _approaches(template: Mapping[str, Any], columns: Mapping[str, NDArray[Any]]) -> Iterator[tuple[Any, Array]]:
    """Yield, for each approach, the fields of a record of the type APPROACH, and the table of its robot."""
    flat = {name: column.ravel() for name, column in columns.items()}
    durations, table_at = flat.pop("duration"), 0
    for row in range(len(durations)):
        try:
            duration = QUANTITIES["duration"].check(durations[row])
            changed = replaced(template, {path: column[row] for path, column in flat.items()})
        except (TypeError, ValueError) as problem:
            index = np.unravel_index(row, columns["duration"].shape)
            raise type(problem)(f"at {tuple(map(int, index))}: {problem}") from None
        motion = changed.pop("motion")
        plan, table = approach_to_kernel(Scene(**changed), motion, duration, table_at)
        table_at += len(table)
        yield plan, table


ROUNDS = 3  # `advise` runs each model this many times (the one with all joints once); the shortest time counts


def advise(
    scenes: Scene | Sequence[Scene], motion: Trapezoid, tolerance: float = 1e-3, quantity: Advised = "object_velocity",
    duration: float = 1.5, arm: tuple[Arm, Approach] | None = None,
) -> Advice:  # fmt: skip
    """Compare simplified models of `scenes` with the full model; recommend the fastest model within the tolerance.

    Args:
        scenes: a scene, or a sample of the scenes that are to be simulated; the advice holds for this sample.
        motion: imposed motion of the robot.
        tolerance: relative error allowed in `quantity`, in every scene.
        quantity: the result that is compared: final velocity of the object, largest contact force, or impulse of all
            contacts.
        duration: length of a run, s.
        arm: an arm and its line of approach, `(arm, arm.along(...))`, for scenes without a robot. Then the full model
            simulates all joints, see `impact_gym.robot.all_joints`. Simpler models have a rigid robot or a table
            from `Approach.robot_table`. The table is used as it is, or only its values at the object's distance.

    Raises:
        RuntimeError: a run of the full model cannot finish.
    """
    sample = [scenes] if isinstance(scenes, Scene) else list(scenes)
    if not sample:
        raise ValueError("scenes must be a Scene or a sequence of them, got none")
    choice("quantity", quantity, get_args(Advised))
    tolerance = number("tolerance", tolerance, "(no unit)", above=0)
    if arm is not None and [type(each) for each in (arm if isinstance(arm, tuple) else ())] != [Arm, Approach]:
        raise WrongTypeError(f"arm must be a pair, an Arm and its Approach, got {shown(arm)}")
    run = partial(_timed, motion, duration, quantity)
    exact, seconds = run(sample, arm)
    tried = [Model("as it is" if arm is None else "all joints", lambda scene: scene, np.zeros(len(sample)), 0.0)]
    seen = [sample] if arm is None else []
    for name, simplify in _simpler_models(arm[1] if arm else None):
        simpler = [simplify(scene) for scene in sample]
        if simpler in seen:
            continue
        seen.append(simpler)
        try:
            values, taken = run(simpler)
        except (RuntimeError, ValueError):  # the simpler model is invalid or fails
            values, taken = np.full(len(sample), math.inf), seconds
        gap = np.abs(values - exact)
        errors = np.divide(gap, np.abs(exact), out=np.where(gap > 0, math.inf, 0.0), where=exact != 0)
        tried.append(Model(name, simplify, errors, 1.0 - taken / seconds))
    kept = [model for model in tried if model.bound <= tolerance]
    return Advice(quantity, tolerance, max(kept, key=lambda model: model.time_saved), tuple(tried))


FROZEN = "frozen where the object stands"


def _simpler_models(line: Approach | None) -> Iterator[tuple[str, Callable[[Scene], Scene]]]:
    """Yield name and simplifying function of each simpler model; `line`: an arm's approach, not `Scene.robot`."""
    robots: dict[str, Any] = {"robot rigid": None}
    if line is None:
        robots = {"": "its own", f"robot {FROZEN}": "its own", **robots}
    else:
        for mass in get_args(Mass):
            robots[f"robot one mass, {mass}"] = robots[f"robot one mass, {mass}, {FROZEN}"] = line.robot_table(mass)
    for (name, robot), tool in product(robots.items(), ("", "tool fixed to the flange")):
        if name or tool:
            yield ", ".join(filter(None, (name, tool))), partial(_simplified, robot, name.endswith(FROZEN), tool != "")


def _simplified(robot: Any, frozen: bool, fixed: bool, scene: Scene) -> Scene:
    own = scene.robot if robot == "its own" else robot
    robot = own.at(scene.object.distance) if frozen and isinstance(own, RobotTable) else own
    return replace(scene, robot=robot, coupling=scene.coupling.simplified() if fixed else scene.coupling)


def _timed(
    motion: Trapezoid, duration: float, quantity: Advised, scenes: Sequence[Scene],
    arm: tuple[Arm, Approach] | None = None,
) -> tuple[Array, float]:  # fmt: skip
    """Return the quantity for each scene, and the time (s) for all scenes, the shortest of ROUNDS (with `arm` one)."""
    from impact_gym.robot.all_joints import simulate as simulate_arm  # imported here, because this takes 40 ms

    times: list[float] = []
    for _ in range(1 if arm else ROUNDS):
        begun = perf_counter()
        outcomes: list[Any] = [
            simulate_arm(*arm, scene, motion, duration=duration) if arm else simulate(scene, motion, duration)
            for scene in scenes
        ]
        times.append(perf_counter() - begun)
    for outcome in outcomes:
        if outcome.status != "ok":
            raise RuntimeError(f"the whole arm: {outcome.status}")
    if quantity == "impulse" and not arm:
        values = [math.fsum(contact.impulse for contact in outcome.contacts) for outcome in outcomes]
    else:
        values = [float(getattr(outcome, quantity)) for outcome in outcomes]
    return np.array(values), min(times)
