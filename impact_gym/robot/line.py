"""A straight line for the flange, the joint angles of its poses, and the table along it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from impact_gym.record import SI, Record
from impact_gym.robot.approach import PITCH, Approach, Pose
from impact_gym.robot.arm import Arm, Array, along_x
from impact_gym.validation import one_of

TOLERANCE = 1e-10
"""Largest error of a pose, m and rad; in reach the optimiser comes to 1e-12 or better."""

MAX_CONDITION = 30.0
"""Largest condition number of the Jacobian.

At 30 joint 5 is 6 to 10 deg from a straight wrist, or joint 3 about 14 deg from a stretched arm, where M_X,11 is some
100 kg, more than three times the whole robot: a small displacement of the flange is no small rotation of the joints
there, and eq. 11-16 end.
"""


@dataclass(frozen=True, slots=True)
class Line(Record):
    """Along +x through the pose of the impact, orientation constant."""

    impact: Pose
    ahead: Annotated[float, SI("m", above=0, at_most=2)] = 0.2505  # from the start to the impact; identified
    behind: Annotated[float, SI("m", above=0, at_most=2)] = 0.08  # beyond it: 16 ms at 1 m/s and a brake take 0.0785 m
    spacing: Annotated[float, SI("m", at_least=1e-4, at_most=2)] = 0.0025  # from row to row of the table, at most

    def __post_init__(self) -> None:
        one_of("Line.impact", self.impact, Pose)
        Record.__post_init__(self)

    def pose(self, travel: float) -> Pose:
        """Return the pose after `travel`, m."""
        at = self.impact
        return Pose(at.x + (travel - self.ahead), at.y, at.z, at.orientation)

    @property
    def travels(self) -> tuple[Array, Array]:
        """Travel of the rows from the start to the impact and from there to the end, m; the impact is in both."""
        before, after = (int(np.ceil(length / self.spacing - 1e-9)) + 1 for length in (self.ahead, self.behind))
        behind = np.linspace(self.ahead, self.ahead + self.behind, max(after, 2))
        return np.linspace(0.0, self.ahead, max(before, 3)), behind


def joint_angles(arm: Arm, pose: Pose, start: Array | None = None) -> Array:
    """Return the joint angles (rad) of `pose`, elbow up, searched from `start` (rad), the angles of a pose nearby.

    Raises:
        ValueError: the robot cannot take the pose within its joint limits, or only near a singularity.
    """
    lower, upper = arm.description.lower_limits.copy(), arm.description.upper_limits
    lower[2] = arm.description.stretched_elbow  # the elbow stays up

    def error(angles: Array) -> Array:
        position, rotation = arm.flange(angles)
        turn = Rotation.from_matrix(rotation @ pose.rotation.T).as_rotvec()
        return np.concatenate([position - pose.position, turn])

    # the Jacobian of `turn` is exactly that of the flange at the solution, and close to it on the way
    if start is None:  # the middle of the workspace, turned towards the pose
        start = np.array([np.arctan2(pose.y, pose.x), -0.7, 3.2, 0.0, PITCH[pose.orientation] - 2.5, 0.0])
    guess, finest = np.clip(start, lower, upper), {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
    solution = least_squares(error, guess, jac=arm.jacobian, bounds=(lower, upper), **finest)
    angles = np.asarray(solution.x)
    miss = float(np.max(np.abs(solution.fun)))
    if miss > TOLERANCE:
        raise ValueError(
            f"the robot cannot reach {pose}: it misses by {miss:.3g} (m or rad); {_reach(arm, pose, lower, upper)}"
        )
    condition = arm.condition(angles)
    if not condition <= MAX_CONDITION:
        degrees = ", ".join(f"{angle:.2f}" for angle in np.degrees(angles))
        raise ValueError(
            f"{pose} is too near a singularity: at joint angles ({degrees}) deg the condition number of the "
            f"Jacobian is {condition:.4g}, allowed is at most {MAX_CONDITION:g}"
        )
    return angles


def _reach(arm: Arm, pose: Pose, lower: Array, upper: Array) -> str:
    """Say what is allowed: how far the wrist centre may be from joint 2, and the limits of all joints (rad)."""
    robot = arm.description
    wrist = pose.position - pose.rotation @ robot.origins[5]
    shoulder = robot.origins[0] + robot.origins[1]
    distance = float(np.hypot(np.hypot(wrist[0], wrist[1]) - shoulder[0], wrist[2] - shoulder[2]))
    nearest, farthest = robot.wrist_distance(float(upper[2])), robot.wrist_distance(float(lower[2]))
    limits = ", ".join(f"{low:.0f} to {high:.0f}" for low, high in np.degrees([lower, upper]).T)
    return (
        f"the wrist centre may be {nearest:.4g} to {farthest:.4g} m from the axis of joint 2 and would be "
        f"{distance:.4g} m; joints may turn {limits} deg (elbow up)"
    )


def follow(arm: Arm, line: Line) -> Approach:
    """Return the approach along `line`; joint angles are found from the impact outwards both ways.

    Raises:
        ValueError: the robot cannot follow it; the message names the first pose that is refused.
    """
    at_impact = joint_angles(arm, line.impact)

    def walk(travels: Sequence[float]) -> list[Array]:
        angles = [at_impact]
        for travel in travels:
            angles.append(joint_angles(arm, line.pose(travel), start=angles[-1]))
        return angles[1:]

    before, behind = line.travels
    travel = np.concatenate([before, behind[1:]])
    angles = np.array([*walk(before[-2::-1].tolist())[::-1], at_impact, *walk(behind[1:].tolist())])
    rows = [along_x(arm, row) for row in angles]
    return Approach(
        travel=travel,
        x=np.array([line.pose(float(place)).x for place in travel]),
        **{name: np.array([row[name] for row in rows]) for name in rows[0]},
        joint_angles=np.degrees(angles),
        y=line.impact.y,
        z=line.impact.z,
        orientation=line.impact.orientation,
        impact_travel=line.ahead,
    )
