"""A table of a robot's mass, damping and stiffness along a straight approach, and its JSON file."""

import json
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from impact_gym.parameters import SI, Parameters
from impact_gym.scene import Robot, RobotTable
from impact_gym.support.files import parsed, write_file
from impact_gym.support.validation import array, choice, shown

Array = NDArray[np.float64]
SHIPPED = Path(__file__).with_name("default_approach.json")
IMPACT = 0.2505  # m, from the start of the shipped approach to the object; inferred, see docs/provenance.md

COLUMNS = ("position", "held", "damping", "stiffness", "effective", "effective_stiffness", "composite")

Mass = Literal["held", "effective", "composite"]


@dataclass(frozen=True, eq=False)
class LineTable(Parameters):
    """A robot on a line, as a table with a row for each position; the masses do not include a tool."""

    position: Annotated[Array, SI("m")]  # distance of the imposed motion from its start, rising from 0
    held: Annotated[Array, SI("kg")]  # held mass m_r = M_X,11 of the Cartesian mass matrix M_X (paper, eq. 12 and 16)
    damping: Annotated[Array, SI("N s/m")]  # c_r = D_X,11 of the Cartesian damping matrix D_X (paper, eq. 13 and 16)
    stiffness: Annotated[Array, SI("N/m")]  # k_r = K_X,11 of the Cartesian stiffness matrix K_X (paper, eq. 14 and 16)
    effective: Annotated[Array, SI("kg")]  # effective mass 1/(M_X^-1)_11, see `Arm.reduction`
    effective_stiffness: Annotated[Array, SI("N/m")]  # stiffness for a free flange, 1/(K_X^-1)_11, see `Arm.reduction`
    composite: Annotated[Array, SI("kg")]  # effective mass of all links as one free rigid body, see `Arm.reduction`
    joint_angles: Array  # (rows, joints), rad or, for prismatic joints, m
    joints: tuple[str, ...]  # names of the joints
    start: Annotated[Array, SI("m")]  # position of the flange at the start, in the base's frame, (3,)
    direction: Annotated[Array, SI("-")]  # direction of the line, of length 1, (3,)

    def __post_init__(self) -> None:
        Parameters.__post_init__(self)
        rows = len(self.position)
        if rows < 4 or np.any(np.diff(self.position) <= 0) or self.position[0] != 0:
            raise ValueError(f"LineTable.position must be at least 4 numbers in m rising from 0, got {self.position!r}")
        shapes = dict.fromkeys(COLUMNS, (rows,)) | {"start": (3,), "direction": (3,)}
        for name, shape in (shapes | {"joint_angles": (rows, len(self.joints))}).items():
            values = array(f"LineTable.{name}", getattr(self, name), shape).astype(np.float64)
            if not np.isfinite(values).all():
                raise ValueError(f"LineTable.{name} must be finite, in rad or m, got {shown(values)}")
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    def robot_table(self, mass: Mass = "held") -> RobotTable:
        """Return the robot with parameters that vary along the line; `mass` is "held", "effective" or "composite".

        With "effective" the stiffness is `effective_stiffness`; the damping is reduced in the ratio of the stiffnesses.
        """
        choice("mass", mass, get_args(Mass))
        stiffness, damping = self.stiffness, self.damping
        if mass == "effective":
            stiffness, damping = self.effective_stiffness, damping * self.effective_stiffness / stiffness
        return RobotTable(*(tuple(c.tolist()) for c in (self.position, getattr(self, mass), stiffness, damping)))

    def at(self, position: float, mass: Mass = "held") -> Robot:
        """Return the robot with the parameters at `position` (m) along the line."""
        return self.robot_table(mass).at(position)


@cache
def default_approach() -> LineTable:
    """Return the shipped table, computed by `impact_gym.robot.viper`; needs no MuJoCo."""
    return read(SHIPPED)


def read(path: Path) -> LineTable:
    """Return the approach in a file that `write` wrote."""
    content = parsed(path, "JSON", json.loads)
    of_line = {field.name: content[field.name] for field in fields(LineTable)}
    return LineTable(**of_line | {"joints": tuple(of_line["joints"])})


def write(path: Path, approach: LineTable, provenance: dict[str, Any]) -> None:
    """Write `approach` and its provenance to `path` atomically; each field is a line, and floats keep all digits."""
    content = {"provenance": provenance, **vars(approach)}
    lines = [f'"{name}": {json.dumps(value, default=np.ndarray.tolist)}' for name, value in content.items()]
    write_file(path, "{\n" + ",\n".join(lines) + "\n}\n")
