"""Which approach: the paper names none, so one is solved for that has what it prints.

The paper says where the impact happens neither in joint angles nor in place; of its Fig. 12 the text holds nothing but
m_r + m_t = 5.35 kg at the impact. k_r = 1.5e5 N/m there is identified from Fig. 13b (see docs/provenance.md), as are
the 0.28 m of travel before it. What was looked at:

- With the tool in the plane of the arm (y = 0) m_r and k_r depend on the place of the wrist centre alone: the
  orientation is held, so links 5 and 6 only translate. Both values meet at one place, wrist centre at x = 0.4881 m,
  z = 0.3162 m. 0.28 m before it joint 3 would have to turn beyond its limit, whatever the orientation of the tool.
- m_r alone leaves a curve at y = 0. Where the robot can follow the line with joint 3 at least 5 deg from its limit,
  k_r at the impact is about 1.8e5 to 1.9e5 N/m, and m_r grows from 2-2.5 kg at the start to more than 20 kg at the
  end, where the arm is almost stretched.
- Beside the plane of the arm both values can be had from y = 0.1 m on. With the tool down the wrist is then straight
  at some place on the way (joint 5 comes to 0), a singularity; with the tool horizontal, along the approach, it is not.

Hence a horizontal tool and three unknowns x, y, z for three conditions: m_r, k_r, and joint 3, the joint that comes
nearest to a limit, just `CLEARANCE` away from it at the start. This is the smallest y with that clearance. The
other side of the robot is its mirror image but for the asymmetry of the links, and needs a little more: y = -0.193 m.
"""

import numpy as np
from scipy.optimize import root

from impact_gym.robot.arm import Arm
from impact_gym.robot.description import Array
from impact_gym.robot.line import Line, angles_along
from impact_gym.robot.lumped import along_x
from impact_gym.robot.pose import Pose

STIFFNESS_AT_IMPACT = 1.5e5
"""k_r at the impact, N/m: identified from the paper's Fig. 13b, not printed."""

CLEARANCE = np.radians(10.0)
"""Smallest distance of a joint from its limits on the way, rad: a choice."""


def clearance(arm: Arm, angles: Array) -> float:
    """Return the smallest distance of a joint from its limits, rad, over rows of `angles` (rad)."""
    robot = arm.description
    return float(np.min([angles - robot.lower_limits, robot.upper_limits - angles]))


def default_line(arm: Arm) -> Line:
    """Solve for the line of the default approach.

    Raises:
        ValueError: no such line was found, or the robot cannot follow it.
    """
    robot = arm.description

    def line(place: Array) -> Line:
        x, y, z = map(float, place)
        return Line(Pose(x, y, z, "horizontal"), spacing=0.02)  # coarse: this only has to stay on the branch

    def misfit(place: Array) -> Array:
        travel, angles = angles_along(arm, line(place))
        at_impact = along_x(arm, angles[int(np.flatnonzero(travel == line(place).ahead)[0])])
        return np.array(
            [
                at_impact.mass / robot.mass_at_impact - 1,
                at_impact.stiffness / STIFFNESS_AT_IMPACT - 1,
                clearance(arm, angles) - CLEARANCE,
            ]
        )

    found = root(misfit, [0.56, 0.18, 0.28], method="hybr", options={"xtol": 1e-13})
    if np.max(np.abs(found.fun)) > 1e-11:
        raise ValueError(f"no line with the wanted robot at the impact was found: {found.message}")
    return Line(line(found.x).impact)
