"""Convert scenes and motions to flat records for the compiled program. Numbers of a scene may be arrays."""

import math
import struct
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym import kernels
from impact_gym.couplings import Coupling
from impact_gym.motion import Motion, Trapezoid
from impact_gym.physics.dissipation import damping_factor
from impact_gym.scene import Robot, RobotTable, Scene

Numbers = NDArray[np.float64]

NO_TABLE: Numbers = np.zeros(1)
COUPLING_NUMBERS, ROBOT_NUMBERS = (
    dict.fromkeys(kernels.MOUNT[part].names or (), 0.0) for part in ("coupling", "robot")
)
"""Numbers of compiled records by name, in the order of the record, for a part that has none of them."""


def _codes(record: np.dtype[Any]) -> str:
    fields = [record[name] for name in record.names or ()]
    return "".join(_codes(field) if field.names else "dq"[field.kind == "i"] for field in fields)


_RUN_PLAN = struct.Struct(_codes(kernels.RUN_PLAN))


def indices(kind: np.dtype[Any], before: int = 0) -> dict[str, int]:
    """Return a dict from the dotted path of each number of a compiled record to the number's index."""
    by_name: dict[str, int] = {}
    for name, (inner, offset, *_) in (kind.fields or {}).items():
        at = before + offset // 8
        by_name |= (
            {f"{name}.{rest}": index for rest, index in indices(inner, at).items()} if inner.names else {name: at}
        )
    return by_name


def reader(record: np.dtype[Any], names: tuple[str, ...]) -> struct.Struct:
    """Return a `Struct` that unpacks only the numbers `names` of a compiled record, which has them in this order."""
    fields: Any = record.fields
    codes, at = "", 0
    for name in names:
        kind, offset = fields[name][:2]
        codes += f"{offset - at}x{'dq'[kind.kind == 'i']}"
        at = offset + kind.itemsize
    return struct.Struct(f"{codes}{record.itemsize - at}x")


LOCAL_SHARE = 0.2
"""Ratio of the local error allowed in a step to the `rtol` of the run."""

STATUS_MESSAGES = {
    kernels.UNSETTLED: "not settled: further contacts were possible at the time limit, V_p is the value at that time",
    kernels.STEP_LIMIT: "more integration steps than allowed: the motion has too many swings or contacts",
    kernels.NOT_FINITE: "the state overflowed: the scene's scales differ by more than floating point can hold",
}
"""The message for each status of a run or an episode; status 0 has none."""


def pack_approach(scene: Scene, motion: Trapezoid | Motion, duration: float) -> tuple[bytes, Numbers]:
    """Return a RUN_PLAN as bytes, and the table (n,) of its robot and motion. `struct` is faster than NumPy here."""
    fields, table = _approach(scene, motion, duration, damping_factor)
    return _RUN_PLAN.pack(*fields), table


def pack_approaches(
    scene: Scene, motion: Trapezoid, duration: Numbers, shape: tuple[int, ...]
) -> tuple[Numbers, Numbers]:
    """Return approaches (*shape, n), each with the n numbers of a RUN_PLAN, and the table that all of them share.

    Numbers of the scene and the motion, and `duration`, may be arrays that can be broadcast to `shape`.
    """
    fields, table = _approach(scene, motion, duration, _damping_factors)
    approaches = np.empty((*shape, len(fields)))
    views = {"d": approaches, "q": approaches.view(np.int64)}
    for index, (code, values) in enumerate(zip(_RUN_PLAN.format, fields, strict=True)):
        views[code][..., index] = values
    return approaches, table


_damping_factors = np.vectorize(damping_factor, otypes=[np.float64])


def _approach(
    scene: Scene, motion: Trapezoid | Motion, duration: Any, damping: Callable[..., Any]
) -> tuple[tuple[Any, ...], Numbers]:
    """Return the numbers of a RUN_PLAN, and its table; `damping` is `damping_factor` for numbers or for arrays."""
    (coupling_kind, robot_kind, tool_mass, coupling, robot, *rest), table = mount_to_kernel(
        scene.tool.mass, scene.coupling, scene.robot
    )
    target, law, brake = scene.object, scene.contact, getattr(motion, "brake", None)
    m, n = law.stiffness_exponent, law.damping_exponent
    reference = 0.0 if law.reference_velocity is None else law.reference_velocity
    nominal = damping(law.dissipation, law.restitution, m, n)
    contact = law.stiffness, 0.0, m, n, 0, 0, nominal, reference, 0.0  # `contact_of` determines those that are 0
    threshold, delay = (brake.threshold, brake.delay) if brake else (math.inf, math.inf)
    if isinstance(motion, Motion):
        profile = 0.0, 1.0, threshold, delay, 1.0, len(table), len(motion.times)
        table = np.array([*table, *motion.times, *motion.velocities])
    else:
        profile = motion.speed, motion.acceleration, threshold, delay, motion.deceleration, 0, 0
    friction = 0.0 if target.friction is None else target.friction
    numbers = target.mass, target.distance, friction, *profile, duration, 0.0
    return (coupling_kind, robot_kind, tool_mass, *coupling, *robot, *rest, *contact, *numbers), table


_NO_ROBOT = tuple(ROBOT_NUMBERS.values())


def _in_order(none: dict[str, float], given: dict[str, float], record: str) -> tuple[float, ...]:
    """Return the numbers of a compiled record in its order, 0 for those not given; ValueError: one is not in it."""
    numbers = none | given
    if len(numbers) > len(none):
        unknown = min(given.keys() - none.keys())
        raise ValueError(f"the record {record} of the compiled program has no number {unknown!r}: "
                         f"add a row {record}.{unknown} to impact_gym/quantities.py")  # fmt: skip
    return tuple(numbers.values())


def mount_to_kernel(
    tool_mass: float, coupling: Coupling, robot: Robot | RobotTable | None = None
) -> tuple[tuple[Any, ...], Numbers]:
    """Return the fields of MOUNT, and the robot's table (n,), to put first among all tables."""
    kind, given = coupling.kernel()
    numbers = _in_order(COUPLING_NUMBERS, given, "coupling")
    if robot is None:
        return (kind, kernels.RIGID_ROBOT, tool_mass, numbers, _NO_ROBOT, 0, 0, 0.0), NO_TABLE
    if isinstance(robot, Robot):
        given = {"mass": robot.mass, "stiffness": robot.stiffness, "damping": robot.damping}
        of_robot = _in_order(ROBOT_NUMBERS, given, "robot")
        return (kind, kernels.ROBOT, tool_mass, numbers, of_robot, 0, 0, 0.0), NO_TABLE
    intervals, stiffest, table = _table(robot)
    return (kind, kernels.ROBOT_TABLE, tool_mass, numbers, _NO_ROBOT, 0, intervals, stiffest), table


@lru_cache(maxsize=64)
def _table(robot: RobotTable) -> tuple[int, float, Numbers]:
    """Return the number of intervals, `ChainModel.stiffest` and the table (n,) of a robot."""
    splines = robot.splines
    mass, stiffness, _ = splines(splines.x).T
    rows = splines.c[::-1].transpose(1, 2, 0)  # axes: interval; mass, stiffness, damping; power 0 to 3
    return len(rows), max(stiffness / mass), np.concatenate([splines.x, rows.ravel()])
