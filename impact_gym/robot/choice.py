"""Which approach: the paper names none, so one is solved for that has what it prints.

The paper says where the impact happens neither in joint angles nor in place; of its Fig. 12 the text holds nothing but
m_r + m_t = 5.35 kg at the impact. k_r = 1.9e5 N/m there and the 0.2505 m of travel before it are identified from other
printed numbers (see docs/provenance.md).

With the tool in the plane of the arm (y = 0) m_r and k_r depend on the place of the wrist centre alone: the orientation
is held, so links 5 and 6 only translate. Both values meet at one place, and the arm reaches it on a straight line of
that length with every joint at least 15 degrees from its limits. The tool is horizontal, along the approach.
"""

import numpy as np
from scipy.optimize import root

from impact_gym.robot.approach import Pose
from impact_gym.robot.arm import Arm, Array, along_x
from impact_gym.robot.line import Line, joint_angles

STIFFNESS_AT_IMPACT = 1.9e5
"""k_r at the impact, N/m: identified from the paper's Fig. 13b and 14a, not printed."""


def default_line(arm: Arm) -> Line:
    """Solve for the line of the default approach.

    Raises:
        ValueError: no such line was found, or the robot cannot reach a place tried on the way to it.
    """

    def pose(place: Array) -> Pose:
        x, z = map(float, place)
        return Pose(x, 0.0, z, "horizontal")

    def misfit(place: Array) -> Array:
        at_impact = along_x(arm, joint_angles(arm, pose(place)))
        wanted = arm.description.mass_at_impact, STIFFNESS_AT_IMPACT
        return np.array([at_impact["mass"], at_impact["stiffness"]]) / wanted - 1

    solution = root(misfit, [0.56, 0.28], method="hybr", options={"xtol": 1e-13})
    if np.max(np.abs(solution.fun)) > 1e-11:
        raise ValueError(f"no line with the wanted robot at the impact was found: {solution.message}")
    return Line(pose(solution.x))
