"""The lumped compliance of a robot along its approach (paper, eq. 8 and 16), as flat records for the kernels."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_gym.kernel import by_type, kernel


class LumpedRobot(NamedTuple):
    """Parameters that do not change."""

    mass: float  # kg, m_r
    stiffness: float  # N/m, k_r
    damping: float  # N s/m, c_r


class VaryingRobot(NamedTuple):
    """Parameters that are cubic splines of the imposed position, constant beyond the ends."""

    breaks: NDArray[np.float64]  # (n,), m
    coefficients: NDArray[np.float64]  # (4, n - 1, 3), highest power first; mass, stiffness, damping; as in PPoly


@kernel
def lumped_at(robot: LumpedRobot, position: float) -> LumpedRobot:
    """Return the parameters."""
    return robot


@kernel
def varying_at(robot: VaryingRobot, position: float) -> LumpedRobot:
    """Return the parameters at an imposed `position` (m)."""
    x = min(max(position, robot.breaks[0]), robot.breaks[-1])
    i = min(max(np.searchsorted(robot.breaks, x) - 1, 0), robot.breaks.shape[0] - 2)
    u = x - robot.breaks[i]
    c = robot.coefficients
    return LumpedRobot(
        ((c[0, i, 0] * u + c[1, i, 0]) * u + c[2, i, 0]) * u + c[3, i, 0],
        ((c[0, i, 1] * u + c[1, i, 1]) * u + c[2, i, 1]) * u + c[3, i, 1],
        ((c[0, i, 2] * u + c[1, i, 2]) * u + c[2, i, 2]) * u + c[3, i, 2],
    )


at = by_type({LumpedRobot: lumped_at, VaryingRobot: varying_at})
"""Parameters of a robot at an imposed position (m)."""


@kernel
def mass_slope(robot: VaryingRobot, position: float) -> float:
    """dm_r/dx_r at an imposed `position` (m), kg/m."""
    if not robot.breaks[0] <= position <= robot.breaks[-1]:
        return 0.0
    i = min(max(np.searchsorted(robot.breaks, position) - 1, 0), robot.breaks.shape[0] - 2)
    u = position - robot.breaks[i]
    c: Any = robot.coefficients
    slope: float = (3.0 * c[0, i, 0] * u + 2.0 * c[1, i, 0]) * u + c[2, i, 0]
    return slope


@kernel
def lumped_piece(robot: LumpedRobot, position: float) -> tuple[float, float]:
    """Everywhere."""
    return -math.inf, math.inf


@kernel
def varying_piece(robot: VaryingRobot, position: float) -> tuple[float, float]:
    """Breaks around `position` (m), those passed over that only rounding keeps it from."""
    near = 1e-9 * (robot.breaks[-1] - robot.breaks[0])
    behind = np.searchsorted(robot.breaks, position - near) - 1
    ahead = np.searchsorted(robot.breaks, position + near)
    low = robot.breaks[behind] if behind >= 0 else -math.inf
    high = robot.breaks[ahead] if ahead < robot.breaks.shape[0] else math.inf
    return low, high


smooth_piece = by_type({LumpedRobot: lumped_piece, VaryingRobot: varying_piece})
"""Imposed positions (m) between which the parameters are smooth."""


@kernel
def stiffest_lumped(robot: LumpedRobot) -> float:
    """Largest k_r / m_r, 1/s^2."""
    return robot.stiffness / robot.mass


@kernel
def stiffest_varying(robot: VaryingRobot) -> float:
    """Largest k_r / m_r at the breaks, 1/s^2: a scale, not a bound."""
    largest = 0.0
    for place in range(robot.breaks.shape[0]):
        there = varying_at(robot, robot.breaks[place])
        largest = max(largest, there.stiffness / there.mass)
    return largest


stiffest = by_type({LumpedRobot: stiffest_lumped, VaryingRobot: stiffest_varying})
"""Largest stiffness over mass of a robot, 1/s^2."""
