"""Convert scenes and motions to flat records for the compiled program. Numbers of a scene may be arrays."""

import math
import struct
from collections.abc import Callable, Iterable
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


def _codes(record: np.dtype[Any]) -> str:
    fields = [record[name] for name in record.names or ()]
    return "".join(_codes(field) if field.names else "dq"[field.kind == "i"] for field in fields)


_RUN_PLAN, _MOUNT = (struct.Struct(_codes(record)) for record in (kernels.RUN_PLAN, kernels.MOUNT))


def indices(kind: np.dtype[Any], before: int = 0) -> dict[str, int]:
    """Return a dict from the dotted path of each number of a compiled record to the number's index."""
    by_name: dict[str, int] = {}
    for name, (inner, offset, *_) in (kind.fields or {}).items():
        at = before + offset // 8
        by_name |= (
            {f"{name}.{rest}": index for rest, index in indices(inner, at).items()} if inner.names else {name: at}
        )
    return by_name


MOUNT_NUMBERS, RUN_PLAN_NUMBERS = (  # 0.0 for a float, because `struct` packs it faster than 0
    dict(zip((name.removeprefix("mount.") for name in indices(record)), code.unpack(bytes(code.size)), strict=True))
    for record, code in ((kernels.MOUNT, _MOUNT), (kernels.RUN_PLAN, _RUN_PLAN))
)
"""Zeros for the numbers of a compiled record, by dotted path, in the order of the record."""


def filled(record: dict[str, float], given: dict[str, Any]) -> Iterable[Any]:
    """Return the numbers of a compiled record in its order, 0 for those not given; ValueError: one is not in it."""
    numbers: dict[str, Any] = record | given
    if len(numbers) > len(record):
        unknown = min(given.keys() - record.keys())
        raise ValueError(
            f"the compiled program has no number {unknown!r}: add a row with this id to impact_gym/quantities.py"
        )
    return numbers.values()


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
    given, table = _approach(scene, motion, duration, damping_factor)
    return _RUN_PLAN.pack(*filled(RUN_PLAN_NUMBERS, given)), table


def pack_approaches(
    scene: Scene, motion: Trapezoid, duration: Numbers, shape: tuple[int, ...]
) -> tuple[Numbers, Numbers]:
    """Return approaches (*shape, n), each with the n numbers of a RUN_PLAN, and the table that all of them share.

    Numbers of the scene and the motion, and `duration`, may be arrays that can be broadcast to `shape`.
    """
    given, table = _approach(scene, motion, duration, _damping_factors)
    approaches = np.empty((*shape, len(RUN_PLAN_NUMBERS)))
    views = {"d": approaches, "q": approaches.view(np.int64)}
    for index, (code, values) in enumerate(zip(_RUN_PLAN.format, filled(RUN_PLAN_NUMBERS, given), strict=True)):
        views[code][..., index] = values
    return approaches, table


def pack_mount(
    tool_mass: float, coupling: Coupling, robot: Robot | RobotTable | None = None
) -> tuple[NDArray[Any], Numbers]:
    """Return an array (1,) of MOUNT, and the robot's table (n,), to put first among all tables."""
    given, table = _mount(tool_mass, coupling, robot)
    return np.frombuffer(_MOUNT.pack(*filled(MOUNT_NUMBERS, given)), kernels.MOUNT), table


_damping_factors = np.vectorize(damping_factor, otypes=[np.float64])


def _approach(
    scene: Scene, motion: Trapezoid | Motion, duration: Any, damping: Callable[..., Any]
) -> tuple[dict[str, Any], Numbers]:
    """Return the numbers of a RUN_PLAN, and its table; `damping` is `damping_factor` for numbers or for arrays."""
    given, table = _mount(scene.tool.mass, scene.coupling, scene.robot)
    target, contact = scene.object, scene.contact
    given |= {
        "contact.stiffness": contact.stiffness, "contact.m": contact.stiffness_exponent,
        "contact.n": contact.damping_exponent,
        "contact.nominal": damping(
            contact.dissipation, contact.restitution, contact.stiffness_exponent, contact.damping_exponent
        ),
        "contact.reference": 0.0 if contact.reference_velocity is None else contact.reference_velocity,
        "object_mass": target.mass, "distance": target.distance, "duration": duration,
        "friction": 0.0 if target.friction is None else target.friction, "threshold": math.inf, "delay": math.inf,
    }  # fmt: skip
    if isinstance(motion, Motion):
        given |= {"acceleration": 1.0, "deceleration": 1.0, "motion": len(table), "points": len(motion.times)}
        return given, np.array([*table, *motion.times, *motion.velocities])
    given |= {"speed": motion.speed, "acceleration": motion.acceleration, "deceleration": motion.deceleration}
    if motion.brake:
        given |= {"threshold": motion.brake.threshold, "delay": motion.brake.delay}
    return given, table


def _mount(tool_mass: Any, coupling: Coupling, robot: Robot | RobotTable | None) -> tuple[dict[str, Any], Numbers]:
    """Return the numbers of a MOUNT, and the robot's table (n,)."""
    kind, numbers = coupling.kernel()
    given = {"coupling_kind": kind, "robot_kind": kernels.RIGID_ROBOT, "tool_mass": tool_mass}
    given |= {f"coupling.{name}": value for name, value in numbers.items()}
    if robot is None:
        return given, NO_TABLE
    if isinstance(robot, Robot):
        given |= {"robot_kind": kernels.ROBOT, "robot.mass": robot.mass, "robot.stiffness": robot.stiffness}
        return given | {"robot.damping": robot.damping}, NO_TABLE
    intervals, stiffest, table = _table(robot)
    return given | {"robot_kind": kernels.ROBOT_TABLE, "intervals": intervals, "stiffest": stiffest}, table


@lru_cache(maxsize=64)
def _table(robot: RobotTable) -> tuple[int, float, Numbers]:
    """Return the number of intervals, `ChainModel.stiffest` and the table (n,) of a robot."""
    splines = robot.splines
    mass, stiffness, _ = splines(splines.x).T
    rows = splines.c[::-1].transpose(1, 2, 0)  # axes: interval; mass, stiffness, damping; power 0 to 3
    return len(rows), max(stiffness / mass), np.concatenate([splines.x, rows.ravel()])
