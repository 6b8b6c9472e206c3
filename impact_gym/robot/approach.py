"""The robot along a straight approach as a table, and the file it is kept in."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from impact_gym.files import parsed, write_file
from impact_gym.record import SI, Record
from impact_gym.robot.arm import JOINTS, Array
from impact_gym.scene import Robot, RobotTable
from impact_gym.validation import WrongTypeError, numbers

SHIPPED = Path(__file__).with_name("default_approach.json")

COLUMNS = {
    "travel": "travel_m", "x": "x_m", "mass": "m_r_kg", "damping": "c_r_N_s_per_m", "stiffness": "k_r_N_per_m",
    "effective_mass": "effective_mass_kg", "effective_stiffness": "effective_stiffness_N_per_m",
}  # fmt: skip
"""Name in the file of each field; the joint angles follow as q1_deg to q6_deg."""
HEADER = [*COLUMNS.values(), *(f"q{joint + 1}_deg" for joint in range(JOINTS))]

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


@dataclass(frozen=True, eq=False)
class Approach(Record):
    """The flange on a straight line along +x at constant y, z and orientation; arrays with a row per place.

    The mass is that of the bare robot: a tool's own mass comes on top (paper: 'simply adds').
    """

    travel: Annotated[Array, SI("m")]  # of the imposed motion from its start, rising from 0
    x: Annotated[Array, SI("m")]  # of the flange in the base frame
    mass: Annotated[Array, SI("kg")]  # m_r = M_X,11 (paper, eq. 12 and 16)
    damping: Annotated[Array, SI("N s/m")]  # c_r = D_X,11 (paper, eq. 13 and 16)
    stiffness: Annotated[Array, SI("N/m")]  # k_r = K_X,11 (paper, eq. 14 and 16)
    effective_mass: Annotated[Array, SI("kg")]  # 1/(M_X^-1)_11
    effective_stiffness: Annotated[Array, SI("N/m")]  # 1/(K_X^-1)_11
    joint_angles: Array  # deg, (rows, 6)
    y: Annotated[float, SI("m")]
    z: Annotated[float, SI("m")]
    orientation: Orientation
    impact_travel: Annotated[float, SI("m")]  # where the object's face is; one of `travel`

    def __post_init__(self) -> None:
        Record.__post_init__(self)
        for name in COLUMNS:
            self._store(name, getattr(self, name))
        rows = len(self.travel)
        if rows < 4 or np.any(np.diff(self.travel) <= 0) or self.travel[0] != 0:
            raise ValueError(f"Approach.travel must be at least 4 numbers in m rising from 0, got {self.travel!r}")
        for name in COLUMNS:
            if len(getattr(self, name)) != rows:
                raise ValueError(f"Approach.{name} must have a value for each of the {rows} places of travel")
        if not hasattr(given := self.joint_angles, "__len__"):
            raise WrongTypeError(f"Approach.joint_angles must be rows of {JOINTS} numbers in deg, got {given!r}")
        angles = [numbers(f"Approach.joint_angles[{row}]", q, "deg") for row, q in enumerate(given)]
        if len(angles) != rows or any(len(q) != JOINTS for q in angles):
            raise ValueError(f"Approach.joint_angles must be {rows} rows of {JOINTS} numbers in deg")
        self._store("joint_angles", angles)
        if (at := self.impact_travel) not in self.travel:
            raise ValueError(f"Approach.impact_travel must be one of its places of travel, got {at!r} m")
        Pose(float(self.x[self.impact_row]), self.y, self.z, self.orientation)  # refuses any other orientation

    def _store(self, name: str, values: Any) -> None:
        array = np.array(values, dtype=float)
        array.flags.writeable = False
        object.__setattr__(self, name, array)

    @property
    def impact_row(self) -> int:
        """Row of the table in which the impact happens."""
        return int(np.flatnonzero(self.travel == self.impact_travel)[0])

    def robot_table(self) -> RobotTable:
        """Return the robot whose parameters vary along the approach."""
        columns = (self.travel, self.mass, self.stiffness, self.damping)
        return RobotTable(*(tuple(map(float, column)) for column in columns))

    def at_impact(self) -> Robot:
        """Return the robot frozen as it is at the impact."""
        row = self.impact_row
        return Robot(float(self.mass[row]), float(self.stiffness[row]), float(self.damping[row]))


@cache
def default_approach() -> Approach:
    """Return the shipped table, chosen as `impact_gym.robot.choice` tells; needs no MuJoCo."""
    return read(SHIPPED)


def read(path: Path) -> Approach:
    """Read an approach that `write` wrote."""
    data = parsed(path, "JSON", json.loads)
    if data["columns"] != HEADER:
        raise ValueError(f"{path} must have the columns {HEADER}, got {data['columns']}")
    rows, line = np.array(data["rows"], dtype=float), data["line"]
    return Approach(
        **dict(zip(COLUMNS, rows.T[: len(COLUMNS)], strict=True)),
        joint_angles=rows[:, len(COLUMNS) :],
        y=line["y_m"],
        z=line["z_m"],
        orientation=line["orientation"],
        impact_travel=line["impact_travel_m"],
    )


def write(path: Path, approach: Approach, provenance: dict[str, Any]) -> None:
    """Write `approach` and where it comes from to `path`: all of it or nothing, one line per row, no digit lost."""
    line = {
        "y_m": approach.y, "z_m": approach.z, "orientation": approach.orientation,
        "impact_travel_m": approach.impact_travel,
    }  # fmt: skip
    head = json.dumps({"provenance": provenance, "line": line, "columns": HEADER}, indent=2)
    table = np.column_stack([*(getattr(approach, name) for name in COLUMNS), approach.joint_angles])
    rows = ",\n".join("    " + json.dumps(row) for row in table.tolist())
    write_file(path, head.removesuffix("\n}") + ',\n  "rows": [\n' + rows + "\n  ]\n}\n")
