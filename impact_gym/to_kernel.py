"""Convert scenes and motions to flat records for the compiled program."""

import math
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym import kernels
from impact_gym.couplings import Coupling
from impact_gym.motion import Motion, Trapezoid
from impact_gym.physics.dissipation import damping_factor
from impact_gym.scene import Contact, Robot, RobotTable, Scene

Numbers = NDArray[np.float64]

NO_TABLE: Numbers = np.zeros(1)
COUPLING_NUMBERS: tuple[str, ...] = kernels.MOUNT["coupling"].names or ()
ROBOT_NUMBERS: tuple[str, ...] = kernels.MOUNT["robot"].names or ()


def _codes(record: np.dtype[Any]) -> str:
    fields = [record[name] for name in record.names or ()]
    return "".join(_codes(field) if field.names else "dq"[field.kind == "i"] for field in fields)


_RUN_PLAN = struct.Struct(_codes(kernels.RUN_PLAN))


def places(kind: np.dtype[Any], before: int = 0) -> dict[str, int]:
    """Return a dict from the dotted path of each number of a compiled record to the number's index."""
    by_name: dict[str, int] = {}
    for name, (inner, offset, *_) in (kind.fields or {}).items():
        at = before + offset // 8
        by_name |= {f"{name}.{rest}": place for rest, place in places(inner, at).items()} if inner.names else {name: at}
    return by_name


LOCAL_SHARE = 0.2
"""Ratio of the local error allowed in a step to the `rtol` of the run."""

STATUS_MESSAGES = {
    kernels.UNSETTLED: "not settled: further contacts were possible at the time limit, V_p is the value at that time",
    kernels.STEP_LIMIT: "more integration steps than allowed: the motion has too many swings or contacts",
    kernels.NOT_FINITE: "the state overflowed: the scene's scales differ by more than floating point can hold",
}
"""The message for each status of a run or an episode; status 0 has none."""


def approach_to_kernel(
    scene: Scene, motion: Trapezoid | Motion, duration: float, table_at: int = 0
) -> tuple[tuple[Any, ...], Numbers]:
    """Return fields of RUN_PLAN, and the table (n,) of robot and motion to put at index `table_at` of all tables."""
    held, table = mount_to_kernel(scene.tool.mass, scene.coupling, scene.robot, table_at)
    target = scene.object
    profile: tuple[float, ...]
    if isinstance(motion, Motion):
        profile = 0.0, 1.0, math.inf, math.inf, 1.0, table_at + len(table), len(motion.times)
        table = np.array([*table, *motion.times, *motion.velocities])
    else:
        brake = motion.brake
        threshold, delay = (brake.threshold, brake.delay) if brake else (math.inf, math.inf)
        profile = motion.speed, motion.acceleration, threshold, delay, motion.deceleration, 0, 0
    numbers = target.mass, target.distance, target.friction or 0.0
    return (held, contact_to_kernel(scene.contact), *numbers, *profile, duration, 0.0), table


def to_bytes(plan: tuple[Any, ...]) -> bytes:
    """Return the fields of a RUN_PLAN as bytes, by `struct`, which is faster than a NumPy record."""
    (coupling_kind, robot_kind, tool_mass, coupling, robot, *table), contact, *rest = plan
    return _RUN_PLAN.pack(coupling_kind, robot_kind, tool_mass, *coupling, *robot, *table, *contact, *rest)


def contact_to_kernel(contact: Contact) -> tuple[Any, ...]:
    """Return the fields of a contact in the compiled program."""
    m, n = contact.stiffness_exponent, contact.damping_exponent
    damping = damping_factor(contact.dissipation, contact.restitution, m, n)
    return tuple(kernels.contact_of(contact.stiffness, damping, m, n, contact.reference_velocity or 0.0).values())


_NO_ROBOT = (0.0,) * len(ROBOT_NUMBERS)


def _in_order(names: tuple[str, ...], given: Mapping[str, float], record: str) -> tuple[float, ...]:
    """Return the numbers of a compiled record in its order, 0 for those not given; ValueError: one has no place."""
    if not given.keys() <= (known := set(names)):
        raise ValueError(f"the record {record} of the compiled program has no number {min(given.keys() - known)!r}: "
                         f"add a row {record}.{min(given.keys() - known)} to impact_gym/quantities.py")  # fmt: skip
    return tuple([given.get(name, 0.0) for name in names])


def mount_to_kernel(
    tool_mass: float, coupling: Coupling, robot: Robot | RobotTable | None = None, table_at: int = 0
) -> tuple[tuple[Any, ...], Numbers]:
    """Return the fields of MOUNT, and the robot's table (n,) to put at index `table_at` of all tables."""
    kind, given = coupling.kernel()
    numbers = _in_order(COUPLING_NUMBERS, given, "coupling")
    if robot is None:
        return (kind, kernels.RIGID_ROBOT, tool_mass, numbers, _NO_ROBOT, 0, 0, 0.0), NO_TABLE
    if isinstance(robot, Robot):
        given = {"mass": robot.mass, "stiffness": robot.stiffness, "damping": robot.damping}
        of_robot = _in_order(ROBOT_NUMBERS, given, "robot")
        return (kind, kernels.ROBOT, tool_mass, numbers, of_robot, 0, 0, 0.0), NO_TABLE
    splines = robot.splines
    mass, stiffness, _ = splines(splines.x).T
    rows = splines.c[::-1].transpose(1, 2, 0)  # axes: interval; mass, stiffness, damping; power 0 to 3
    held = kind, kernels.ROBOT_TABLE, tool_mass, numbers, _NO_ROBOT, table_at, len(rows), max(stiffness / mass)
    return held, np.concatenate([splines.x, rows.ravel()])
