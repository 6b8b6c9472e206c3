"""The paper's arm, the Viper s650, and a default approach on which it has the paper's mass and stiffness.

The paper gives neither the joint angles nor the place of the impact. Fig. 12 shows the robot's mass, damping and
stiffness along the motion, but only this number is printed: m_r + m_t (mass of robot and tool) = 5.35 kg at the impact.
From other printed numbers we infer the robot's stiffness at the impact, k_r = 1.9e5 N/m, and the travel to the impact,
0.2505 m (see docs/provenance.md).

With the tool in the plane of the arm (y = 0), m_r and k_r depend only on the position of the wrist centre, because
links 5 and 6 only translate. `default_line` finds a straight line along the tool to a position with these m_r and k_r.
"""

from pathlib import Path

import numpy as np
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from impact_gym.robot import from_urdf
from impact_gym.robot.arm import Arm, joint_angles
from impact_gym.robot.line_table import IMPACT, SHIPPED, Array, LineTable, write

FILE = Path(__file__).with_name("viper_s650.urdf")
STIFFNESS = (10000.0, 10000.0, 3000.0, 1000.0, 700.0, 300.0)
"""Stiffness of the joints, N m/rad: estimates, with arbitrary ratios between joints."""
DAMPING_OVER_STIFFNESS = 3.7e-4  # s, each joint's damping / stiffness; gives a damping ratio of about 3 % at 26 Hz
MASS_AT_IMPACT = 5.35 - 0.125  # kg, robot mass m_r: 5.35 kg minus the tool mass (paper, section 3.2)
STIFFNESS_AT_IMPACT = 1.9e5  # N/m, robot stiffness k_r, inferred from the paper's Fig. 13b and 14a
PROVENANCE = {  # has no version and no date, so that the same table gives the same file
    "made_by": "impact_gym.robot.viper.write_default_approach()",
    "robot": "Viper s650, viper_s650.urdf and viper.py beside this file: inertia and joint stiffness are ESTIMATES",
    "choice": "solved for, see impact_gym/robot/viper.py",
    "fields": "of impact_gym.robot.LineTable, in SI units: m, kg, N s/m, N/m, rad (paper, eq. 12-16)",
}
ELBOW_UP = (0.0, -0.7, 3.2, 0.0, np.pi / 2 - 2.5, 0.0)  # rad, near which the elbow is up and the tool points along x


def viper() -> Arm:
    """Return the Viper. At joint angles of 0 all frames are parallel. The flange's z axis points away from the arm."""
    damping = tuple(DAMPING_OVER_STIFFNESS * stiffness for stiffness in STIFFNESS)
    return from_urdf(FILE, "base", "flange", joint_stiffness=STIFFNESS, joint_damping=damping)


def default_line(arm: Arm) -> LineTable:
    """Return the default approach, found numerically."""
    along_x = Rotation.from_rotvec([0.0, np.pi / 2, 0.0]).as_matrix()

    def angles(x: float, z: float) -> Array:
        return joint_angles(arm, (x, 0.0, z), along_x, ELBOW_UP)

    def misfit(position: Array) -> Array:
        at_impact = arm.reduction(angles(*position), (1.0, 0.0, 0.0))
        return np.array([at_impact["held"] / MASS_AT_IMPACT, at_impact["stiffness"] / STIFFNESS_AT_IMPACT]) - 1

    solution = root(misfit, [0.56, 0.28], method="hybr", options={"xtol": 1e-13})
    if np.max(np.abs(solution.fun)) > 1e-11:
        raise ValueError(f"no line gives the paper's robot mass and stiffness at the impact: {solution.message}")
    back = arm.along(angles(*solution.x), (-1.0, 0.0, 0.0), IMPACT)
    beyond = np.linspace(IMPACT, IMPACT + 0.08, 33)[1:]  # m; from 1 m/s, a delay of 16 ms and the braking take 0.0785 m
    return arm.along(back.joint_angles[-1], (1.0, 0.0, 0.0), [*np.linspace(0.0, IMPACT, 102), *beyond])


def write_default_approach(path: Path = SHIPPED) -> None:
    """Compute the default approach and write its table, by default over the shipped table."""
    write(path, default_line(viper()), PROVENANCE)
