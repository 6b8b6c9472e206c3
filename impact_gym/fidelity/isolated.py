"""An isolated contact: the restitution that it delivers, its duration, and what a push takes off the restitution.

With m = n the contact u'' = -u^m (1 + d u') has an orbit in closed form (Hunt, Crossley, J. Appl. Mech. 42 (1975)
440-445): u^(m + 1) / (m + 1) = G(1) - G(u') with G(w) = w / d - ln(1 + d w) / d^2. Duration and sensitivity are
integrals along it. Other exponents are taken for the contact with n = m that delivers the same restitution, which is
exact without damping; with e = 0.3 delivered as 0.06 by m = 1, n = 0 the duration is a fifth too long.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import roots_jacobi

from impact_gym.physics.dissipation import damping_factor, delivered_by, exact
from impact_gym.scene import Contact

PEAK_ELASTIC, PEAK_DAMPED = 1.14, 0.6
"""F_peak / F0 without damping (1.1433), and over d^(1 / (m + 1)) with much (0.605 at d = 148.5): both ends for m = 3/2
from an independent solver; half way between the true peak is up to a quarter smaller."""

NODES = 40  # of a quadrature: durations to 1e-11 up to d = 148.5
LEAST_DAMPING = 1e-4  # below it the orbit is that of this d, or G would lose its digits: durations to 1e-5

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Isolated:
    """A contact that nothing else pushes, in its own scales."""

    time: float  # s, t0
    force: float  # N, F0
    duration: float  # s
    damping: float  # -, d
    restitution: float  # -, delivered
    sensitivity: float  # -, loss of restitution per push phi = (acceleration) t0 / v: -de/dphi at phi = 0
    exponent: float  # -, m

    def detection(self, threshold: float) -> float:
        """Time (s) after the onset at which the force passes `threshold` (N), inf if it never does.

        The onset alone, u = t / t0 and f = u^m (1 + d): for how long a brake acts, not for its instant.
        """
        m, d = self.exponent, self.damping
        peak = self.force * math.hypot(PEAK_ELASTIC, PEAK_DAMPED * d ** (1.0 / (m + 1.0)))
        if threshold > peak:
            return math.inf
        return self.time * min((threshold / (self.force * (1.0 + d))) ** (1.0 / m), 1.0)


@lru_cache(maxsize=64)
def _nodes(power: float) -> tuple[Array, Array]:
    """Nodes from 0 to 1 and weights for an integrand that grows as (distance)^-power at both ends."""
    x, weights = roots_jacobi(NODES, -power, -power)
    return 0.5 * (1.0 + x), 0.5 * weights * ((1.0 - x) * (1.0 + x)) ** power


@lru_cache(maxsize=4096)
def shape(contact: Contact) -> tuple[float, float, float, float]:
    """Damping factor d, delivered restitution e, duration over t0 and sensitivity of `contact`; all dimensionless.

    With q = ln((1 + d) / (1 + d u')) from 0 to Q = d (1 + e) along the orbit, dt = dq / (d u^m). A small push phi adds
    phi / (1 + d u') to d/du of G along the unperturbed orbit, so that

        -de/dphi = 1 / (d^2 e) times the integral of (exp(q - Q) - exp(L - Q)) / u^m dq,    L = ln(1 + d),

    good as long as phi << u^m (1 + d u') almost everywhere: at d = 13.5 a push of 1e-5 already takes 29 % more.
    """
    m, n = contact.stiffness_exponent, contact.damping_exponent
    d = damping_factor(contact.dissipation, contact.restitution, m, n)
    e = min(delivered_by(d, m, n), 1.0) if d > 0.0 else 1.0
    if m != n and e < 1.0:
        d = float(exact(e))
    used = max(d, LEAST_DAMPING)
    least = e if used == d else delivered_by(used, m, m)
    L, Q = math.log1p(used), used * (1.0 + least)
    share, weights = _nodes(m / (m + 1.0))
    q = Q * share
    gone = (-np.expm1(-q) * (1.0 + used) / used - q / used) / used  # G(1) - G(u'), as 1 - u' = (1 + d)(1 - e^-q) / d
    slowness = weights * Q / ((m + 1.0) * gone) ** (m / (m + 1.0))
    duration = float(slowness.sum()) / used
    lost = float((slowness * (np.exp(q - Q) - math.exp(L - Q))).sum()) / (used**2 * least)
    return d, e, duration, lost * d / used


def isolated(contact: Contact, reduced_mass: float, velocity: float) -> Isolated:
    """Return the contact of `reduced_mass` (kg) that begins at `velocity` (m/s)."""
    d, e, duration, sensitivity = shape(contact)
    m = contact.stiffness_exponent
    t0 = (reduced_mass * velocity**2 / contact.stiffness) ** (1.0 / (m + 1.0)) / velocity
    return Isolated(t0, reduced_mass * velocity / t0, duration * t0, d, e, sensitivity, m)
