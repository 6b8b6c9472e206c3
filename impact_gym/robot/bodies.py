"""The bodies of an arm, and their model in MuJoCo."""

import importlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from impact_gym.robot.line_table import Array

LEAST_MASS, LEAST_INERTIA = 1e-9, 1e-15  # kg and kg m^2, least mass and least principal moment of inertia of a body
NO_INERTIA = 1e-15  # kg and kg m^2, for a body without mass: MuJoCo compiles nothing less, `Arm` then sets 0
LARGEST_GYRATION = 3.0  # m; if a radius of gyration exceeds this and the arm's reach, inertia is probably in kg mm^2
ROUNDING = 1e-6  # a moment of inertia may exceed the sum of the two others by this fraction, as files are rounded


class Body(NamedTuple):
    """A joint of an arm and the rigid body that it moves, which consists of links welded together."""

    joint: str  # name of the joint
    unit: str  # of the joint's position, rad or m
    low: float  # lower limit of the joint's position
    high: float  # upper limit of the joint's position
    pose: Array  # pose of the joint in the frame of the previous body, a homogeneous matrix (4, 4)
    axis: Array  # axis of the joint, of length 1, (3,)
    links: dict[str, Array]  # pseudo-inertia of each link in the joint's frame, (4, 4), see `urdf`

    @property
    def inertia(self) -> Array:
        """Pseudo-inertia of all links together, (4, 4); all zero: no link has mass."""
        return np.asarray(np.sum(list(self.links.values()), axis=0))


def specification(bodies: Sequence[Body], tip: Array, balanced: bool) -> tuple[Any, Any]:
    """Return the module mujoco and the arm's MjSpec; `tip` (4, 4): pose of the flange in the frame of the last body."""
    try:
        mujoco: Any = importlib.import_module("mujoco")  # imported by name, so that type checks run without MuJoCo
    except ImportError as missing:
        raise ImportError(
            "computing a robot needs MuJoCo: pip install 'impact-gym[robot]' (default_approach() works without it)"
        ) from missing
    reach = sum(float(np.linalg.norm(pose[:3, 3])) for pose in (*(body.pose for body in bodies), tip))
    made, kinds = mujoco.MjSpec(), mujoco.mjtJoint
    last = made.worldbody
    for body in bodies:
        inertia = _inertia(body, reach, balanced)
        last = last.add_body(pos=body.pose[:3, 3], quat=_quaternion(body.pose), **inertia)
        last.add_joint(axis=body.axis, type=kinds.mjJNT_SLIDE if body.unit == "m" else kinds.mjJNT_HINGE)
    last.add_body(name="tip", pos=tip[:3, 3], quat=_quaternion(tip))
    return mujoco, made


def _inertia(body: Body, reach: float, balanced: bool) -> dict[str, Any]:
    """Return a body's mass and inertia as arguments of MuJoCo's `add_body`; `reach` (m): the stretched arm's length."""
    total = body.inertia  # only the sum is checked, as a link may have no mass or inertia
    if not total.any():
        return {"mass": NO_INERTIA, "inertia": np.full(3, NO_INERTIA), "explicitinertial": True}
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
        raise ValueError(f"{found}: each must be above 0 (at least {LEAST_INERTIA:g} kg m^2)")
    if most <= (1.0 + ROUNDING) * (least + middle):
        spread = np.maximum(spread, 1e-12 * spread.sum())  # MuJoCo refuses even an excess within ROUNDING
        moments = spread.sum() - spread
    elif balanced:
        moments = np.full(3, spread.sum() * 2.0 / 3.0)
    else:
        raise ValueError(f'{found}: each must be at most the sum of the others; inertia="balanced" uses the mean')
    if (gyration := np.sqrt(most / mass)) > max(LARGEST_GYRATION, reach):
        raise ValueError(f"{found}, a radius of gyration of {gyration:.3g} m at {mass:g} kg: is the inertia in kg m^2?")
    turn = _quaternion(axes * np.sign(np.linalg.det(axes)))
    return {"mass": mass, "ipos": centre, "iquat": turn, "inertia": moments, "explicitinertial": True}


def _quaternion(pose: Array) -> Array:
    """Return the quaternion of a rotation or a pose, the real part first."""
    return np.roll(Rotation.from_matrix(pose[:3, :3]).as_quat(), 1)
