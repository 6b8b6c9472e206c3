"""The lumped compliance of a robot along its approach (paper, eq. 8 and 16), as flat records for the kernels."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_gym.kernel import by_type, inner_kernel


class LumpedRobot(NamedTuple):
    """Parameters that do not change."""

    mass: float  # kg, m_r
    stiffness: float  # N/m, k_r
    damping: float  # N s/m, c_r


class VaryingRobot(NamedTuple):
    """Parameters that are cubic splines of the imposed position, constant beyond the ends."""

    breaks: NDArray[np.float64]  # (n,), m
    coefficients: NDArray[np.float64]  # (4, n - 1, 3), highest power first; mass, stiffness, damping; as in PPoly


@inner_kernel
def lumped_within(robot: LumpedRobot, place: int, position: float) -> LumpedRobot:
    """Return the parameters."""
    return robot


@inner_kernel
def varying_within(robot: VaryingRobot, place: int, position: float) -> LumpedRobot:
    """Return the parameters at an imposed `position` (m) by the polynomial of interval `place`."""
    last = robot.breaks.shape[0] - 2
    i = min(max(place, 0), last)
    u = position - robot.breaks[i]
    if place < 0:
        u = 0.0
    if place > last:
        u = robot.breaks[-1] - robot.breaks[i]
    c = robot.coefficients
    return LumpedRobot(
        ((c[0, i, 0] * u + c[1, i, 0]) * u + c[2, i, 0]) * u + c[3, i, 0],
        ((c[0, i, 1] * u + c[1, i, 1]) * u + c[2, i, 1]) * u + c[3, i, 1],
        ((c[0, i, 2] * u + c[1, i, 2]) * u + c[2, i, 2]) * u + c[3, i, 2],
    )


within = by_type({LumpedRobot: lumped_within, VaryingRobot: varying_within})
"""Parameters of a robot at an imposed position (m) in a given interval."""


@inner_kernel
def lumped_within_slopes(robot: LumpedRobot, place: int, position: float) -> LumpedRobot:
    """Return nothing but zeros."""
    return LumpedRobot(0.0, 0.0, 0.0)


@inner_kernel
def varying_within_slopes(robot: VaryingRobot, place: int, position: float) -> LumpedRobot:
    """Return the derivatives of the parameters by the imposed position, each per m."""
    if not 0 <= place < robot.breaks.shape[0] - 1:
        return LumpedRobot(0.0, 0.0, 0.0)
    u = position - robot.breaks[place]
    c = robot.coefficients
    return LumpedRobot(
        (3.0 * c[0, place, 0] * u + 2.0 * c[1, place, 0]) * u + c[2, place, 0],
        (3.0 * c[0, place, 1] * u + 2.0 * c[1, place, 1]) * u + c[2, place, 1],
        (3.0 * c[0, place, 2] * u + 2.0 * c[1, place, 2]) * u + c[2, place, 2],
    )


within_slopes = by_type({LumpedRobot: lumped_within_slopes, VaryingRobot: varying_within_slopes})
"""Derivatives of the parameters by the imposed position (m) in a given interval."""


@inner_kernel
def mass_bend(robot: VaryingRobot, place: int, position: float) -> float:
    """d^2 m_r / dx_r^2 at an imposed `position` (m) in interval `place`, kg/m^2."""
    if not 0 <= place < robot.breaks.shape[0] - 1:
        return 0.0
    c: Any = robot.coefficients
    bend: float = 6.0 * c[0, place, 0] * (position - robot.breaks[place]) + 2.0 * c[1, place, 0]
    return bend


@inner_kernel
def lumped_place(robot: LumpedRobot, position: float, direction: float) -> int:
    """There is one interval."""
    return 0


@inner_kernel
def varying_place(robot: VaryingRobot, position: float, direction: float) -> int:
    """Interval that begins or goes on at `position` (m) in `direction`: -1 before the first break, n - 1 behind all.

    A break that only rounding keeps `position` from counts as passed.
    """
    near = 1e-9 * (robot.breaks[-1] - robot.breaks[0])
    return int(np.searchsorted(robot.breaks, position + math.copysign(near, direction))) - 1


place = by_type({LumpedRobot: lumped_place, VaryingRobot: varying_place})
"""Interval in which the parameters are smooth from a position (m) on in a direction (its sign)."""


@inner_kernel
def lumped_at(robot: LumpedRobot, position: float) -> LumpedRobot:
    """Return the parameters."""
    return robot


@inner_kernel
def varying_at(robot: VaryingRobot, position: float) -> LumpedRobot:
    """Return the parameters at an imposed `position` (m)."""
    return varying_within(robot, varying_place(robot, position, 1.0), position)


at = by_type({LumpedRobot: lumped_at, VaryingRobot: varying_at})
"""Parameters of a robot at an imposed position (m)."""


@inner_kernel
def lumped_bounds(robot: LumpedRobot, place: int) -> tuple[float, float]:
    """Everywhere."""
    return -math.inf, math.inf


@inner_kernel
def varying_bounds(robot: VaryingRobot, place: int) -> tuple[float, float]:
    """Ends of interval `place`, m."""
    low = robot.breaks[place] if place >= 0 else -math.inf
    high = robot.breaks[place + 1] if place + 1 < robot.breaks.shape[0] else math.inf
    return low, high


bounds = by_type({LumpedRobot: lumped_bounds, VaryingRobot: varying_bounds})
"""Imposed positions (m) between which an interval lies."""


@inner_kernel
def stiffest_lumped(robot: LumpedRobot) -> float:
    """Largest k_r / m_r, 1/s^2."""
    return robot.stiffness / robot.mass


@inner_kernel
def stiffest_varying(robot: VaryingRobot) -> float:
    """Largest k_r / m_r at the breaks, 1/s^2: a scale, not a bound."""
    largest = 0.0
    for place in range(robot.breaks.shape[0]):
        there = varying_at(robot, robot.breaks[place])
        largest = max(largest, there.stiffness / there.mass)
    return largest


stiffest = by_type({LumpedRobot: stiffest_lumped, VaryingRobot: stiffest_varying})
"""Largest stiffness over mass of a robot, 1/s^2."""
