"""From compliant joints to mass, damping and stiffness along the approach (paper, section 3.1, eq. 10-16, Fig. 10).

    default_approach() -> Approach        the shipped table: Viper s650, the paper's m_r at the impact
    Approach.robot_table(), .at(position) what a Scene takes as its robot, with one of three masses

Everything else computes such a table and needs MuJoCo, the extra `robot`:

    from_urdf(path, base, tip) -> Arm     any serial arm; viper.viper() is the paper's
    Arm.along(start, direction, length)   -> Approach, the table along a line through the flange
    Arm.reduction(angles, direction)      one row of it
    joint_angles(arm, place, ...)         joint angles of a pose
    whole.simulate(arm, approach, scene)  all joints at once, to see what the table leaves out

Kinematics and limits are public data. Inertia and joint stiffness of the Viper are estimates: m_r is uncertain by tens
of per cent at a given pose and k_r by a factor; the default pose is chosen such that both come out as in the paper.
"""

from impact_gym.robot.approach import IMPACT, Approach, default_approach
from impact_gym.robot.arm import Arm, from_urdf
from impact_gym.robot.line import joint_angles

__all__ = ["IMPACT", "Approach", "Arm", "default_approach", "from_urdf", "joint_angles"]
