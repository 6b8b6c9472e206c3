"""Where and how fast a tool meets the object, in closed form: a trapezoid carries at most one mass on a spring."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_gym.motion import Trapezoid
from impact_gym.physics.coupling import decay_basis

Array = NDArray[np.float64]

PHASE_STEP = 0.25  # rad, of the oscillation, between two points of the first search
POINTS = 400  # of the first search, at most
SLOWEST = 0.01  # share of the flange's speed below which an approach velocity is no longer used as a scale


@dataclass(frozen=True, slots=True)
class Mass:
    """A mass on a spring and damper whose base moves: y'' + 2 zeta omega y' + omega^2 y = -a (paper, eq. 8 and 17)."""

    frequency: float  # rad/s, omega
    damping_ratio: float  # -, zeta

    @classmethod
    def of(cls, mass: float, stiffness: float, damping: float) -> "Mass":
        """Return it for `mass` (kg), `stiffness` (N/m) and `damping` (N s/m)."""
        return cls(math.sqrt(stiffness / mass), 0.5 * damping / math.sqrt(stiffness * mass))

    @property
    def decay(self) -> float:
        """Rate at which the slowest part of its oscillation dies out, 1/s."""
        zeta = self.damping_ratio
        return self.frequency * (zeta if zeta < 1.0 else 1.0 / (zeta + math.sqrt((zeta - 1.0) * (zeta + 1.0))))

    def flown(self, deflection: float, rate: float, acceleration: float, time: Array) -> tuple[Array, Array]:
        """Return deflection (m) and its rate (m/s) after `time` (s) under a constant `acceleration` (m/s^2)."""
        omega, alpha = self.frequency, self.damping_ratio * self.frequency
        rest = -acceleration / omega**2
        z = deflection - rest
        cosine, sine = _basis(omega, self.damping_ratio, time)
        return rest + z * cosine + (rate + alpha * z) * sine, rate * cosine - (omega**2 * z + alpha * rate) * sine


def _basis(omega: float, zeta: float, time: Array) -> tuple[Array, Array]:
    """`physics.coupling.decay_basis` for an array of times (s); where digits would cancel, by that itself."""
    square = (zeta - 1.0) * (zeta + 1.0) * omega * omega
    if time.size < 8 or abs(square) < 1e-4 * omega * omega:
        pairs = np.array([decay_basis(omega, zeta, float(t)) for t in time]).reshape(-1, 2)
        return pairs[:, 0], pairs[:, 1]
    if square < 0.0:
        damped = math.sqrt(-square)
        envelope = np.exp(-zeta * omega * time)
        return envelope * np.cos(damped * time), envelope * np.sin(damped * time) / damped
    split = math.sqrt(square)
    slow = np.exp(-omega * omega / (zeta * omega + split) * time)
    lost = -np.expm1(-2.0 * split * time)
    return slow * (1.0 - 0.5 * lost), slow * lost / (2.0 * split)


@dataclass(frozen=True, slots=True)
class Encounter:
    """The state in which the tool first touches the object."""

    time: float  # s
    velocity: float  # m/s, of the tool
    flange_velocity: float  # m/s, imposed
    acceleration: float  # m/s^2, imposed: that of the ramp, or 0 behind it
    deflection: float  # m, of the tool from the imposed motion
    deflection_rate: float  # m/s


def path(motion: Trapezoid, time: Array) -> tuple[Array, Array]:
    """Position (m) and velocity (m/s) of the imposed motion at `time` (s), without its brake."""
    rising = np.minimum(time, motion.speed / motion.acceleration)
    velocity = motion.acceleration * rising
    return 0.5 * velocity * rising + motion.speed * (time - rising), velocity


def _deflection(motion: Trapezoid, mass: Mass, time: Array) -> tuple[Array, Array]:
    """Deflection (m) and rate (m/s) of `mass` at `time` (s) of an approach that nothing hinders."""
    ramp = motion.speed / motion.acceleration
    y, y_dot = mass.flown(0.0, 0.0, motion.acceleration, np.append(np.minimum(time, ramp), ramp))
    held, held_rate = mass.flown(float(y[-1]), float(y_dot[-1]), 0.0, np.maximum(time - ramp, 0.0))
    late = time > ramp
    return np.where(late, held, y[:-1]), np.where(late, held_rate, y_dot[:-1])


def meet(motion: Trapezoid, distance: float, mass: Mass | None = None) -> Encounter:
    """Return how a tool on `mass`, or on the flange itself, meets an object `distance` (m) ahead."""
    ramp = motion.speed / motion.acceleration

    def when(position: float) -> float:
        rise = 0.5 * motion.speed * ramp
        if position <= rise:
            return math.sqrt(max(2.0 * position, 0.0) / motion.acceleration)
        return ramp + (position - rise) / motion.speed

    time = when(distance)
    y = y_dot = 0.0
    if mass is not None:
        reach = 4.0 * motion.acceleration / mass.frequency**2  # |y| after two undamped steps of acceleration
        low, high = when(distance - reach), when(distance + reach)
        count = int(min(max(16.0, mass.frequency * (high - low) / PHASE_STEP), POINTS))
        for _ in range(4):  # each time the interval of the first crossing, cut finer; the last by its secant
            grid = np.linspace(low, high, count)
            gap = distance - path(motion, grid)[0] - _deflection(motion, mass, grid)[0]
            touches = gap <= 0.0
            after = int(np.argmax(touches)) if touches.any() else count - 1
            before = max(after - 1, 0)
            low, high, count = float(grid[before]), float(grid[after]), 12
        share = gap[before] / (gap[before] - gap[after]) if gap[before] > gap[after] else 0.0
        time = low + min(max(float(share), 0.0), 1.0) * (high - low)
        y, y_dot = (float(value[0]) for value in _deflection(motion, mass, np.array([time])))
    flange = float(path(motion, np.array([time]))[1][0])
    acceleration = motion.acceleration if time < ramp else 0.0
    return Encounter(time, max(flange + y_dot, SLOWEST * flange), flange, acceleration, y, y_dot)
