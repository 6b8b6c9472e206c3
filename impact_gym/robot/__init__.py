"""Compute a robot's mass, damping and stiffness along an approach from its joints (paper, section 3.1, eq. 10-16).

    default_approach() -> LineTable         the shipped table: Viper s650, with the paper's mass at the impact
    LineTable.robot_table(), .at(position)  the robot of a Scene; `mass` chooses one of three kinds of mass

These functions need MuJoCo (pip install 'impact-gym[robot]'):

    from_urdf(path, base, tip) -> Arm       any serial arm; viper.viper() is the paper's arm, with estimated inertia
    Arm.along(start, direction, length)     -> LineTable, the table along a line through the flange
    all_joints.simulate(arm, line, scene)   simulates a blow with all joints, to find the table's error
"""

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from impact_gym.robot import urdf
from impact_gym.robot.arm import Arm, joint_angles
from impact_gym.robot.line_table import IMPACT, Array, LineTable, default_approach
from impact_gym.support.files import parsed
from impact_gym.support.validation import choice, number, numbers, one_of, unit_text, whole

__all__ = ["IMPACT", "Arm", "LineTable", "default_approach", "from_urdf", "joint_angles"]

PerJoint = float | Sequence[float] | Sequence[tuple[float, float]]
"""A number, or a pair (low, high) from which a number is drawn log-uniformly; one for all joints, or one per joint."""


def from_urdf(
    path: Path | str, base: str, tip: str, *, joint_stiffness: PerJoint, joint_damping: PerJoint,
    rotor_inertia: PerJoint | None = None, gear: PerJoint | None = None, seed: int = 0, inertia: str = "given",
) -> Arm:  # fmt: skip
    """Return the arm between two links of a URDF file; each joint is elastic between its motor and its link.

    Args:
        path: the URDF file; its mesh files are not needed.
        base: name of the fixed link; links above it are ignored.
        tip: name of the link at the end of the arm; its frame is the flange.
        joint_stiffness: N m/rad, for prismatic joints N/m: see `PerJoint`. For an arm of two joints, two numbers are
            one number for each joint, not a pair.
        joint_damping: N m s/rad, for prismatic joints N s/m: see `PerJoint`.
        rotor_inertia: inertia of the motors' rotors, kg m^2, for prismatic joints kg; only the servo of
            `all_joints.simulate` needs it.
        gear: turns of the rotor per turn of the joint; None: 1.
        seed: seed of the random draws from pairs.
        inertia: "given" or "balanced". A principal moment of inertia of a body (a link with all links welded to it)
            cannot exceed the sum of the two others. "given" refuses a body that breaks this rule. "balanced" replaces
            the three moments of such a body by their mean, as MuJoCo's `balanceinertia` does.

    Raises:
        TypeError, ValueError: the file describes no serial arm from `base` to `tip`, or an argument is invalid.
        ImportError: MuJoCo is not installed.

    Warns:
        UserWarning: a joint of the arm moves a link without mass; a link that the arm moves has inertia but no mass, so
            its inertia is left out; a joint outside the arm mimics a joint of the arm, but is held at zero; a joint has
            limits beyond 10 rad or 10 m.
    """
    choice("inertia", inertia, ("given", "balanced"))
    one_of("path", path, str, Path)
    one_of("base", base, str)
    one_of("tip", tip, str)
    rng = np.random.default_rng(whole("seed", seed, at_least=0))
    remarks = list[str]()
    arm = parsed(
        Path(path), "URDF", lambda xml: Arm(*urdf.read(xml, base, tip, remarks), inertia == "balanced"), decode=bytes
    )
    for remark in remarks:
        warnings.warn(remark, UserWarning, stacklevel=2)
    arm.stiffness = _per_joint("joint_stiffness", joint_stiffness, arm.count, rng, "N m/rad", above=0)
    arm.damping = _per_joint("joint_damping", joint_damping, arm.count, rng, "N m s/rad", at_least=0)
    rotors = 0.0 if rotor_inertia is None else rotor_inertia
    turns = _per_joint("gear", 1.0 if gear is None else gear, arm.count, rng, "-", above=0)
    arm.rotors = _per_joint("rotor_inertia", rotors, arm.count, rng, "kg m^2", at_least=0) * turns**2
    return arm


def _per_joint(name: str, given: Any, count: int, rng: np.random.Generator, unit: str, **limits: float) -> Array:
    if not hasattr(given, "__len__") or isinstance(given, (str, Mapping)):
        return np.full(count, number(name, given, unit, **limits))
    each = [given] * count if len(given) == 2 != count else given
    if len(each) != count:
        allowed = f"one number or pair, or {count} numbers or pairs (one per joint) {unit_text(unit, 'in ')}"
        raise ValueError(f"{name} must be {allowed}, got {given!r}")
    if not all(hasattr(pair, "__len__") and len(pair) == 2 for pair in each):
        return np.array(numbers(name, each, unit, **limits))
    low, high = (numbers(name, ends, unit, **limits) for ends in zip(*each, strict=True))
    if not all(0.0 < a <= b for a, b in zip(low, high, strict=True)):
        allowed = f"pairs (low, high) with 0 < low <= high {unit_text(unit, 'in ')}"
        raise ValueError(f"{name} must have {allowed}, got {given!r}")
    return np.asarray(np.exp(rng.uniform(np.log(low), np.log(high))))
