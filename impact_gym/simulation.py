"""Approaches from rest: `simulate` runs one; `sweep` runs many on all cores."""

from collections.abc import Mapping
from copy import deepcopy
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from impact_gym.couplings import Bistable, warn_of_stroke
from impact_gym.kernels import CHAIN, CONTACT, TRACE, approach_rows, run_one
from impact_gym.motion import Motion, Trapezoid
from impact_gym.outcome import Array, Outcome, Outcomes, Trace
from impact_gym.pack import LOCAL_SHARE, STATUS_MESSAGES, pack_approach, pack_approaches
from impact_gym.quantities import BY_PATH, QUANTITIES
from impact_gym.scene import Scene
from impact_gym.support.dotted_paths import flatten, get, parts, replaced
from impact_gym.support.threads import CORES, over_rows
from impact_gym.support.validation import array, one_of, whole

MAX_STEPS = 1_000_000
"""Integration steps after which the solver gives up a run."""

APPROACHES_PER_THREAD = 16  # least number of approaches per thread, if a sweep uses several threads
_SNAP_ROWS, _TRACE_ROWS = 64, 4096  # lengths of the arrays in the first try of a run
_RECORDED = CONTACT, TRACE, np.float64  # types of the arrays of a recorder, see `approach_rows`

_CHAIN_NAMES = {f"{body}_velocity": f"final_{body}_velocity" for body in ("object", "tool", "flange")}
_CHAIN_NAMES |= {"contact_count": "contacts", "snap_count": "snaps", "detection_time": "detection"}
_OUTCOMES = {field: _CHAIN_NAMES.get(field, field) for field in Outcomes.__dataclass_fields__}


def simulate(
    scene: Scene, motion: Trapezoid | Motion, duration: float = 1.5, rtol: float = 1e-8, trace: bool = False
) -> Outcome:
    """Simulate one approach and return its result.

    Args:
        scene: the bodies and their connections, at rest at t = 0.
        motion: imposed motion of the robot.
        duration: length of the run, s.
        rtol: relative error allowed in the results of contacts, 1e-13 to 1e-2; looser ones are refused. Flights are
            integrated to `rtol` with a bistable coupling, stops, a `RobotTable`, or a `SpringDamper` on a `Robot`;
            otherwise they are exact.
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
    plan, table = pack_approach(scene, motion, duration)
    sizes = 0, _TRACE_ROWS if trace else 0, _SNAP_ROWS if isinstance(scene.coupling, Bistable) else 0
    while True:
        recorder: Any = (*map(np.empty, sizes, _RECORDED), max(1e-3, duration / 1e5)) if any(sizes) else None
        status, time, needed, outcome = run_one(plan, table, LOCAL_SHARE * rtol, MAX_STEPS, recorder)
        contacts, points, snaps = needed
        if len(outcome.contacts) == contacts and points <= sizes[1] and snaps <= sizes[2]:
            break
        sizes = needed  # repeat the run with larger arrays; the run is deterministic
    if status < 0:
        raise RuntimeError(f"the run stopped at t = {time:.6g} s: {STATUS_MESSAGES[status]}")
    if recorder:
        _, rows, times, _ = recorder
        passages = tuple(times[:snaps].tolist())
        outcome = outcome._replace(trace=Trace.of(rows[:points]) if trace else None, snap_through=passages)
    return outcome


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
    shapes = {name: column.shape for name, column in columns.items()}
    try:
        shape = np.broadcast_shapes(*shapes.values())
    except ValueError:
        raise ValueError(f"varied values must broadcast against each other, got shapes {shapes}") from None
    columns = {name: column.astype(np.float64) for name, column in columns.items()}
    changed = _with_columns(template, columns, shape)
    approaches, table = pack_approaches(*changed, columns["duration"], shape)
    chains = np.zeros(shape, CHAIN)
    limits = {"tolerance": LOCAL_SHARE * rtol, "max_steps": MAX_STEPS, "recorder": None}
    run = partial(approach_rows, approaches, table, chains, **limits)
    over_rows(run, chains.size, threads, APPROACHES_PER_THREAD)
    results = {field: chains[name].copy() for field, name in _OUTCOMES.items()}
    for values in results.values():
        if values.dtype == np.float64:
            values[(results["status"] < 0) | ~np.isfinite(values)] = np.nan
    sentences = np.full(shape, "ok", np.object_)
    for status, message in STATUS_MESSAGES.items():
        sentences[results["status"] == status] = message
    return Outcomes(**(results | {"status": sentences}))


def _with_columns(
    template: Mapping[str, Any], columns: Mapping[str, Array], shape: tuple[int, ...]
) -> tuple[Scene, Trapezoid]:
    """Return scene and motion with arrays in place of their numbers; ValueError: a row of `columns` is refused.

    Arrays are compared with the limits of their numbers. Only rows that do not pass become records, to say why.
    """
    changed, duration = deepcopy({**template}), QUANTITIES["duration"]
    owners = {path: get(changed, path.rpartition(".")[0]) for path in columns if path != "duration"}
    passed = np.broadcast_to(duration.limits.allow(columns["duration"]), shape).copy()
    for path, owner in owners.items():
        object.__setattr__(owner, path.rpartition(".")[2], columns[path])
        passed &= BY_PATH[path].limits.allow(columns[path]) if path in BY_PATH else False
    for owner in owners.values():
        passed &= owner.fits()
    for index in map(tuple, np.argwhere(~passed).tolist()):
        row = {path: np.broadcast_to(column, shape)[index] for path, column in columns.items()}
        try:
            duration.check(row.pop("duration"))
            replaced(template, row)
        except (TypeError, ValueError) as problem:
            raise type(problem)(f"at {index}: {problem}") from None
    motion = changed.pop("motion")
    return Scene(**changed), motion
