"""What ties the tool to the imposed motion, as flat records for the kernels, and the closed form of a linear tool.

y = x_t - x_r is the deflection. With one linear spring and damper, away from the object, under a flange acceleration a,

    y'' + 2 zeta omega y' + omega^2 y = -a        (paper, eq. 17 with F = 0)

so z = y + a / omega^2 decays freely, and its motion is known over any span of time.
"""

import math
from typing import NamedTuple

from impact_gym.kernel import by_type, kernel
from impact_gym.physics import bistable
from impact_gym.physics.robot import LumpedRobot, VaryingRobot


class RigidLaw(NamedTuple):
    """The tool is the flange."""

    tool_mass: float  # kg


class SpringDamperLaw(NamedTuple):
    """Linear spring and damper."""

    tool_mass: float  # kg
    frequency: float  # rad/s, omega = sqrt(k_t / m_t)
    damping_ratio: float  # -, zeta


class Spring(NamedTuple):
    """Linear spring and damper between two masses."""

    stiffness: float  # N/m
    damping: float  # N s/m


class Mechanism(NamedTuple):
    """Bistable mechanism with two stops."""

    stiffness: float  # N/m, k
    free_length: float  # m, L0
    height: float  # m, H
    rest: float  # m, position of the slider where its stretch is counted from
    front_stop: float  # m
    rear_stop: float  # m
    stop_stiffness: float  # N/m
    stop_damping: float  # N s/m


class MechanismLaw(NamedTuple):
    """Tool behind a bistable mechanism on a rigid robot."""

    tool_mass: float  # kg
    coupling: Mechanism


class RobotLaw(NamedTuple):
    """Tool behind a coupling behind a compliant robot: three masses in a row with the object."""

    tool_mass: float  # kg
    coupling: Spring | Mechanism
    robot: LumpedRobot | VaryingRobot


class VaryingLaw(NamedTuple):
    """Tool fixed to a compliant robot whose parameters vary along the way; with constant ones: SpringDamperLaw."""

    tool_mass: float  # kg
    robot: VaryingRobot


Law = RigidLaw | SpringDamperLaw | MechanismLaw | RobotLaw | VaryingLaw

FREE, FRONT, REAR = 0, 1, -1
"""Which stop of a mechanism pushes."""


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


@kernel
def spring_pull(coupling: Spring, pressed: int, stretch: float, stretch_rate: float) -> float:
    """Force on the tool, N (paper, right side of eq. 17)."""
    return -coupling.stiffness * stretch - coupling.damping * stretch_rate


@kernel
def mechanism_pull(coupling: Mechanism, pressed: int, stretch: float, stretch_rate: float) -> float:
    """Force on the tool, N: the spring (paper, eq. 23) and the stop that is `pressed`."""
    x = coupling.rest + stretch
    pull = bistable.force(coupling.stiffness, coupling.free_length, coupling.height, x)
    if pressed == FRONT:
        pull -= coupling.stop_stiffness * (x - coupling.front_stop) + coupling.stop_damping * stretch_rate
    if pressed == REAR:
        pull += coupling.stop_stiffness * (coupling.rear_stop - x) - coupling.stop_damping * stretch_rate
    return pull


pull = by_type({Spring: spring_pull, Mechanism: mechanism_pull})
"""Force of the coupling on the tool, N, given which stop is pressed, the stretch (m) and its rate (m/s)."""


@kernel
def spring_pull_slopes(coupling: Spring, pressed: int, stretch: float) -> tuple[float, float]:
    """N/m and N s/m."""
    return -coupling.stiffness, -coupling.damping


@kernel
def mechanism_pull_slopes(coupling: Mechanism, pressed: int, stretch: float) -> tuple[float, float]:
    """N/m and N s/m."""
    x = coupling.rest + stretch
    slope = bistable.force_slope(coupling.stiffness, coupling.free_length, coupling.height, x)
    if pressed == FREE:
        return slope, 0.0
    return slope - coupling.stop_stiffness, -coupling.stop_damping


pull_slopes = by_type({Spring: spring_pull_slopes, Mechanism: mechanism_pull_slopes})
"""Derivatives of `pull` by the stretch, N/m, and by its rate, N s/m."""


@kernel
def spring_switch(coupling: Spring, pressed: int, stretch: float, stretch_rate: float) -> float:
    """A spring has no stops to switch."""
    return -1.0


