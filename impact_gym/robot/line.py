"""A straight line for the flange, the joint angles along it, and the table of what the arm is there."""

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from impact_gym.robot.approach import Approach, Array
from impact_gym.validation import number, numbers

if TYPE_CHECKING:
    from impact_gym.robot.arm import Arm

TOLERANCE = 1e-10
"""Largest error of a pose, m and rad."""
STEPS = 200
LARGEST_TURN = 0.2  # rad or m, of a joint in a step of the search
SPACING, LONGEST = 0.0025, 4.0  # m, of the places along a line, at most, and of a line

MAX_CONDITION = 30.0
"""Largest condition number of the Jacobian.

At 30 joint 5 of the Viper is 6 to 10 deg from a straight wrist, or joint 3 about 14 deg from a stretched arm, where
M_X,11 is some 100 kg, more than three times the whole robot: a small displacement of the flange is no small rotation of
the joints there, and eq. 11-16 end.
"""
SOFTEST, STIFFEST = 1.0, 1e8  # N/m, along a line: beyond these a unit has slipped; servos of 20 N m/rad give 100


def _unit(direction: ArrayLike) -> Array:
    """Return a direction, of length 1."""
    u = np.array(numbers("direction", direction, "-"))
    if len(u) != 3 or not np.abs(u).max() > 0.0:
        raise ValueError(f"direction must be three numbers that are not all 0, got {direction!r}")
    u /= np.abs(u).max()
    return np.asarray(u / np.linalg.norm(u))


def _regular(arm: "Arm", angles: Array, where: str) -> None:
    """Raise ValueError if the arm is too near a singularity."""
    condition = arm.condition(angles)
    if not condition <= MAX_CONDITION:
        far = arm.joints[int(np.argmax(np.abs(np.linalg.svd(arm.held_rows(angles))[2][arm.rank - 1])))]
        raise ValueError(
            f"{where} is too near a singularity: with the joints at {np.array2string(angles, precision=4)} the"
            f" condition number of the Jacobian is {condition:.4g}, allowed is at most {MAX_CONDITION:g}; it is joint"
            f" {far!r} that has to turn far"
        )


def reduction(arm: "Arm", angles: ArrayLike, direction: ArrayLike) -> dict[str, float]:
    """Return an arm along a direction at joint `angles`, by the names of the columns of `Approach`.

    Mass, damping and stiffness are elements (1,1) of the cartesian matrices (paper, eq. 12-16), those of a flange that
    is *held* in its other directions. A flange that is free in them is lighter and softer: the effective mass is what
    an impulse along the line meets at first, the effective stiffness is static force over deflection along it. By
    Cauchy-Schwarz they never exceed the held ones. The composite mass is that of all links as one rigid body that
    nothing holds, which stiff position control comes close to (Wang, Dehio and Kheddar, arXiv 2202.12646).

    An arm with more joints than it holds directions moves, held, as its inertia and its springs let it:
    A_X = (J A^-1 J')^-1.

    Raises:
        ValueError: the arm cannot move that way, or is too near a singularity.
    """
    u, M = _unit(direction), arm.mass_matrix(angles)
    J = arm.held_rows(angles)
    _regular(arm, np.asarray(angles, dtype=np.float64), "the place")
    held = np.concatenate([u, np.zeros(len(J) - 3)])
    invert = np.linalg.inv if arm.rank == len(J) else partial(np.linalg.pinv, rcond=1e-12)
    M_X, K_X = invert(J @ np.linalg.solve(M, J.T)), invert((J / arm.stiffness) @ J.T)
    rates = (J / arm.stiffness).T @ K_X @ held  # of the joints at 1 m/s along the line; J^-1 held with six
    if not np.abs(J @ rates - held).max() < 1e-6:
        raise ValueError(f"the arm cannot move along {u}, the direction, without moving in another")
    x = u @ J[:3]
    mass, centre, tensor = arm.composite(angles)
    lever = np.cross(arm.flange(angles)[0] - centre, u)
    return {
        "held": float(held @ M_X @ held), "damping": float(rates @ (arm.damping * rates)),
        "stiffness": float(held @ K_X @ held),
        "effective": float(1 / (x @ np.linalg.solve(M, x))),
        "effective_stiffness": float(1 / (x @ (x / arm.stiffness))),
        "composite": float(1 / (1 / mass + lever @ np.linalg.solve(tensor, lever))),
    }  # fmt: skip


def joint_angles(arm: "Arm", position: ArrayLike, rotation: Array | None, near: ArrayLike) -> Array:
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
    _regular(arm, angles, where)
    return angles


def follow(arm: "Arm", start: ArrayLike, direction: ArrayLike, length: Any) -> Approach:
    """Return the table along a line; see `Arm.along`."""
    unit, angles = _unit(direction), np.array(numbers("start", start, "rad"))
    if not hasattr(length, "__len__"):
        length = number("length", length, "m", above=0, at_most=LONGEST)
        length = np.linspace(0.0, length, max(int(np.ceil(length / SPACING - 1e-9)), 3) + 1)
    places = np.array(numbers("length", length, "m", at_least=0, at_most=LONGEST))
    begin, turned = arm.flange(angles)
    rotation, rows, found = turned if arm.holds_orientation else None, list[dict[str, float]](), list[Array]()
    for place in places:
        angles = joint_angles(arm, begin + place * unit, rotation, angles)
        found.append(angles)
        rows.append(reduction(arm, angles, unit))
    softest, stiffest = (pick(row["stiffness"] for row in rows) for pick in (min, max))
    if not SOFTEST <= softest <= stiffest <= STIFFEST:
        raise ValueError(
            f"along the line the stiffness is {softest:.3g} to {stiffest:.3g} N/m, expected is {SOFTEST:g} to"
            f" {STIFFEST:g}: is joint_stiffness in N m/rad?"
        )
    columns: Any = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    line: Any = {"joint_angles": np.array(found), "joints": arm.joints, "start": begin, "direction": unit}
    return Approach(position=places, **columns, **line)
