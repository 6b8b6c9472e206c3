"""Approaches from rest: `simulate` runs one; `sweep` runs many on all cores."""

import math
from collections import namedtuple
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.couplings import warn_of_stroke
from impact_gym.kernels import CHAIN, CONTACT, RUN_PLAN, TRACE, approach_rows
from impact_gym.motion import Motion, Trapezoid
from impact_gym.outcome import Array, ContactRecord, Outcome, Outcomes, Trace
from impact_gym.quantities import QUANTITIES
from impact_gym.scene import Scene
from impact_gym.support.dotted_paths import flatten, parts, replaced
from impact_gym.support.threads import CORES, over_rows
from impact_gym.support.validation import array, one_of, whole
from impact_gym.to_kernel import LOCAL_SHARE, STATUS_MESSAGES, approach_to_kernel, to_bytes

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
        plans = np.array([plan for plan, _ in approaches], RUN_PLAN)
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
    """Yield, for each approach, the fields of a record of the type RUN_PLAN, and the table of its robot."""
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
