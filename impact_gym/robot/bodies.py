"""The bodies of an arm, and their model in MuJoCo."""

import importlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from impact_gym.robot.approach import Array

LEAST_MASS, LEAST_INERTIA = 1e-9, 1e-15  # kg and kg m^2, least mass and least principal moment of inertia of a body
LARGEST_GYRATION = 3.0  # m, largest radius of gyration, or the arm's reach if larger; inertia in kg mm^2 exceeds both
ROUNDING = 1e-6  # fraction by which a moment of inertia may exceed the sum of the others; files have about six digits


class Body(NamedTuple):
    """A joint of an arm, and the links, welded together, that the joint moves."""

    joint: str  # name of the joint
    unit: str  # of the joint's position, rad or m
    low: float  # lower limit of the joint's position
    high: float  # upper limit of the joint's position
    place: Array  # pose of the joint in the frame of the previous body, a homogeneous matrix (4, 4)
    axis: Array  # axis of the joint, of length 1, (3,)
    links: dict[str, Array]  # pseudo-inertia of each link in the joint's frame, (4, 4), see `urdf`


def specification(bodies: Sequence[Body], tip: Array, balanced: bool) -> tuple[Any, Any]:
    """Return the module mujoco, and an MjSpec of a chain of bodies; `tip` (4, 4): flange's pose in the last body."""
    try:
        mujoco: Any = importlib.import_module("mujoco")  # by name, so that types are checked without MuJoCo
    except ImportError as missing:
        raise ImportError(
            "computing a robot needs MuJoCo: pip install 'impact-gym[robot]' (the shipped table does not need it)"
        ) from missing
    reach = sum(float(np.linalg.norm(place[:3, 3])) for place in (*(body.place for body in bodies), tip))
    made, kinds = mujoco.MjSpec(), mujoco.mjtJoint
    last = made.worldbody
    for body in bodies:
        inertia = _inertia(body, reach, balanced)
        last = last.add_body(pos=body.place[:3, 3], quat=_quaternion(body.place), **inertia)
        last.add_joint(axis=body.axis, type=kinds.mjJNT_SLIDE if body.unit == "m" else kinds.mjJNT_HINGE)
    last.add_body(name="tip", pos=tip[:3, 3], quat=_quaternion(tip))
    return mujoco, made


def _inertia(body: Body, reach: float, balanced: bool) -> dict[str, Any]:
    """Return mass and inertia of a body as arguments of MuJoCo's `add_body`; `reach`: of the arm, m."""
    total = np.sum(list(body.links.values()), axis=0)  # only the sum is checked: a link may be a frame or a point mass
    mass, centre = float(total[3, 3]), total[:3, 3] / max(total[3, 3], LEAST_MASS)
    if not mass >= LEAST_MASS:
        raise ValueError(
            f"link {next(iter(body.links))!r}, which joint {body.joint!r} moves, must have at least {LEAST_MASS:g} kg"
            f" with all that is welded to it, got {mass:g} kg"
        )
    spread, axes = np.linalg.eigh(total[:3, :3] - mass * np.outer(centre, centre))  # second moments along `axes`
    least, middle, most = (spread.sum() - spread[::-1]).tolist()
    first, *others = [repr(link) for link, part in body.links.items() if part.any()]
    what = f"link {first}" + (f" with {', '.join(others)} welded to it" if others else "")
    found = f"{what} has principal moments of inertia of {least:.6g}, {middle:.6g} and {most:.6g} kg m^2"
    if not least >= LEAST_INERTIA:
        raise ValueError(f"{found}: each must be above 0, at least {LEAST_INERTIA:g}")
    if most <= (1.0 + ROUNDING) * (least + middle):
        spread = np.maximum(spread, 1e-12 * spread.sum())  # MuJoCo refuses even such a rounding error
        moments = spread.sum() - spread
    elif balanced:
        moments = np.full(3, spread.sum() * 2.0 / 3.0)
    else:
        raise ValueError(f'{found}: each must be at most the sum of the others; inertia="balanced" uses the mean')
    if (gyration := np.sqrt(most / mass)) > max(LARGEST_GYRATION, reach):
        raise ValueError(f"{found}, a radius of gyration of {gyration:.3g} m with {mass:g} kg: is it in kg m^2?")
    turn = _quaternion(axes * np.sign(np.linalg.det(axes)))
    return {"mass": mass, "ipos": centre, "iquat": turn, "inertia": moments, "explicitinertial": True}


def _quaternion(place: Array) -> Array:
    """Return the quaternion of a rotation or a pose, the real part first."""
    return np.roll(Rotation.from_matrix(place[:3, :3]).as_quat(), 1)
