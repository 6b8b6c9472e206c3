"""From six compliant joints to mass, damping and stiffness along the approach (paper, section 3.1, eq. 10-16, Fig. 10).

    default_approach() -> Approach        the shipped table: Viper s650, the paper's m_r at the impact
    Approach.robot_table(), .at_impact()  what a Scene takes as its robot

Everything else computes such a table and needs MuJoCo, the extra `robot`:

    Arm -> Jacobian and mass matrix       line.joint_angles -> joint angles of a pose
    arm.along_x -> m_r, c_r, k_r          line.follow -> the table along a line; choice.default_line -> which line

Kinematics and limits are public data. Inertia and joint stiffness are estimates: m_r is uncertain by tens of per cent
at a given pose and k_r by a factor; the default pose is chosen such that both come out as the paper has them.
"""

from impact_gym.robot.approach import Approach, Pose, default_approach
from impact_gym.robot.arm import Arm
from impact_gym.robot.line import Line, follow

__all__ = ["Approach", "Arm", "Line", "Pose", "default_approach", "follow"]
