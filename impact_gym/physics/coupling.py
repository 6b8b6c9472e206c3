"""What ties the tool to the flange, as flat records for the kernels, and the closed form of a free linear tool.

y = x_t - x_c is the deflection of the coupling. Away from the object, under a flange acceleration a,

    y'' + 2 zeta omega y' + omega^2 y = -a        (paper, eq. 17 with F = 0)

so z = y + a / omega^2 decays freely, and its motion is known over any span of time.
"""

import math
from typing import NamedTuple

from impact_gym.kernel import kernel


class RigidLaw(NamedTuple):
    """The tool is the flange."""

    tool_mass: float  # kg


class SpringDamperLaw(NamedTuple):
    """Linear spring and damper."""

    tool_mass: float  # kg
    frequency: float  # rad/s, omega = sqrt(k_t / m_t)
    damping_ratio: float  # -, zeta


Law = RigidLaw | SpringDamperLaw


@kernel
def decay_basis(frequency: float, damping_ratio: float, time: float) -> tuple[float, float]:
    """Return exp(-zeta omega t) times cos(omega_d t) and sin(omega_d t) / omega_d, whatever the damping ratio.

    omega_d = omega sqrt(1 - zeta^2): imaginary above critical damping, where cosine and sine become hyperbolic; near
    it both are series in (omega_d t)^2, so that nothing is lost to cancellation.
    """
    alpha = damping_ratio * frequency
    square = (damping_ratio - 1.0) * (damping_ratio + 1.0) * frequency * frequency  # -omega_d^2
    q = square * time * time
    if abs(q) < 1e-3:
        envelope = math.exp(-alpha * time)
        cosine = 1.0 + q / 2.0 * (1.0 + q / 12.0 * (1.0 + q / 30.0))
        sine = time * (1.0 + q / 6.0 * (1.0 + q / 20.0 * (1.0 + q / 42.0)))
        return envelope * cosine, envelope * sine
    if q < 0.0:
        envelope = math.exp(-alpha * time)
        damped = math.sqrt(-square)
        return envelope * math.cos(damped * time), envelope * math.sin(damped * time) / damped
    split = math.sqrt(square)
    slow = math.exp(-frequency * frequency / (alpha + split) * time)
    lost = -math.expm1(-2.0 * split * time)
    return slow * (1.0 - 0.5 * lost), slow * lost / (2.0 * split)


@kernel
def free_decay(
    frequency: float, damping_ratio: float, position: float, velocity: float, time: float
) -> tuple[float, float]:
    """Return z and z' after `time` (s) of z'' + 2 zeta omega z' + omega^2 z = 0 from `position` and `velocity`."""
    cosine, sine = decay_basis(frequency, damping_ratio, time)
    alpha = damping_ratio * frequency
    z = position * cosine + (velocity + alpha * position) * sine
    z_dot = velocity * cosine - (frequency * frequency * position + alpha * velocity) * sine
    return z, z_dot


@kernel
def relative_force(frequency: float, damping_ratio: float, deflection: float, deflection_rate: float) -> float:
    """Force of spring and damper on the tool over the tool's mass, m/s^2 (paper, right side of eq. 17)."""
    return -frequency * (frequency * deflection + 2.0 * damping_ratio * deflection_rate)
