"""Where the flange is, how it moves with the joints, and what the joints have to move: computed by MuJoCo."""

import importlib
from typing import Any

import numpy as np

from impact_gym.robot.description import JOINTS, Array, Description, viper_s650
from impact_gym.validation import numbers, one_of


def _mujoco() -> Any:
    try:
        # by name: the package has to load, and its types to check, where MuJoCo is not installed
        return importlib.import_module("mujoco")
    except ImportError as missing:
        raise ImportError(
            "computing the robot needs MuJoCo: pip install 'impact-gym[robot]' (the shipped table does not need it)"
        ) from missing


class Arm:
    """The robot as a MuJoCo model without geometry. Joint angles in rad, base frame for everything that comes out."""

    def __init__(self, description: Description | None = None) -> None:
        one_of("Arm.description", description, Description, type(None))
        self.description = description or viper_s650()
        self._mujoco = _mujoco()
        self._model = self._build()
        self._data = self._mujoco.MjData(self._model)

    def _build(self) -> Any:
        robot = self.description
        specification = self._mujoco.MjSpec()
        body = specification.worldbody
        for joint in range(JOINTS):
            body = body.add_body(
                name=f"link {joint + 1}",
                pos=robot.origins[joint],
                mass=robot.masses[joint],
                ipos=robot.centres[joint],
                fullinertia=robot.inertias[joint],
                explicitinertial=True,
            )
            body.add_joint(type=self._mujoco.mjtJoint.mjJNT_HINGE, axis=robot.axes[joint])
        body.add_site(name="flange")
        return specification.compile()

    def _move(self, angles: Array) -> None:
        q = numbers("angles", angles, "rad")
        if len(q) != JOINTS:
            raise ValueError(f"angles must be {JOINTS} numbers in rad, got {angles!r}")
        self._data.qpos[:] = q

    def flange(self, angles: Array) -> tuple[Array, Array]:
        """Return position (m) and rotation matrix of the flange."""
        self._move(angles)
        self._mujoco.mj_kinematics(self._model, self._data)
        return self._data.site_xpos[0].copy(), self._data.site_xmat[0].reshape(3, 3).copy()

    def jacobian(self, angles: Array) -> Array:
        """Return J(q): rows vx, vy, vz (m/s) and wx, wy, wz (rad/s) of the flange per joint rate."""
        self._move(angles)
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_comPos(self._model, self._data)
        jacobian = np.empty((6, JOINTS))
        self._mujoco.mj_jacSite(self._model, self._data, jacobian[:3], jacobian[3:], 0)
        return jacobian

    def mass_matrix(self, angles: Array) -> Array:
        """Return M_q(q), kg m^2 (paper, eq. 11)."""
        self._move(angles)
        self._mujoco.mj_forward(self._model, self._data)
        matrix, column = np.empty((JOINTS, JOINTS)), np.empty(JOINTS)
        for joint, unit in enumerate(np.eye(JOINTS)):
            self._mujoco.mj_mulM(self._model, self._data, column, unit)
            matrix[:, joint] = column
        return (matrix + matrix.T) / 2  # symmetric but for rounding
