"""A place and an orientation of the flange."""

from dataclasses import dataclass
from typing import Annotated, Literal, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from impact_gym.robot.description import Array
from impact_gym.validation import SI, Record

Orientation = Literal["down", "horizontal"]

PITCH = {"down": np.pi, "horizontal": np.pi / 2}
"""Angle of the flange's z axis from the vertical, towards +x, rad."""


@dataclass(frozen=True, slots=True)
class Pose(Record):
    """A place for the flange in the base frame: x forward, z up; the origin is the foot of joint 1's axis.

    Tool down: the flange's z axis is -z; tool horizontal: it is +x, the direction of the approach.
    """

    x: Annotated[float, SI("m")]
    y: Annotated[float, SI("m")]
    z: Annotated[float, SI("m")]
    orientation: Orientation

    def __post_init__(self) -> None:
        Record.__post_init__(self)
        if not isinstance(self.orientation, str) or self.orientation not in get_args(Orientation):
            raise ValueError(f"Pose.orientation must be one of {get_args(Orientation)}, got {self.orientation!r}")

    def __str__(self) -> str:
        return f"x = {self.x:.6g} m, y = {self.y:.6g} m, z = {self.z:.6g} m, tool {self.orientation}"

    @property
    def position(self) -> Array:
        """x, y, z, m."""
        return np.array([self.x, self.y, self.z])

    @property
    def rotation(self) -> Array:
        """Rotation matrix of the flange."""
        return np.asarray(Rotation.from_rotvec([0.0, PITCH[self.orientation], 0.0]).as_matrix())
