"""The bodies of an arm. A body is a joint with the links that it moves and that are welded together.

Only the total inertia of the welded links is checked, because one of them may be a mere frame or a point mass.
"""

import importlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from impact_gym.robot.approach import Array

LEAST_MASS, LEAST_INERTIA = 1e-9, 1e-15  # least allowed values of a body, kg and kg m^2
LARGEST_GYRATION = 3.0
"""m, largest radius of gyration of a body, unless the arm's reach is larger; it detects inertia given in kg mm^2."""
ROUNDING = 1e-6
"""The largest moment of inertia may exceed the sum of the two others by this fraction: files have about six digits."""


class Body(NamedTuple):
    """A joint of an arm, and the rigid body that it moves."""

    joint: str  # name
    unit: str  # of the joint's position, rad or m
    low: float  # limits of that position
    high: float
    place: Array  # pose of the joint in the frame of the previous body, homogeneous, (4, 4)
    axis: Array  # axis of the joint, of length 1, (3,)
    mass: float  # kg
    moments: Array  # principal moments of inertia, kg m^2, (3,)
    axes: Array  # principal axes of inertia and centre of mass, homogeneous, (4, 4)


def pseudo_inertia(mass: float, tensor: Array, place: Array) -> Array:
    """Return the pseudo-inertia J (4, 4): the integral of r r' over a link's mass, r = (x, y, z, 1) in its frame.

    In a frame in which the link has the pose T, the pseudo-inertia is T J T'. In a common frame the pseudo-inertias of
    welded links add up (Wensing, Kim and Slotine, IEEE Robotics and Automation Letters 3, 2018).

    Args:
        mass: kg.
        tensor: tensor of inertia about the centre of mass, kg m^2, (3, 3).
        place: position of the centre of mass and directions of the tensor's axes, homogeneous, (4, 4).
    """
    own = np.zeros((4, 4))
    own[:3, :3], own[3, 3] = np.trace(tensor) / 2 * np.eye(3) - tensor, mass
    return place @ own @ place.T


def welded_body(joint: str, links: Mapping[str, Array], reach: float, balanced: bool) -> tuple[float, Array, Array]:
    """Return mass, principal moments and axes of the body that a joint moves, as in `Body`.

    Args:
        joint: name of the joint.
        links: pseudo-inertia of each link in the joint's frame.
        reach: reach of the arm, m.
        balanced: whether all three moments of inertia are set to their mean if one exceeds the sum of the others.

    Raises:
        ValueError: no rigid body has such an inertia, or its units seem wrong; the message names the links.
    """
    total = np.sum(list(links.values()), axis=0)
    mass, centre = float(total[3, 3]), total[:3, 3] / max(total[3, 3], LEAST_MASS)
    if not mass >= LEAST_MASS:
        raise ValueError(
            f"link {next(iter(links))!r}, which joint {joint!r} moves, must have at least {LEAST_MASS:g} kg with all"
            f" that is welded to it, got {mass:g} kg"
        )
    spread, axes = np.linalg.eigh(total[:3, :3] - mass * np.outer(centre, centre))  # second moments along the axes
    least, middle, most = (spread.sum() - spread[::-1]).tolist()
    first, *others = [repr(link) for link, part in links.items() if part.any()]
    what = f"link {first}" + (f" with {', '.join(others)} welded to it" if others else "")
    found = f"{what} has principal moments of inertia of {least:.6g}, {middle:.6g} and {most:.6g} kg m^2"
    if not least >= LEAST_INERTIA:
        raise ValueError(f"{found}: each must be above 0, at least {LEAST_INERTIA:g}")
    if most <= (1.0 + ROUNDING) * (least + middle):
        spread = np.maximum(spread, 1e-12 * spread.sum())  # MuJoCo refuses moments that break the rule by rounding
        moments = spread.sum() - spread
    elif balanced:
        moments = np.full(3, spread.sum() * 2.0 / 3.0)
    else:
        raise ValueError(
            f'{found}: each must be at most the sum of the others; inertia="balanced" sets all three to their mean'
        )
    if (gyration := np.sqrt(most / mass)) > max(LARGEST_GYRATION, reach):
        raise ValueError(f"{found}, a radius of gyration of {gyration:.3g} m with {mass:g} kg: is it in kg m^2?")
    inertial = np.eye(4)
    inertial[:3, :3], inertial[:3, 3] = axes * np.sign(np.linalg.det(axes)), centre
    return mass, moments, inertial


def specification(bodies: Sequence[Body], tip: Array) -> tuple[Any, Any]:
    """Return the module mujoco, and an MjSpec of a chain of bodies; `tip` is the flange's pose in the last body (4, 4).

    Raises:
        ImportError: MuJoCo is not installed.
    """
    try:
        mujoco: Any = importlib.import_module("mujoco")  # by name, so that types are checked without MuJoCo
    except ImportError as missing:
        raise ImportError(
            "computing a robot needs MuJoCo: pip install 'impact-gym[robot]' (the shipped table does not need it)"
        ) from missing

    def pose(place: Array) -> tuple[Array, Array]:  # position, and quaternion with the real part first
        return place[:3, 3], np.roll(Rotation.from_matrix(place[:3, :3]).as_quat(), 1)

    made = mujoco.MjSpec()
    last, kinds = made.worldbody, mujoco.mjtJoint
    for body in bodies:
        (place, turn), (centre, axes) = pose(body.place), pose(body.axes)
        last = last.add_body(
            pos=place, quat=turn, mass=body.mass, ipos=centre, iquat=axes, inertia=body.moments, explicitinertial=True
        )
        last.add_joint(axis=body.axis, type=kinds.mjJNT_SLIDE if body.unit == "m" else kinds.mjJNT_HINGE)
    place, turn = pose(tip)
    last.add_body(name="tip", pos=place, quat=turn)
    return mujoco, made
