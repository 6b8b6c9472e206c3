"""sweep(scene, motion, varied) -> Outcomes: `simulate` for arrays of parameters, on all cores."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.kernels import APPROACH, CHAIN, STUCK, approach_rows
from impact_gym.lowering import LOCAL_SHARE, STATUS_MESSAGES, approach_plan
from impact_gym.motion import Trapezoid
from impact_gym.quantities import QUANTITIES
from impact_gym.scene import Scene, flange_moves_with_tool
from impact_gym.simulation import MAX_STEPS, NOTHING_RECORDED
from impact_gym.task.nested import flatten, parts, replaced
from impact_gym.threads import cores, over_rows
from impact_gym.validation import array, one_of, whole

ROWS_PER_THREAD = 16

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Results of all approaches, arrays of the shape that the varied parameters broadcast to; see `Outcome`.

    A row whose run could not finish has nan in its numbers and the reason in its status; other rows are not affected.
    """

    object_velocity: Array  # m/s
    tool_velocity: Array  # m/s
    flange_velocity: Array  # m/s
    peak_force: Array  # N
    detection_time: Array  # s, nan if the threshold was never exceeded
    first_contact: Array  # s, nan if there was none
    contact_count: NDArray[np.int64]
    snap_count: NDArray[np.int64]  # passages of the slider of a mechanism through its alignment
    coupling_impulse: Array  # N s
    momentum_error: Array  # -
    peak_object_velocity: Array  # m/s
    slide: Array  # m, nan without friction
    rest_time: Array  # s, nan without friction or if not all comes to rest
    steps: NDArray[np.int64]
    status: NDArray[np.object_]  # "ok", or a sentence


def sweep(
    scene: Scene, motion: Trapezoid, varied: Mapping[str, ArrayLike], duration: ArrayLike = 1.5, rtol: float = 1e-8,
    threads: int | None = None,
) -> Outcomes:  # fmt: skip
    """Run many approaches that differ from `scene` and `motion` in the parameters of `varied`.

    Args:
        scene: what all have in common; its types of coupling and robot are those of all.
        motion: likewise.
        varied: values by name, broadcast against each other: "object.mass", "contact.stiffness", "coupling.height",
            "motion.speed", "motion.brake.delay" and so on; any number in the records, but those of a `RobotTable`.
        duration: length of the runs, s; broadcasts too.
        rtol: see `simulate`.
        threads: how many to use, None for all cores; changes no result.

    Each row equals `simulate` of that row to the bit.

    Raises:
        TypeError, ValueError: an argument or a value is none of these or out of range; names it, and the row.
    """
    one_of("scene", scene, Scene)
    one_of("motion", motion, Trapezoid)
    one_of("varied", varied, Mapping)
    rtol = QUANTITIES["rtol"].check(rtol)
    threads = cores() if threads is None else whole("threads", threads, at_least=1)
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
    lowered = list(_rows(template, {name: np.broadcast_to(column, shape) for name, column in columns.items()}))
    chains = np.zeros(len(lowered), CHAIN)
    if lowered:
        tables = np.concatenate([table for _, table in lowered])
        plans = np.array([plan for plan, _ in lowered], APPROACH)

        def run(first: int, last: int) -> None:
            approach_rows(plans, tables, chains, first, last, LOCAL_SHARE * rtol, MAX_STEPS, NOTHING_RECORDED)

        over_rows(run, len(lowered), threads, ROWS_PER_THREAD)
    friction = np.broadcast_to(columns.get("object.friction", np.asarray(scene.object.friction or 0.0)), shape)
    return _outcomes(chains.reshape(shape), flange_moves_with_tool(scene.coupling, scene.robot), friction > 0.0)


def _rows(template: Mapping[str, Any], columns: Mapping[str, NDArray[Any]]) -> Iterator[tuple[Any, Array]]:
    """Lower each row: its plan and its robot's table, one behind the other."""
    flat = {name: column.ravel() for name, column in columns.items()}
    durations, numbers = flat.pop("duration"), 0
    for row in range(len(durations)):
        try:
            duration = QUANTITIES["duration"].check(durations[row])
            records = replaced(template, {path: column[row] for path, column in flat.items()})
        except (TypeError, ValueError) as problem:
            index = np.unravel_index(row, columns["duration"].shape)
            raise type(problem)(f"at {tuple(map(int, index))}: {problem}") from None
        motion = records.pop("motion")
        plan, table = approach_plan(Scene(**records), motion, duration, numbers)
        numbers += len(table)
        yield plan, table


def _outcomes(chains: NDArray[Any], with_the_tool: bool, rough: NDArray[np.bool_]) -> Outcomes:
    failed = chains["status"] < 0

    def numbers(values: Array) -> Array:
        return np.where(failed | ~np.isfinite(values), np.nan, values)

    tool = chains["flange_velocity"] + chains["deflection_rate"]
    flange = tool if with_the_tool else chains["flange_velocity"] + chains["flange_offset_rate"]
    sentence = np.vectorize(lambda status: STATUS_MESSAGES.get(status, "ok"), otypes=[object])
    moving = (chains["contacts"] > 0) & (chains["footing"] != STUCK)
    object_velocity = numbers(np.where(moving, tool - chains["penetration_rate"], 0.0))
    alike = ("peak_force", "first_contact", "coupling_impulse", "momentum_error")
    return Outcomes(
        object_velocity=object_velocity,
        tool_velocity=numbers(tool),
        flange_velocity=numbers(flange),
        detection_time=numbers(chains["detection"]),
        contact_count=chains["contacts"].copy(),
        snap_count=chains["snaps"].copy(),
        peak_object_velocity=np.where(rough, numbers(chains["top_speed"]), object_velocity),
        **{name: np.where(rough, numbers(chains[name]), np.nan) for name in ("slide", "rest_time")},
        steps=chains["steps"].copy(),
        **{name: numbers(chains[name]) for name in alike},
        status=sentence(chains["status"]),
    )
