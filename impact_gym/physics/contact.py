"""The contact force (paper, eq. 5 with m = n = 3/2) in the contact's own scales and in a variable that makes it smooth.

With M the reduced mass and v the approach velocity, a contact has the scales

    delta0 = (M v^2 / k_c)^(2/5)      t0 = delta0 / v      F0 = k_c delta0^(3/2) = M v / t0

In them the penetration is u = delta / delta0, its rate w = delta_dot / v, and the force f = u^(3/2) (1 + d w)+.
The half-integer power makes u(t) non-smooth at both ends of the contact. With the root z = sqrt(u) as the unknown and
s as the independent variable, dt = z ds, the same motion is

    dz/ds = w / 2      dw/ds = z (push - f)      f = z^3 (1 + d w)+

polynomial, and z passes through zero at onset and separation with a finite slope: an integrator keeps its full order
over the whole contact, and both ends are simple roots.
"""

from typing import NamedTuple

from impact_gym.kernel import kernel

APPROACH_VELOCITY_FLOOR = 1e-6
"""m/s. The hysteresis damping chi grows as 1 / v_in (paper, eq. 7) without bound; slower contacts use this value."""


class Scales(NamedTuple):
    """Natural units of one contact."""

    length: float  # m, delta0
    time: float  # s, t0
    velocity: float  # m/s, approach velocity, floored
    force: float  # N, F0


@kernel
def scales(reduced_mass: float, stiffness: float, approach_velocity: float) -> Scales:
    """Return the natural units of a contact that begins at `approach_velocity` (m/s)."""
    v = max(approach_velocity, APPROACH_VELOCITY_FLOOR)
    delta0 = (reduced_mass * v * v / stiffness) ** 0.4
    t0 = delta0 / v
    return Scales(delta0, t0, v, reduced_mass * v / t0)


@kernel
def grip(damping: float, rate: float) -> float:
    """1 + d w: where it is negative the surfaces part faster than they recover, and the force is clamped at zero."""
    return 1.0 + damping * rate


@kernel
def force(damping: float, root: float, rate: float) -> float:
    """Contact force over F0 (paper, eq. 5), never negative."""
    return root * root * root * max(grip(damping, rate), 0.0)


@kernel
def force_slope(damping: float, root: float, rate: float, rate_slope: float) -> float:
    """Sign and zero of the force's slope: (df/ds) / z^2, with dz/ds = w / 2 and dw/ds = `rate_slope`."""
    return 1.5 * rate * grip(damping, rate) + damping * root * rate_slope
