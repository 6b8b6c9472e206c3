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


def indices(kind: np.dtype[Any], before: int = 0) -> dict[str, int]:
    """Return a dict from the dotted path of each number of a compiled record to the number's index."""
    by_name: dict[str, int] = {}
    for name, (inner, offset, *_) in (kind.fields or {}).items():
        at = before + offset // 8
        by_name |= (
            {f"{name}.{rest}": index for rest, index in indices(inner, at).items()} if inner.names else {name: at}
        )
    return by_name


def _codes(record: np.dtype[Any]) -> str:
    fields = [record[name] for name in record.names or ()]
    return "".join(_codes(field) if field.names else "dq"[field.kind == "i"] for field in fields)


def packer(record: np.dtype[Any], names: tuple[str, ...]) -> struct.Struct:
    """Return a `Struct` that packs the numbers `names` (dotted paths in their order) of a record; others are 0."""
    places = [indices(record)[name] for name in names]
    assert places == sorted(places)
    return struct.Struct("".join(code if at in places else "8x" for at, code in enumerate(_codes(record))))


_COUPLING = dict.fromkeys(indices(kernels.MOUNT["coupling"]), 0.0)
_NO_ROBOT = 0.0, 0.0, 0.0
_OF_MOUNT = (
    "coupling_kind", "robot_kind", "tool_mass", *(f"coupling.{name}" for name in _COUPLING),
    "robot.mass", "robot.stiffness", "robot.damping", "intervals", "stiffest",
)  # fmt: skip
OF_PLAN = (
    *(f"mount.{name}" for name in _OF_MOUNT), "contact.stiffness", "contact.m", "contact.n", "contact.nominal",
    "contact.reference", "object_mass", "distance", "friction", "speed", "acceleration", "threshold", "delay",
    "deceleration", "motion", "points", "duration",
)  # fmt: skip
"""The numbers of a RUN_PLAN that are not always 0."""
_MOUNT, _PLAN = packer(kernels.MOUNT, _OF_MOUNT), packer(kernels.RUN_PLAN, OF_PLAN)

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
    numbers, table = _approach(scene, motion, duration, damping_factor)
    return _PLAN.pack(*numbers), table


def pack_approaches(
    scene: Scene, motion: Trapezoid, duration: Numbers, shape: tuple[int, ...]
) -> tuple[Numbers, Numbers]:
    """Return approaches (*shape, n), each with the n numbers of a RUN_PLAN, and the table that all of them share.

    Numbers of the scene and the motion, and `duration`, may be arrays that can be broadcast to `shape`.
    """
    numbers, table = _approach(scene, motion, duration, _damping_factors)
    codes, places = _codes(kernels.RUN_PLAN), indices(kernels.RUN_PLAN)
    approaches = np.zeros((*shape, len(codes)))
    views = {"d": approaches, "q": approaches.view(np.int64)}
    for name, values in zip(OF_PLAN, numbers, strict=True):
        views[codes[places[name]]][..., places[name]] = values
    return approaches, table


def pack_mount(
    tool_mass: float, coupling: Coupling, robot: Robot | RobotTable | None = None
) -> tuple[NDArray[Any], Numbers]:
    """Return an array (1,) of MOUNT, and the robot's table (n,), to put first among all tables."""
    numbers, table = _mount(tool_mass, coupling, robot)
    return np.frombuffer(_MOUNT.pack(*numbers), kernels.MOUNT), table


_damping_factors = np.vectorize(damping_factor, otypes=[np.float64])


def _approach(
    scene: Scene, motion: Trapezoid | Motion, duration: Any, damping: Callable[..., Any]
) -> tuple[tuple[Any, ...], Numbers]:
    """Return the numbers OF_PLAN and the table of a RUN_PLAN; `damping` is `damping_factor` for numbers or arrays."""
    mount, table = _mount(scene.tool.mass, scene.coupling, scene.robot)
    target, contact = scene.object, scene.contact
    m, n = contact.stiffness_exponent, contact.damping_exponent
    numbers = (
        *mount, contact.stiffness, m, n, damping(contact.dissipation, contact.restitution, m, n),
        0.0 if contact.reference_velocity is None else contact.reference_velocity,
        target.mass, target.distance, 0.0 if target.friction is None else target.friction,
    )  # fmt: skip
    if isinstance(motion, Motion):
        run = 0.0, 1.0, math.inf, math.inf, 1.0, len(table), len(motion.times), duration
        return numbers + run, np.array([*table, *motion.times, *motion.velocities])
    threshold, delay = (motion.brake.threshold, motion.brake.delay) if motion.brake else (math.inf, math.inf)
    return (*numbers, motion.speed, motion.acceleration, threshold, delay, motion.deceleration, 0, 0, duration), table


def _mount(tool_mass: Any, coupling: Coupling, robot: Robot | RobotTable | None) -> tuple[tuple[Any, ...], Numbers]:
    """Return the numbers _OF_MOUNT and the robot's table (n,) of a MOUNT."""
    kind, numbers = coupling.kernel()
    of_coupling: dict[str, Any] = _COUPLING | numbers
    if len(of_coupling) > len(_COUPLING):
        unknown = f"coupling.{min(numbers.keys() - _COUPLING.keys())}"
        raise ValueError(
            f"the compiled program has no number {unknown!r}: add a row with this id to impact_gym/quantities.py"
        )
    if robot is None:
        return (kind, kernels.RIGID_ROBOT, tool_mass, *of_coupling.values(), *_NO_ROBOT, 0, 0.0), NO_TABLE
    if isinstance(robot, Robot):
        of_robot = robot.mass, robot.stiffness, robot.damping
        return (kind, kernels.ROBOT, tool_mass, *of_coupling.values(), *of_robot, 0, 0.0), NO_TABLE
    *of_table, table = _table(robot)
    return (kind, kernels.ROBOT_TABLE, tool_mass, *of_coupling.values(), *_NO_ROBOT, *of_table), table


@lru_cache(maxsize=64)
def _table(robot: RobotTable) -> tuple[int, float, Numbers]:
    """Return the number of intervals, `ChainModel.stiffest` and the table (n,) of a robot."""
    splines = robot.splines
    mass, stiffness, _ = splines(splines.x).T
    rows = splines.c[::-1].transpose(1, 2, 0)  # axes: interval; mass, stiffness, damping; power 0 to 3
    return len(rows), max(stiffness / mass), np.concatenate([splines.x, rows.ravel()])
