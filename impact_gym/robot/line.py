"""A straight line for the flange, and the walk along it that fills the table of an approach."""

from dataclasses import dataclass

import numpy as np

from impact_gym.robot import inverse_kinematics
from impact_gym.robot.approach import Approach
from impact_gym.robot.arm import Arm
from impact_gym.robot.description import Array
from impact_gym.robot.lumped import along_x
from impact_gym.robot.pose import Pose
from impact_gym.validation import WrongTypeError, number


@dataclass(frozen=True, slots=True)
class Line:
    """Along +x through the pose of the impact, orientation constant."""

    impact: Pose
    ahead: float = 0.28  # m, from the start to the impact; identified from the paper's Fig. 13b
    behind: float = 0.1  # m, beyond the impact: 16 ms at 1 m/s and a brake from there at 8 m/s^2 take 0.0785 m
    spacing: float = 0.005  # m, at most, from one row of the table to the next

    def __post_init__(self) -> None:
        if not isinstance(self.impact, Pose):
            raise WrongTypeError(f"Line.impact must be a Pose, got {self.impact!r}")
        for name in ("ahead", "behind", "spacing"):
            object.__setattr__(self, name, number(f"Line.{name}", getattr(self, name), "m", above=0, at_most=2))
        if self.spacing < 1e-4:
            raise ValueError(f"Line.spacing must be at least 0.0001 m, got {self.spacing!r} m")

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


def angles_along(arm: Arm, line: Line) -> tuple[Array, Array]:
    """Return travel (m) and joint angles (rad) of all rows, found from the impact outwards both ways.

    Raises:
        ValueError: the robot cannot follow the line; the message names the first pose that is refused.
    """
    before, behind = line.travels
    at_impact = inverse_kinematics.solve(arm, line.impact)

    def walk(travels: Array) -> list[Array]:
        found = [at_impact]
        for travel in travels:
            found.append(inverse_kinematics.solve(arm, line.pose(float(travel)), start=found[-1]))
        return found[1:]

    angles = [*walk(before[-2::-1])[::-1], at_impact, *walk(behind[1:])]
    return np.concatenate([before, behind[1:]]), np.array(angles)


def follow(arm: Arm, line: Line) -> Approach:
    """Return the approach along `line`.

    Raises:
        ValueError: the robot cannot follow it.
    """
    travel, angles = angles_along(arm, line)
    rows = [along_x(arm, row) for row in angles]
    return Approach(
        travel=travel,
        x=np.array([line.pose(float(place)).x for place in travel]),
        mass=np.array([row.mass for row in rows]),
        damping=np.array([row.damping for row in rows]),
        stiffness=np.array([row.stiffness for row in rows]),
        effective_mass=np.array([row.effective_mass for row in rows]),
        effective_stiffness=np.array([row.effective_stiffness for row in rows]),
        joint_angles=np.degrees(angles),
        y=line.impact.y,
        z=line.impact.z,
        orientation=line.impact.orientation,
        impact_travel=line.ahead,
    )
