"""How a compliant robot swings when it arrives, in closed form, and how far a table's parameters drift until then."""

import cmath
import math
from dataclasses import dataclass

import numpy as np

from impact_gym.fidelity.encounter import SLOWEST, Encounter, Mass, meet, path
from impact_gym.fidelity.situation import Situation
from impact_gym.scene import Robot, RobotTable, SpringDamper

INSTANTS = 24
DISTINCT = 1e-7j  # keeps the two roots of a mass apart at critical damping, and off the poles of the means


@dataclass(frozen=True, slots=True)
class Swing:
    """A robot with constant parameters, with the tool on it unless that is behind a spring (paper, eq. 8)."""

    mass: float  # kg
    stiffness: float  # N/m
    frequency: float  # rad/s
    decay: float  # 1/s, of its amplitude below critical damping
    impact: float  # -, what the swing adds to the approach velocity, over the smaller of the two
    amplitude: float  # -, of its velocity at the impact, over v
    corner: float  # -, velocity amplitude that a corner of the trapezoid excites, over v
    scale: float  # -, v over the smaller of the two approach velocities
    recoil: float  # -, share of V_p that the recoil takes, for a tool that moves with the flange
    estimate: float  # -, by how much V_p differs from that of a rigid robot, for such a tool


def moving_mass(now: Situation) -> float:
    """Mass of the tool as far as it moves with the flange, kg."""
    return 0.0 if isinstance(now.scene.coupling, SpringDamper) else now.scene.tool.mass


def swing(now: Situation, robot: Robot) -> Swing:
    """Return how `robot` swings in the situation that a rigid one would be in."""
    m = robot.mass + moving_mass(now)
    mass = Mass.of(m, robot.stiffness, robot.damping)
    omega, v = mass.frequency, now.velocity
    met = meet(now.motion, now.scene.object.distance, mass)
    offset = met.deflection + met.acceleration / omega**2
    impact = abs(met.velocity - met.flange_velocity) / v
    scale, recoil, estimate = 1.0, 0.0, 0.0
    if not isinstance(now.scene.coupling, SpringDamper):
        smaller = min(max(met.velocity, 5.0 * SLOWEST * v), v)
        impact, scale = abs(met.velocity - v) / smaller, v / smaller
        faster, recoil = _answer(now, mass, met, m)
        estimate = abs((1.0 + recoil) / max(faster, 5.0 * SLOWEST) - 1.0)
    return Swing(
        m,
        robot.stiffness,
        omega,
        0.5 * robot.damping / m,
        impact,
        math.hypot(met.deflection_rate, omega * offset) / v,
        now.motion.acceleration / (omega * v),
        scale,
        recoil,
        estimate,
    )


def _answer(now: Situation, mass: Mass, met: Encounter, m: float) -> tuple[float, float]:
    """Velocity of the swinging mass over the rigid robot's, mean over the contact, and the mass's recoil over v.

    To first order in the motion of the tool a linear elastic contact of duration T weighs its velocity with
    w = sin(pi s / T): m_p x_p'' = k (x_t - x_p) from rest. With a force of the same shape the recoil is m_p / m times
    2 <<w(s) w(s') g(s - s')>> over s' < s, g the mass's velocity after a unit blow: m_p / m for a short contact, as in
    the paper's eq. 4, and 0 for a long one. Velocities are sums of C exp(-lambda s), whose integrals are closed forms.
    """
    T, sigma, omega = now.contact.duration, mass.damping_ratio * mass.frequency, mass.frequency
    split = cmath.sqrt((sigma - omega) * (sigma + omega) + DISTINCT * omega**2)
    fast, slow = sigma + split, sigma - split

    def parts(rate: float, acceleration: float) -> tuple[tuple[complex, complex], ...]:
        first = (acceleration + slow * rate) / (slow - fast)
        return (first, fast), (rate - first, slow)

    a = math.pi / T
    spring = -(omega**2) * met.deflection - 2.0 * sigma * met.deflection_rate - met.acceleration
    swinging = met.flange_velocity + 0.5 * met.acceleration * T
    for C, root in parts(met.deflection_rate, spring):
        swinging += (C * 0.5 * a**2 * (1.0 + cmath.exp(-root * T)) / (root**2 + a**2)).real
    recoil = 0.0
    for C, root in parts(1.0, -2.0 * sigma):
        whole = a**2 * (1.0 + cmath.exp(-root * T)) / (root**2 + a**2)
        recoil += (C * 0.25 * a**2 * (0.5 * root * T + whole) / (root**2 + a**2)).real
    rigid = now.met.flange_velocity + 0.5 * now.met.acceleration * T
    return swinging / rigid, max(2.0 * now.scene.object.mass / m * recoil, 0.0)


@dataclass(frozen=True, slots=True)
class Drift:
    """What freezing the parameters of a table at the impact gets wrong."""

    phase: float  # -, velocity over v by which the swing is off, from the phase it misses since each corner
    change: float  # -, of ln m and ln k, largest on the way
    rate: float  # 1/s, of ln m and ln k at the impact

    def during(self, now: Situation) -> float:
        """Change of ln m and ln k during the contact, -."""
        return min(self.rate * now.contact.duration, 1.0)


def drift(now: Situation, swing: Swing, table: RobotTable) -> Drift:
    """Return how far `table` drifts on the way to the impact, whose robot has `swing`."""
    ramp = now.motion.speed / now.motion.acceleration
    time = np.linspace(0.0, now.met.time, INSTANTS)
    first, last = table.position[0], table.position[-1]
    position = np.clip(path(now.motion, time)[0], first, last)
    mass, stiffness, damping = table.splines(position).T
    mass = mass + moving_mass(now)
    h = time[1] - time[0]
    missed = (np.sqrt(stiffness / mass) - swing.frequency) * h
    faded = (0.5 * damping / mass - swing.decay) * h
    phase = 0.0
    for corner in (0.0, ramp):
        if corner <= now.met.time:
            since = time >= corner
            fading = min(abs(float(faded[since].sum())), 5.0)
            size = swing.corner * math.exp(fading - min(swing.decay * (now.met.time - corner), 700.0))
            phase += size * min(abs(float(missed[since].sum())) + fading, 2.0)
    change = float(np.abs(np.log(mass / mass[-1])).max() + np.abs(np.log(stiffness / stiffness[-1])).max())
    place, step = now.scene.object.distance, 1e-3
    here = table.splines(np.clip([place - step, place + step], first, last))
    slopes = np.abs(np.log(here[1, :2] / here[0, :2])) / (2.0 * step)
    return Drift(phase, change, float(slopes.sum()) * now.velocity)
