"""Six compliant joints seen at the flange, along x only: the paper's reduction and, beside it, the usual one."""

from dataclasses import dataclass

import numpy as np

from impact_gym.robot.arm import Arm
from impact_gym.robot.description import Array


@dataclass(frozen=True, slots=True)
class Lumped:
    """The robot along x in one configuration.

    The first three are elements (1,1) of the cartesian matrices (paper, eq. 16): inertia, damping and stiffness of a
    flange that is *held* in its other five directions. A flange that is free in them is lighter and softer: the
    effective mass 1/(M_X^-1)_11 is what an impulse along x meets at first, the effective stiffness 1/(K_X^-1)_11 is
    static force over deflection along x. By Cauchy-Schwarz they never exceed the elements (1,1).
    """

    mass: float  # kg, m_r
    damping: float  # N s/m, c_r
    stiffness: float  # N/m, k_r
    effective_mass: float  # kg
    effective_stiffness: float  # N/m


def cartesian(jacobian: Array, matrix: Array) -> Array:
    """Return J^-T A J^-1 for a symmetric `matrix` A in joint space (paper, eq. 12-14)."""
    half = np.linalg.solve(jacobian.T, matrix)
    return np.asarray(np.linalg.solve(jacobian.T, half.T))


def along_x(arm: Arm, angles: Array) -> Lumped:
    """Reduce the robot at joint `angles` (rad) to the direction x."""
    robot = arm.description
    J, M_q = arm.jacobian(angles), arm.mass_matrix(angles)
    M_X = cartesian(J, M_q)
    D_X = cartesian(J, np.diag(robot.joint_damping))
    K_X = cartesian(J, np.diag(robot.joint_stiffness))
    x = J[0]
    return Lumped(
        mass=float(M_X[0, 0]),
        damping=float(D_X[0, 0]),
        stiffness=float(K_X[0, 0]),
        # (J^-T A J^-1)^-1 = J A^-1 J^T needs no inverse of J
        effective_mass=float(1 / (x @ np.linalg.solve(M_q, x))),
        effective_stiffness=float(1 / (x @ (x / robot.joint_stiffness))),
    )
