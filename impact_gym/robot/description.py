"""What is known of the robot: frames, limits, inertia, joint stiffness; numbers and their sources in the data file.

The frames are those of the URDF: at zero angles every frame is parallel to the base, frame i stands on the axis of
joint i, and frame 6 stands on the flange, its z axis pointing out of it.
"""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

JOINTS = 6
DATA = Path(__file__).with_name("viper_s650.json")

ELEMENTS = ("xx", "yy", "zz", "xy", "xz", "yz")
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False)
class Description:
    """Six revolute joints with a spherical wrist; one row per joint, or per link behind it."""

    origins: Array  # m, (6, 3), of each joint in the frame of the link before it
    axes: Array  # -, (6, 3), of each joint in its own frame
    lower_limits: Array  # rad
    upper_limits: Array  # rad
    masses: Array  # kg, estimates
    centres: Array  # m, (6, 3), centre of mass in the link's frame
    inertias: Array  # kg m^2, (6, 6): ELEMENTS about the centre of mass, elements of the tensor
    joint_stiffness: Array  # N m/rad, estimates
    damping_over_stiffness: float  # s, beta in D = beta K
    mass_at_impact: float  # kg, the printed m_r + m_t less m_t

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    @property
    def joint_damping(self) -> Array:
        """Viscous damping of the joints, N m s/rad: D = beta K."""
        return self.damping_over_stiffness * self.joint_stiffness

    @property
    def upper_arm(self) -> float:
        """Distance of the axes of joints 2 and 3, m."""
        return float(np.linalg.norm(self.origins[2]))

    @property
    def forearm(self) -> Array:
        """From joint 3 to the wrist centre in the frame of link 3, m."""
        return np.asarray(self.origins[3] + self.origins[4])

    @property
    def stretched_elbow(self) -> float:
        """Angle of joint 3 at which joint 2, joint 3 and wrist centre are in line, rad; the elbow is up above it."""
        return float(np.pi / 2 - np.arctan2(self.forearm[0], self.forearm[2]))

    def wrist_distance(self, elbow: float) -> float:
        """Distance of the wrist centre from the axis of joint 2, m, at the angle `elbow` of joint 3, rad."""
        a, b = self.upper_arm, float(np.linalg.norm(self.forearm))
        return float(np.sqrt(a * a + b * b + 2 * a * b * np.cos(elbow - self.stretched_elbow)))


@cache
def viper_s650() -> Description:
    """Return the paper's robot (paper, Fig. 9), from the data file of this package."""
    data: dict[str, Any] = json.loads(DATA.read_text(encoding="utf-8"))
    kinematics, links, joints = data["kinematics"], data["inertia"]["links"], data["joints"]
    limits = np.radians(kinematics["limits_deg"])
    return Description(
        origins=np.array(kinematics["urdf_joint_origins_xyz_m"], dtype=float),
        axes=np.array([_AXES[axis] for axis in kinematics["urdf_joint_axes"]]),
        lower_limits=limits[:, 0],
        upper_limits=limits[:, 1],
        masses=np.array([link["mass_kg"] for link in links]),
        centres=np.array([link["com_m"] for link in links]),
        inertias=np.array([[link["inertia_kg_m2"][element] for element in ELEMENTS] for link in links]),
        joint_stiffness=np.array(joints["stiffness_N_m_per_rad"], dtype=float),
        damping_over_stiffness=float(joints["damping_over_stiffness_s"]),
        mass_at_impact=float(data["targets"]["m_r_at_impact_kg"]),
    )
