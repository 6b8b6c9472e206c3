"""A straight line for the flange, and the walk along it that fills the table of an approach."""

from dataclasses import dataclass, fields
from typing import Annotated

import numpy as np

from impact_gym.robot import inverse_kinematics
from impact_gym.robot.approach import Approach
from impact_gym.robot.arm import Arm
from impact_gym.robot.description import Array
from impact_gym.robot.lumped import Lumped, along_x
from impact_gym.robot.pose import Pose
from impact_gym.validation import SI, Record, one_of


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
        **{field.name: np.array([getattr(row, field.name) for row in rows]) for field in fields(Lumped)},
        joint_angles=np.degrees(angles),
        y=line.impact.y,
        z=line.impact.z,
        orientation=line.impact.orientation,
        impact_travel=line.ahead,
    )
