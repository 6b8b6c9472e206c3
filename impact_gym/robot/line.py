"""A straight line for the flange, the joint angles along it, and the table of what the arm is there."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from impact_gym.record import SI, Record
from impact_gym.robot.approach import Approach
from impact_gym.robot.arm import Arm, Array, along
from impact_gym.validation import one_of

TOLERANCE = 1e-10
"""Largest error of a pose, m and rad."""
STEPS = 200
LARGEST_TURN = 0.2  # rad or m, of a joint in a step of the search

MAX_CONDITION = 30.0
"""Largest condition number of the Jacobian.

At 30 joint 5 of the Viper is 6 to 10 deg from a straight wrist, or joint 3 about 14 deg from a stretched arm, where
M_X,11 is some 100 kg, more than three times the whole robot: a small displacement of the flange is no small rotation of
the joints there, and eq. 11-16 end.
"""
SOFTEST, STIFFEST = 1e3, 1e8  # N/m, along a line: beyond these a unit has slipped


@dataclass(frozen=True, slots=True)
class Line(Record):
    """Along `direction` through the flange at the joint angles of the impact; its orientation stays, if it can."""

    angles: Annotated[tuple[float, ...], SI("rad")]  # m for prismatic joints
    direction: Annotated[tuple[float, ...], SI("-")] = (1.0, 0.0, 0.0)  # in the base's frame, of any length above 0
    ahead: Annotated[float, SI("m", above=0, at_most=2)] = 0.2505  # from the start to the impact; identified
    behind: Annotated[float, SI("m", above=0, at_most=2)] = 0.08  # beyond it: 16 ms at 1 m/s and a brake take 0.0785 m
    spacing: Annotated[float, SI("m", at_least=1e-4, at_most=2)] = 0.0025  # from row to row of the table, at most

    def __post_init__(self) -> None:
        Record.__post_init__(self)
        if len(self.direction) != 3 or not np.linalg.norm(self.direction) > 0:
            raise ValueError(f"Line.direction must be three numbers that are not all 0, got {self.direction!r}")

    @property
    def unit(self) -> Array:
        """The direction, of length 1."""
        return np.array(self.direction) / np.linalg.norm(self.direction)

    @property
    def travels(self) -> tuple[Array, Array]:
        """Travel of the rows from the start to the impact and from there to the end, m; the impact is in both."""
        before, after = (int(np.ceil(length / self.spacing - 1e-9)) + 1 for length in (self.ahead, self.behind))
        behind = np.linspace(self.ahead, self.ahead + self.behind, max(after, 2))
        return np.linspace(0.0, self.ahead, max(before, 3)), behind


def joint_angles(arm: Arm, position: ArrayLike, rotation: Array | None, near: ArrayLike) -> Array:
    """Return the joint angles that put the flange there, searched from angles `near` them, (n,).

    Newton's method with the least change of the joints in each step: that is also what chooses among the angles of an
    arm with more joints than it needs. Without a `rotation` matrix the orientation is free.

    Raises:
        ValueError: the arm cannot take the pose within its limits, or only near a singularity; names place and joint.
    """
    goal, angles = np.asarray(position, dtype=np.float64), np.array(near, dtype=np.float64)
    where = f"x = {goal[0]:.6g} m, y = {goal[1]:.6g} m, z = {goal[2]:.6g} m"
    for _ in range(STEPS):
        place, turned = arm.flange(angles)
        error, rows = goal - place, arm.jacobian(angles)
        if rotation is None:
            rows = rows[:3]
        else:
            error = np.append(error, Rotation.from_matrix(rotation @ turned.T).as_rotvec())
        step = np.linalg.lstsq(rows, error, rcond=1e-9)[0]
        angles += step * min(1.0, LARGEST_TURN / max(float(np.abs(step).max()), 1e-300))
        if np.abs(step).max() < 1e-14:
            break
    miss = float(np.abs(error).max())
    if not miss <= TOLERANCE:
        raise ValueError(
            f"the robot cannot reach {where}: the nearest that was found misses it by {miss:.3g} (m or rad)"
        )
    for joint, angle, low, high, unit in zip(arm.joints, angles, arm.lower, arm.upper, arm.units, strict=True):
        if not low <= angle <= high:
            raise ValueError(
                f"the robot cannot reach {where}: joint {joint!r} would be at {angle:.4g} {unit},"
                f" its limits are {low:.4g} and {high:.4g} {unit}"
            )
    condition = arm.condition(angles)
    if not condition <= MAX_CONDITION:
        far = arm.joints[int(np.argmax(np.abs(np.linalg.svd(rows)[2][min(len(rows), arm.count) - 1])))]
        raise ValueError(
            f"{where} is too near a singularity: with the joints at {np.array2string(angles, precision=4)} the"
            f" condition number of the Jacobian is {condition:.4g}, allowed is at most {MAX_CONDITION:g}; it is joint"
            f" {far!r} that has to turn far"
        )
    return angles


def follow(arm: Arm, line: Line) -> Approach:
    """Return the approach along `line`; joint angles are found from the impact outwards both ways.

    Raises:
        ValueError: the robot cannot follow it; the message names the first place that is refused. Or it would be so
            soft or so stiff there that a unit must have slipped.
    """
    one_of("arm", arm, Arm)
    one_of("line", line, Line)
    place, turned = arm.flange(line.angles)
    rotation = turned if arm.holds_orientation else None
    at_impact = joint_angles(arm, place, rotation, line.angles)

    def walk(travels: Sequence[float]) -> list[Array]:
        angles = [at_impact]
        for travel in travels:
            angles.append(joint_angles(arm, place + (travel - line.ahead) * line.unit, rotation, angles[-1]))
        return angles[1:]

    before, behind = line.travels
    angles = np.array([*walk(before[-2::-1].tolist())[::-1], at_impact, *walk(behind[1:].tolist())])
    rows = [along(arm, row, line.unit) for row in angles]
    softest, stiffest = (pick(row["stiffness"] for row in rows) for pick in (min, max))
    if not SOFTEST <= softest <= stiffest <= STIFFEST:
        raise ValueError(
            f"along the line the stiffness is {softest:.3g} to {stiffest:.3g} N/m, expected is {SOFTEST:g} to"
            f" {STIFFEST:g}: is joint_stiffness in N m/rad?"
        )
    return Approach(
        travel=np.concatenate([before, behind[1:]]),
        **{name: np.array([row[name] for row in rows]) for name in rows[0]},
        joint_angles=angles,
        joints=arm.joints,
        start=place - line.ahead * line.unit,
        direction=line.unit,
        impact_travel=line.ahead,
    )