@kernel
def mechanism_switch(coupling: Mechanism, pressed: int, stretch: float, stretch_rate: float) -> float:
    """Positive once another stop pushes than `pressed` says, N.

    A stop begins to push when the slider reaches it, and ends when its force would become a pull; it may push again
    before the slider has left it.
    """
    k, c = coupling.stop_stiffness, coupling.stop_damping
    x = coupling.rest + stretch
    front = k * (x - coupling.front_stop)
    rear = k * (coupling.rear_stop - x)
    if pressed == FRONT:
        return -(front + c * stretch_rate)
    if pressed == REAR:
        return -(rear - c * stretch_rate)
    return max(front + min(c * stretch_rate, 0.0), rear + min(-c * stretch_rate, 0.0))


switch = by_type({Spring: spring_switch, Mechanism: mechanism_switch})
"""Positive once the stop that pushes is another than the one said to."""


@kernel
def spring_stiffness_bound(coupling: Spring) -> float:
    """Largest stiffness, N/m."""
    return coupling.stiffness


@kernel
def mechanism_stiffness_bound(coupling: Mechanism) -> float:
    """Largest stiffness of the spring in size, N/m: at the alignment or far from it."""
    return coupling.stiffness * max(coupling.free_length / coupling.height - 1.0, 1.0)


stiffness_bound = by_type({Spring: spring_stiffness_bound, Mechanism: mechanism_stiffness_bound})
"""Largest stiffness of a coupling but for its stops, N/m."""


@kernel
def spring_stored(coupling: Spring, stretch: float) -> float:
    """Energy, J."""
    return 0.5 * coupling.stiffness * stretch * stretch


@kernel
def mechanism_stored(coupling: Mechanism, stretch: float) -> float:
    """Energy of mechanism and stops, J."""
    x = coupling.rest + stretch
    depth = max(x - coupling.front_stop, coupling.rear_stop - x, 0.0)
    spring = bistable.energy(coupling.stiffness, coupling.free_length, coupling.height, x)
    return spring + 0.5 * coupling.stop_stiffness * depth * depth


stored = by_type({Spring: spring_stored, Mechanism: mechanism_stored})
"""Energy of a coupling, J."""


@kernel
def spring_floor(coupling: Spring, side: int) -> tuple[float, float]:
    """J; there is no other side."""
    return 0.0, math.inf


@kernel
def mechanism_floor(coupling: Mechanism, side: int) -> tuple[float, float]:
    """J; lowest where the slider rests on a stop: on the front one known, on the rear one bounded.

    Behind its stop the spring pushes with less than F = k (L0 - H), which the stop of stiffness k_s gives at most
    F^2 / (2 k_s) for.
    """
    k, L0, H = coupling.stiffness, coupling.free_length, coupling.height
    barrier = bistable.energy(k, L0, H, 0.0)
    if side > 0:
        return mechanism_stored(coupling, 0.0), barrier
    F = k * (L0 - H)
    return max(bistable.energy(k, L0, H, coupling.rear_stop) - 0.5 * F * F / coupling.stop_stiffness, 0.0), barrier


floor = by_type({Spring: spring_floor, Mechanism: mechanism_floor})
"""A bound from below on the energy of a coupling on one side of the alignment, and that between the sides, J."""


@kernel
def spring_reach(coupling: Spring, stretch: float, kinetic: float) -> float:
    """Largest stretch (m) that the energy of the spring and `kinetic` (J) allow."""
    return math.sqrt(stretch * stretch + 2.0 * kinetic / coupling.stiffness)


@kernel
def mechanism_reach(coupling: Mechanism, stretch: float, kinetic: float) -> float:
    """Largest stretch (m) that the energy of mechanism and stops and `kinetic` (J) allow.

    Behind the alignment with less energy than the barrier the slider stays there; else the front stop, which holds
    no more energy than there is, ends its way.
    """
    x = coupling.rest + stretch
    energy = kinetic + mechanism_stored(coupling, stretch)
    if x < 0.0 and energy < bistable.energy(coupling.stiffness, coupling.free_length, coupling.height, 0.0):
        return -coupling.rest
    return coupling.front_stop - coupling.rest + math.sqrt(2.0 * energy / coupling.stop_stiffness)


reach = by_type({Spring: spring_reach, Mechanism: mechanism_reach})
"""A bound on the stretch to come, m, while the flange rests and nothing else pushes the tool."""
