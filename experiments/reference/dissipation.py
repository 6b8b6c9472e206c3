"""Damping factor d of a contact from its restitution e: f = u^m + d u^n w in the contact's own scales.

chi = d k_c delta0^(m-n) / v_in, which for m = n is the usual d = chi v_in / k_c.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import exp, log, log1p

import numpy as np
from numpy import emath
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

CLOSURES: dict[str, Callable[[float], float]] = {
    "hu-guo": lambda e: 1.5 * (1 - e) / e,  # paper, eq. 7; Hu and Guo 2015
    "hunt-crossley": lambda e: 1.5 * (1 - e),  # Hunt and Crossley 1975
    "lankarani-nikravesh": lambda e: 0.75 * (1 - e * e),  # Lankarani and Nikravesh 1990
    "flores": lambda e: 1.6 * (1 - e) / e,  # Flores, Machado, Silva and Martins 2011
    "gonthier": lambda e: (1 - e * e) / e,  # Gonthier, McPhee, Lange and Piedboeuf 2004
    "herbert-mcwhannell": lambda e: 6 * (1 - e) / ((2 * e - 1) ** 2 + 3),  # Herbert and McWhannell 1977
}
STIFF = 1e3  # d beyond which an isolated contact is left to an implicit method


def damping_factor(name: str, e: float, m: float, n: float) -> float:
    """Return d for restitution e and exponents m, n; "exact": that with which an isolated contact has restitution e."""
    if name in CLOSURES:
        return CLOSURES[name](e)
    if name != "exact":
        raise ValueError(f"reference: no dissipation {name!r}; there are {[*CLOSURES, 'exact']}")
    if e == 1:
        return 0.0
    if m == n:
        return _equal_exponents(e)
    if (m, n) == (1, 0):
        # the restitution falls from 1 at zeta = 0 and is 1/(4 zeta^2) for large zeta
        return 2 * exp(brentq(lambda x: log(linear_restitution(exp(x)) / e), -40.0, 1.0 - log(e), xtol=1e-15))
    return _isolated(e, m, n)


def linear_restitution(zeta: float) -> float:
    """Of a linear spring and damper that never pulls: speed where x'' = 0 again, over that at the onset."""
    critical = abs(zeta - 1) < 1e-9
    ratio = 1 - (zeta - 1) / 3 if critical else abs(emath.arccos(zeta) / emath.sqrt(1 - zeta**2))
    return exp(-2 * zeta * ratio)


def _equal_exponents(e: float) -> float:
    """Root of ln((1+d)/(1-d e)) = d (1+e), as phi(d) = e^2 phi(-d e): without the root d = 0 and cancellation."""

    def phi(z: float) -> float:  # (ln(1+z) - z)/z^2
        if abs(z) > 0.1:
            return (log1p(z) - z) / z**2
        return float(sum((-1) ** (k + 1) * z ** (k - 2) / k for k in range(2, 20)))

    def excess(d: float) -> float:
        return phi(d) - e**2 * phi(-d * e)

    limit = (1 - 1e-15) / e
    # 1 - d e is about exp(-1/e): below e = 0.03 the root is 1/e to rounding
    return float(brentq(excess, 0.0, limit, xtol=1e-300, rtol=1e-15)) if excess(limit) > 0 else 1 / e


@cache
def _isolated(e: float, m: float, n: float) -> float:
    """As `damping_factor`, by integrating isolated contacts."""
    upper = 1.0
    while isolated_restitution(upper, m, n) > e:
        upper *= 4
    return exp(brentq(lambda x: log(isolated_restitution(exp(x), m, n) / e), log((1 - e) / 10), log(upper), xtol=1e-13))


def isolated_restitution(d: float, m: float, n: float) -> float:
    """Separation speed of u'' = -max(0, u^m + d u^n u'), u(0) = 0, u'(0) = 1.

    For n < m the force is clamped once and stays so: u^(m-n) + d u' goes on falling while u coasts back. For n >= m it
    is never clamped.
    """

    def rates(_: float, y: list[float]) -> tuple[float, float]:
        u = max(float(y[0]), 0.0)
        return y[1], -(u**m + d * u**n * y[1])

    def end(_: float, y: list[float]) -> float:
        return float(max(y[0], 0.0) ** (m - n) + d * y[1] if n < m else y[0])

    end.terminal, end.direction = True, -1  # type: ignore[attr-defined]
    method = "Radau" if d > STIFF else "DOP853"
    run = solve_ivp(rates, (0.0, np.inf), [0.0, 1.0], method, events=end, rtol=1e-13, atol=1e-15, first_step=1e-6)
    return -float(run.y[1, -1])
