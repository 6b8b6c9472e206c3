"""The robot along a straight approach as a table, and the file it is kept in."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np

from impact_gym.files import parsed, write_file
from impact_gym.record import SI, Record
from impact_gym.robot.arm import Array
from impact_gym.scene import Robot, RobotTable
from impact_gym.validation import WrongTypeError, choice, numbers

SHIPPED = Path(__file__).with_name("default_approach.json")

COLUMNS = {
    "travel": "travel_m", "mass": "m_r_kg", "damping": "c_r_N_s_per_m", "stiffness": "k_r_N_per_m",
    "effective_mass": "effective_mass_kg", "effective_stiffness": "effective_stiffness_N_per_m",
    "composite_mass": "composite_mass_kg",
}  # fmt: skip
"""Name in the file of each field; the joint angles follow under the joints' names."""

Mass = Literal["held", "effective", "composite"]


@dataclass(frozen=True, eq=False)
class Approach(Record):
    """The flange on a straight line at constant orientation; arrays with a row per place.

    The masses are those of the bare robot: a tool's own mass comes on top (paper: 'simply adds').
    """

    travel: Annotated[Array, SI("m")]  # of the imposed motion from its start, rising from 0
    mass: Annotated[Array, SI("kg")]  # held: m_r = M_X,11 (paper, eq. 12 and 16)
    damping: Annotated[Array, SI("N s/m")]  # c_r = D_X,11 (paper, eq. 13 and 16)
    stiffness: Annotated[Array, SI("N/m")]  # k_r = K_X,11 (paper, eq. 14 and 16)
    effective_mass: Annotated[Array, SI("kg")]  # 1/(M_X^-1)_11
    effective_stiffness: Annotated[Array, SI("N/m")]  # 1/(K_X^-1)_11
    composite_mass: Annotated[Array, SI("kg")]  # of all links as one body, see `along`
    joint_angles: Array  # rad, m for prismatic joints, (rows, n)
    joints: tuple[str, ...]  # names
    start: Annotated[Array, SI("m")]  # of the flange in the base's frame, (3,)
    direction: Annotated[Array, SI("-")]  # of length 1, (3,)
    impact_travel: Annotated[float, SI("m")]  # where the object's face is; one of `travel`

    def __post_init__(self) -> None:
        Record.__post_init__(self)
        for name in (*COLUMNS, "start", "direction"):
            self._store(name, getattr(self, name))
        rows = len(self.travel)
        if rows < 4 or np.any(np.diff(self.travel) <= 0) or self.travel[0] != 0:
            raise ValueError(f"Approach.travel must be at least 4 numbers in m rising from 0, got {self.travel!r}")
        for name in COLUMNS:
            if len(getattr(self, name)) != rows:
                raise ValueError(f"Approach.{name} must have a value for each of the {rows} places of travel")
        if len(self.start) != 3 or len(self.direction) != 3:
            raise ValueError("Approach.start and Approach.direction must be three numbers each")
        if not hasattr(given := self.joint_angles, "__len__"):
            raise WrongTypeError(
                f"Approach.joint_angles must be rows of {len(self.joints)} numbers in rad, got {given!r}"
            )
        angles = [numbers(f"Approach.joint_angles[{row}]", q, "rad") for row, q in enumerate(given)]
        if len(angles) != rows or any(len(q) != len(self.joints) for q in angles):
            raise ValueError(f"Approach.joint_angles must be {rows} rows of {len(self.joints)} numbers in rad")
        self._store("joint_angles", angles)
        if (at := self.impact_travel) not in self.travel:
            raise ValueError(f"Approach.impact_travel must be one of its places of travel, got {at!r} m")

    def _store(self, name: str, values: Any) -> None:
        array = np.array(values, dtype=float)
        array.flags.writeable = False
        object.__setattr__(self, name, array)

    @property
    def impact_row(self) -> int:
        """Row of the table in which the impact happens."""
        return int(np.flatnonzero(self.travel == self.impact_travel)[0])

    @property
    def x(self) -> Array:
        """Of the flange in the base's frame, m, a row per place."""
        return np.asarray(self.start[0] + self.travel * self.direction[0])

    def _columns(self, mass: Mass) -> tuple[Array, Array, Array]:
        """Return mass, stiffness and damping; with the effective mass goes what a free flange is held by."""
        choice("mass", mass, get_args(Mass))
        if mass == "held":
            return self.mass, self.stiffness, self.damping
        if mass == "composite":
            return self.composite_mass, self.stiffness, self.damping
        return self.effective_mass, self.effective_stiffness, self.damping * self.effective_stiffness / self.stiffness

    def robot_table(self, mass: Mass = "held") -> RobotTable:
        """Return the robot whose parameters vary along the approach, with this one of its three masses."""
        return RobotTable(*(tuple(map(float, column)) for column in (self.travel, *self._columns(mass))))

    def at_impact(self, mass: Mass = "held") -> Robot:
        """Return the robot frozen as it is at the impact."""
        return Robot(*(float(column[self.impact_row]) for column in self._columns(mass)))


@cache
def default_approach() -> Approach:
    """Return the shipped table, chosen as `impact_gym.robot.viper` tells; needs no MuJoCo."""
    return read(SHIPPED)


def read(path: Path) -> Approach:
    """Read an approach that `write` wrote."""
    data = parsed(path, "JSON", json.loads)
    line, names = data["line"], tuple(data["line"]["joints"])
    if data["columns"] != [*COLUMNS.values(), *names]:
        raise ValueError(f"{path} must have the columns {[*COLUMNS.values(), *names]}, got {data['columns']}")
    rows = np.array(data["rows"], dtype=float)
    return Approach(
        **dict(zip(COLUMNS, rows.T[: len(COLUMNS)], strict=True)),
        joint_angles=rows[:, len(COLUMNS) :],
        joints=names,
        start=np.array(line["start_m"]),
        direction=np.array(line["direction"]),
        impact_travel=line["impact_travel_m"],
    )


def write(path: Path, approach: Approach, provenance: dict[str, Any]) -> None:
    """Write `approach` and where it comes from to `path`: all of it or nothing, one line per row, no digit lost."""
    line = {
        "joints": list(approach.joints), "start_m": approach.start.tolist(), "direction": approach.direction.tolist(),
        "impact_travel_m": approach.impact_travel,
    }  # fmt: skip
    header = [*COLUMNS.values(), *approach.joints]
    head = json.dumps({"provenance": provenance, "line": line, "columns": header}, indent=2)
    table = np.column_stack([*(getattr(approach, name) for name in COLUMNS), approach.joint_angles])
    rows = ",\n".join("    " + json.dumps(row) for row in table.tolist())
    write_file(path, head.removesuffix("\n}") + ',\n  "rows": [\n' + rows + "\n  ]\n}\n")
