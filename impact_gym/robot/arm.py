"""The robot's six joints: what is known of them, and what they do to the flange, computed by MuJoCo.

The frames are those of the URDF: at zero angles every frame is parallel to the base, frame i stands on the axis of
joint i, and frame 6 stands on the flange, its z axis pointing out of it. The data file says where its numbers are from.
"""

import importlib
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.files import parsed
from impact_gym.validation import numbers, one_of

Array = NDArray[np.float64]

JOINTS = 6
DATA = Path(__file__).with_name("viper_s650.json")
ELEMENTS = ("xx", "yy", "zz", "xy", "xz", "yz")


@dataclass(frozen=True)
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
def read(path: Path = DATA) -> Description:
    """Return the robot in a file like the shipped one, which has the paper's (paper, Fig. 9)."""
    data: dict[str, Any] = parsed(path, "JSON", json.loads)
    kinematics, links, joints = data["kinematics"], data["inertia"]["links"], data["joints"]
    limits = np.radians(kinematics["limits_deg"])
    unit_vectors = dict(zip("xyz", np.eye(3), strict=True))
    return Description(
        origins=np.array(kinematics["urdf_joint_origins_xyz_m"], dtype=float),
        axes=np.array([unit_vectors[axis] for axis in kinematics["urdf_joint_axes"]]),
        lower_limits=limits[:, 0],
        upper_limits=limits[:, 1],
        masses=np.array([link["mass_kg"] for link in links]),
        centres=np.array([link["com_m"] for link in links]),
        inertias=np.array([[link["inertia_kg_m2"][element] for element in ELEMENTS] for link in links]),
        joint_stiffness=np.array(joints["stiffness_N_m_per_rad"], dtype=float),
        damping_over_stiffness=float(joints["damping_over_stiffness_s"]),
        mass_at_impact=float(data["targets"]["m_r_at_impact_kg"]),
    )


class Arm:
    """The robot as a MuJoCo model without geometry. Joint angles in rad, base frame for everything that comes out."""

    def __init__(self, description: Description | None = None) -> None:
        one_of("Arm.description", description, Description, type(None))
        self.description = description or read()
        try:
            # by name: the package has to load, and its types to check, where MuJoCo is not installed
            self._mujoco: Any = importlib.import_module("mujoco")
        except ImportError as missing:
            raise ImportError(
                "computing the robot needs MuJoCo: pip install 'impact-gym[robot]' (the shipped table does not need it)"
            ) from missing
        self._model = self._build()
        self._data = self._mujoco.MjData(self._model)

    def _build(self) -> Any:
        robot = self.description
        specification = self._mujoco.MjSpec()
        body = specification.worldbody
        for joint in range(JOINTS):
            body = body.add_body(
                name=f"link {joint + 1}", pos=robot.origins[joint], mass=robot.masses[joint], ipos=robot.centres[joint],
                fullinertia=robot.inertias[joint],
            )  # fmt: skip
            body.add_joint(type=self._mujoco.mjtJoint.mjJNT_HINGE, axis=robot.axes[joint])
        body.add_site(name="flange")
        return specification.compile()

    def _move(self, angles: Array) -> None:
        q = numbers("angles", angles, "rad")
        if len(q) != JOINTS:
            raise ValueError(f"angles must be {JOINTS} numbers in rad, got {angles!r}")
        self._data.qpos[:] = q
        self._mujoco.mj_kinematics(self._model, self._data)

    def flange(self, angles: Array) -> tuple[Array, Array]:
        """Return position (m) and rotation matrix of the flange."""
        self._move(angles)
        return self._data.site_xpos[0].copy(), self._data.site_xmat[0].reshape(3, 3).copy()

    def jacobian(self, angles: Array) -> Array:
        """Return J(q): rows vx, vy, vz (m/s) and wx, wy, wz (rad/s) of the flange per joint rate."""
        self._move(angles)
        self._mujoco.mj_comPos(self._model, self._data)
        jacobian = np.empty((6, JOINTS))
        self._mujoco.mj_jacSite(self._model, self._data, jacobian[:3], jacobian[3:], 0)
        return jacobian

    def condition(self, angles: Array) -> float:
        """Return the condition number of the Jacobian, its rotations scaled by the upper arm: all rows in m/s."""
        scale = np.repeat([1.0, self.description.upper_arm], 3)
        return float(np.linalg.cond(scale[:, None] * self.jacobian(angles)))

    def mass_matrix(self, angles: Array) -> Array:
        """Return M_q(q), kg m^2 (paper, eq. 11)."""
        self._move(angles)
        self._mujoco.mj_forward(self._model, self._data)
        matrix, column = np.empty((JOINTS, JOINTS)), np.empty(JOINTS)
        for joint, unit in enumerate(np.eye(JOINTS)):
            self._mujoco.mj_mulM(self._model, self._data, column, unit)
            matrix[:, joint] = column
        return (matrix + matrix.T) / 2  # symmetric but for rounding


def cartesian(jacobian: Array, matrix: Array) -> Array:
    """Return J^-T A J^-1 for a symmetric `matrix` A in joint space (paper, eq. 12-14)."""
    half = np.linalg.solve(jacobian.T, matrix)
    return np.asarray(np.linalg.solve(jacobian.T, half.T))


def along_x(arm: Arm, angles: Array) -> dict[str, float]:
    """Return the robot along x at joint `angles` (rad), by the names of the fields of `Approach`.

    Mass, damping and stiffness are elements (1,1) of the cartesian matrices (paper, eq. 16), those of a flange that is
    *held* in its other five directions. A flange that is free in them is lighter and softer: the effective mass is what
    an impulse along x meets at first, the effective stiffness is static force over deflection along x. By
    Cauchy-Schwarz they never exceed the elements (1,1).
    """
    robot = arm.description
    J, M_q = arm.jacobian(angles), arm.mass_matrix(angles)
    M_X, D_X, K_X = (cartesian(J, A) for A in (M_q, np.diag(robot.joint_damping), np.diag(robot.joint_stiffness)))
    x = J[0]  # (J^-T A J^-1)^-1 = J A^-1 J^T needs no inverse of J
    return {
        "mass": float(M_X[0, 0]), "damping": float(D_X[0, 0]), "stiffness": float(K_X[0, 0]),
        "effective_mass": float(1 / (x @ np.linalg.solve(M_q, x))),
        "effective_stiffness": float(1 / (x @ (x / robot.joint_stiffness))),
    }  # fmt: skip
