"""The contact force (paper, eq. 5) in the contact's own scales and in a variable that makes it smooth.

With M the reduced mass and v the approach velocity, a contact has the scales

    delta0 = (M v^2 / k_c)^(1 / (m + 1))      t0 = delta0 / v      F0 = k_c delta0^m = M v / t0

In them the penetration is u = delta / delta0, its rate w = delta_dot / v, and the force f = (u^m + d u^n w)+.
With m = n = 3/2 the half-integer power makes u(t) non-smooth at both ends of the contact. With the root z = sqrt(u)
as the unknown and s as the independent variable, dt = z ds, the same motion is

    dz/ds = w / 2      dw/ds = z (push - f)      f = z^3 (1 + d w)+

polynomial, and z passes through zero at onset and separation with a finite slope: an integrator keeps its full order
over the whole contact, and both ends are simple roots. Other exponents use the same variable; with 2 m and 2 n whole
they are polynomial too.
"""

from typing import NamedTuple

from impact_gym.kernel import by_type, inner_kernel

APPROACH_VELOCITY_FLOOR = 1e-6
"""m/s. The hysteresis damping chi grows as 1 / v_in (paper, eq. 7) without bound; slower contacts use this value."""


class Hertz(NamedTuple):
    """m = n = 3/2."""

    stiffness: float  # N/m^1.5, k_c
    damping: float  # -, damping factor d


class Power(NamedTuple):
    """Any exponents."""

    stiffness: float  # N/m^m, k_c
    damping: float  # -, damping factor d
    m: float  # -, at least 1
    n: float  # -, 0 or at least 1


Force = Hertz | Power


class Scales(NamedTuple):
    """Natural units of one contact."""

    length: float  # m, delta0
    time: float  # s, t0
    velocity: float  # m/s, approach velocity, floored
    force: float  # N, F0


@inner_kernel
def hertz_length(law: Hertz, energy: float) -> float:
    """delta0, m, of a contact with `energy` M v^2 (J)."""
    return (energy / law.stiffness) ** 0.4


@inner_kernel
def power_length(law: Power, energy: float) -> float:
    """delta0, m, of a contact with `energy` M v^2 (J)."""
    return (energy / law.stiffness) ** (1.0 / (law.m + 1.0))


@inner_kernel
def hertz_grip(law: Hertz, root: float, rate: float) -> float:
    """1 + d w."""
    return 1.0 + law.damping * rate


@inner_kernel
def power_grip(law: Power, root: float, rate: float) -> float:
    """u^m + d u^n w without the lower of the two powers."""
    u = root * root
    if law.m >= law.n:
        grip: float = u ** (law.m - law.n) + law.damping * rate
        return grip
    return 1.0 + law.damping * u ** (law.n - law.m) * rate


@inner_kernel
def hertz_grip_slope(law: Hertz, root: float, rate: float, rate_slope: float) -> float:
    """d(grip)/ds, with dz/ds = w / 2 and dw/ds = `rate_slope`."""
    return law.damping * rate_slope


@inner_kernel
def power_grip_slope(law: Power, root: float, rate: float, rate_slope: float) -> float:
    """d(grip)/ds, with dz/ds = w / 2 and dw/ds = `rate_slope`."""
    p = abs(law.m - law.n)
    growth = p * root ** (2.0 * p - 1.0) * rate if p > 0.0 else 0.0  # d(u^p)/ds
    if law.m >= law.n:
        return growth + law.damping * rate_slope
    return law.damping * (growth * rate + root ** (2.0 * p) * rate_slope)


@inner_kernel
def hertz_force(law: Hertz, root: float, rate: float) -> float:
    """Contact force over F0."""
    return root * root * root * max(1.0 + law.damping * rate, 0.0)


@inner_kernel
def power_force(law: Power, root: float, rate: float) -> float:
    """Contact force over F0."""
    u = root * root
    return max(u**law.m + law.damping * u**law.n * rate, 0.0)


@inner_kernel
def hertz_force_slope(law: Hertz, root: float, rate: float, rate_slope: float) -> float:
    """(df/ds) / z^2."""
    return 1.5 * rate * (1.0 + law.damping * rate) + law.damping * root * rate_slope


@inner_kernel
def power_force_slope(law: Power, root: float, rate: float, rate_slope: float) -> float:
    """(df/ds) / z^(2 k - 1) with k the lower power, or 1 if n = 0."""
    u = root * root
    if law.n > 0.0:
        k = min(law.m, law.n)
        damping_part = law.damping * u ** (law.n - k) * (law.n * rate * rate + root * rate_slope)
        return law.m * u ** (law.m - k) * rate + damping_part
    acceleration = rate_slope / root if root > 0.0 else -law.damping * rate  # at the onset, but for the push
    return law.m * u ** (law.m - 1.0) * rate + law.damping * acceleration


@inner_kernel
def hertz_slope_scale(law: Hertz, root: float) -> float:
    """z^2."""
    return root * root


@inner_kernel
def power_slope_scale(law: Power, root: float) -> float:
    """z^(2 k - 1) with k the lower power, or 1 if n = 0."""
    lower = min(law.m, law.n) if law.n > 0.0 else 1.0
    scale: float = root ** (2.0 * lower - 1.0)
    return scale


@inner_kernel
def hertz_force_gradient(law: Hertz, root: float, rate: float) -> tuple[float, float]:
    """df/dz and df/dw."""
    grip = 1.0 + law.damping * rate
    if grip <= 0.0:
        return 0.0, 0.0
    return 3.0 * root * root * grip, law.damping * root * root * root


@inner_kernel
def power_force_gradient(law: Power, root: float, rate: float) -> tuple[float, float]:
    """df/dz and df/dw."""
    u = root * root
    if u**law.m + law.damping * u**law.n * rate <= 0.0:
        return 0.0, 0.0
    by_root = 2.0 * law.m * root * u ** (law.m - 1.0)
    if law.n > 0.0:
        by_root += 2.0 * law.n * law.damping * root * u ** (law.n - 1.0) * rate
    return by_root, law.damping * u**law.n


length = by_type({Hertz: hertz_length, Power: power_length})
"""delta0, m, of a contact with energy M v^2 (J)."""
grip = by_type({Hertz: hertz_grip, Power: power_grip})
"""Has the sign of the force before it is clamped: where it is negative the surfaces part faster than they recover."""
grip_slope = by_type({Hertz: hertz_grip_slope, Power: power_grip_slope})
"""d(grip)/ds."""
force = by_type({Hertz: hertz_force, Power: power_force})
"""Contact force over F0 (paper, eq. 5), never negative."""
force_slope = by_type({Hertz: hertz_force_slope, Power: power_force_slope})
"""Sign and zero of the force's slope, scaled so that it is not zero at the onset."""
force_gradient = by_type({Hertz: hertz_force_gradient, Power: power_force_gradient})
"""Derivatives of the force over F0 by z and by w."""
slope_scale = by_type({Hertz: hertz_slope_scale, Power: power_slope_scale})
"""What `force_slope` is to be multiplied with for df/ds."""


@inner_kernel
def scales(law: Force, reduced_mass: float, approach_velocity: float) -> Scales:
    """Return the natural units of a contact that begins at `approach_velocity` (m/s)."""
    v = max(approach_velocity, APPROACH_VELOCITY_FLOOR)
    delta0 = length(law, reduced_mass * v * v)
    t0 = delta0 / v
    return Scales(delta0, t0, v, reduced_mass * v / t0)
