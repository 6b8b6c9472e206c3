"""Joint angles that put the flange where it should be, elbow up; refused where the robot cannot go or barely can."""

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from impact_gym.robot.arm import Arm
from impact_gym.robot.description import Array
from impact_gym.robot.pose import PITCH, Pose

TOLERANCE = 1e-10
"""Largest error of a pose, m and rad; in reach the optimiser comes to 1e-12 or better."""

MAX_CONDITION = 30.0
"""Largest condition number of the Jacobian.

Its rotations are scaled by the length of the upper arm, which makes all its rows velocities. At 30 joint 5 is 6 to
10 deg from a straight wrist, or joint 3 about 14 deg from a stretched arm, where M_X,11 is some 100 kg, more than three
times the whole robot: a small displacement of the flange is no small rotation of the joints there, and eq. 11-16 end.
"""


def condition(arm: Arm, angles: Array) -> float:
    """Return the condition number of the Jacobian at `angles` (rad), its rotations scaled by the upper arm."""
    scale = np.repeat([1.0, arm.description.upper_arm], 3)
    return float(np.linalg.cond(scale[:, None] * arm.jacobian(angles)))


def solve(arm: Arm, pose: Pose, start: Array | None = None) -> Array:
    """Return the joint angles (rad) of `pose`, elbow up, searched from `start` (rad), the angles of a pose nearby.

    Raises:
        ValueError: the robot cannot take the pose within its joint limits, or only near a singularity.
    """
    lower, upper = _limits(arm)

    def error(angles: Array) -> Array:
        position, rotation = arm.flange(angles)
        turn = Rotation.from_matrix(rotation @ pose.rotation.T).as_rotvec()
        return np.concatenate([position - pose.position, turn])

    # the Jacobian of `turn` is exactly that of the flange at the solution, and close to it on the way
    if start is None:  # the middle of the workspace, turned towards the pose
        start = np.array([np.arctan2(pose.y, pose.x), -0.7, 3.2, 0.0, PITCH[pose.orientation] - 2.5, 0.0])
    guess, finest = np.clip(start, lower, upper), {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
    found = least_squares(error, guess, jac=arm.jacobian, bounds=(lower, upper), **finest)
    angles = np.asarray(found.x)
    miss = float(np.max(np.abs(found.fun)))
    if miss > TOLERANCE:
        raise ValueError(f"the robot cannot reach {pose}: it misses by {miss:.3g} (m or rad){_why(arm, pose)}")
    reached = condition(arm, angles)
    if not reached <= MAX_CONDITION:
        degrees = ", ".join(f"{angle:.2f}" for angle in np.degrees(angles))
        raise ValueError(
            f"{pose} is too near a singularity: at joint angles ({degrees}) deg the condition number of the "
            f"Jacobian is {reached:.4g}, allowed is at most {MAX_CONDITION:g}"
        )
    return angles


def _limits(arm: Arm) -> tuple[Array, Array]:
    """Joint limits, rad, that of joint 3 raised to keep the elbow up."""
    lower = arm.description.lower_limits.copy()
    lower[2] = arm.description.stretched_elbow
    return lower, arm.description.upper_limits


def _why(arm: Arm, pose: Pose) -> str:
    """Say what is allowed: how far the wrist centre may be from joint 2, and the limits of all joints."""
    robot = arm.description
    lower, upper = _limits(arm)
    wrist = pose.position - pose.rotation @ robot.origins[5]
    shoulder = robot.origins[0] + robot.origins[1]
    distance = float(np.hypot(np.hypot(wrist[0], wrist[1]) - shoulder[0], wrist[2] - shoulder[2]))
    nearest, farthest = robot.wrist_distance(float(upper[2])), robot.wrist_distance(float(lower[2]))
    limits = ", ".join(f"{low:.0f} to {high:.0f}" for low, high in np.degrees(np.array([lower, upper])).T)
    return (
        f"; the wrist centre may be {nearest:.4g} to {farthest:.4g} m from the axis of joint 2 and would be "
        f"{distance:.4g} m; joints may turn {limits} deg (elbow up)"
    )
