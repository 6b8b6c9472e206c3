"""From the nominal restitution to the damping factor d = (chi / k_c) v_in, and on to the restitution it delivers.

Everything about an isolated contact with m = n depends on d alone, whatever the exponent, the masses, the stiffness and
the velocity: multiply u'' = -u^n (1 + d u') by u' / (1 + d u') and integrate from onset to separation:

    d - ln(1 + d) = -z - ln(1 - z),      z = d e_eff                                   (closed form: Lambert's W)

The published laws approximate the solution of this equation for d. They are collected, with others, in Skrinjar,
Slavic, Boltezar, Int. J. Mech. Sci. 145 (2018) 171-187 (the paper's reference 11).
"""

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from impact_gym.kernel import kernel

_SERIES_BELOW, _SERIES_TERMS = 0.3, 34


@kernel
def hu_guo(restitution: float) -> float:
    """Damping factor after Hu and Guo, Multibody Syst. Dyn. 35 (2015) 131-151 (paper, eq. 7)."""
    return 1.5 * (1.0 - restitution) / restitution


def hunt_crossley(restitution: float) -> float:
    """Damping factor after Hunt and Crossley, J. Appl. Mech. 42 (1975) 440-445; for e near 1."""
    return 1.5 * (1.0 - restitution)


def lankarani_nikravesh(restitution: float) -> float:
    """Damping factor after Lankarani and Nikravesh, J. Mech. Des. 112 (1990) 369-376; for e near 1."""
    return 0.75 * (1.0 - restitution) * (1.0 + restitution)


def herbert_mcwhannell(restitution: float) -> float:
    """Damping factor after Herbert and McWhannell, J. Eng. Ind. 99 (1977) 263-266."""
    return 6.0 * (1.0 - restitution) / ((2.0 * restitution - 1.0) ** 2 + 3.0)


def gonthier(restitution: float) -> float:
    """Damping factor after Gonthier, McPhee, Lange, Piedboeuf, Multibody Syst. Dyn. 11 (2004) 209-233; for small e."""
    return (1.0 - restitution) * (1.0 + restitution) / restitution


def flores(restitution: float) -> float:
    """Damping factor after Flores, Machado, Silva, Martins, Multibody Syst. Dyn. 25 (2011) 357-375."""
    return 1.6 * (1.0 - restitution) / restitution


@kernel
def _shortfall(x: float) -> float:
    """(1 - phi(x)) / x with phi(x) = 2 (x - ln(1 + x)) / x^2, which is 2/3 - x/2 + 2 x^2/5 - ..."""
    if abs(x) > _SERIES_BELOW:
        return (1.0 - 2.0 * (x - math.log1p(x)) / (x * x)) / x
    total = 0.0
    for k in range(_SERIES_TERMS, 0, -1):
        total = 2.0 / (k + 2.0) - x * total
    return total


@kernel
def exact(restitution: float) -> float:
    """Damping factor that delivers the restitution: ln((1 + d) / (1 - d e)) = d (1 + e).

    In terms of `_shortfall` the equation reads (1 - e)(1 + e) = d (S(d) + e^3 S(-d e)), which loses nothing as e -> 1;
    for small e the root lies close under 1 / e and is found from 1 - d e = exp(ln(1 + d) - d (1 + e)).
    """
    e = restitution
    if e > 0.6:  # d < 1.1
        d = 1.5 * (1.0 - e)
        for _ in range(200):
            following = (1.0 - e) * (1.0 + e) / (_shortfall(d) + e * e * e * _shortfall(-d * e))
            if abs(following - d) <= 1e-16 * d:
                break
            d = following
        return d
    d = 1.0 / e
    for _ in range(200):
        rest = math.exp(math.log1p(d) - d * (1.0 + e))
        following = d - (d * e - 1.0 + rest) / (e - rest * (1.0 + e - 1.0 / (1.0 + d)))
        if abs(following - d) <= 1e-16 * d:
            break
        d = following
    return d


@kernel
def delivered(damping: float) -> float:
    """Restitution of an isolated contact with m = n and damping factor `damping`; relative error a few 1e-15.

    Newton's method: for small d on e^2 (1 + d e S(-d e)) = 1 - d S(d), else on q = -ln(1 - z), q - z = d - ln(1 + d),
    which does not feel how close z = d e comes to 1.
    """
    d = damping
    if d < _SERIES_BELOW:
        e = 1.0 - 2.0 / 3.0 * d * (1.0 - 2.0 / 3.0 * d)
        excess = d * _shortfall(d)
        for _ in range(50):
            gain = d * e * _shortfall(-d * e)
            residual = (e - 1.0) * (e + 1.0) + e * e * gain + excess
            step = residual * (1.0 - d * e) / (2.0 * e)
            e -= step
            if abs(step) <= 2e-16:
                break
        return e
    rest = d - math.log1p(d)
    q = rest + 1.0 if rest > 1.0 else math.sqrt(2.0 * rest)
    for _ in range(50):
        step = (q + math.expm1(-q) - rest) / -math.expm1(-q)
        q -= step
        if abs(step) <= 1e-16 * q:
            break
    return -math.expm1(-q) / d


@kernel
def delivered_linear(damping: float) -> float:
    """Restitution of the linear contact m = 1, n = 0, whose force ends before it would pull; d = 2 zeta.

    e = exp(-2 zeta arccos(zeta) / sqrt(1 - zeta^2)), hyperbolic above critical damping: exp(-2) at zeta = 1.
    """
    zeta = 0.5 * damping
    square = (1.0 - zeta) * (1.0 + zeta)
    if abs(square) < 1e-6:  # arccos(zeta) / sqrt(1 - zeta^2) = 1 + y/6 + 3 y^2/40 + ... with y = 1 - zeta^2
        ratio = 1.0 + square * (1.0 / 6.0 + square * 3.0 / 40.0)
    elif square > 0.0:
        ratio = math.acos(zeta) / math.sqrt(square)
    else:
        ratio = math.acosh(zeta) / math.sqrt(-square)
    return math.exp(-2.0 * zeta * ratio)


def delivered_by(damping: float, stiffness_exponent: float, damping_exponent: float) -> float:
    """Restitution of an isolated contact u'' = -(u^m + d u^n u')+, in closed form where there is one."""
    m, n, d = stiffness_exponent, damping_exponent, damping
    if m == n:
        return float(delivered(d))
    if (m, n) == (1.0, 0.0):
        return float(delivered_linear(d))

    def rate(_: float, state: NDArray[np.float64]) -> tuple[float, float]:
        u, w = max(state[0], 0.0), state[1]
        return w, -max(u**m + d * u**n * w, 0.0)

    def parted(_: float, state: NDArray[np.float64]) -> float:
        return float(state[0])

    parted.terminal, parted.direction = True, -1  # type: ignore[attr-defined]  # how solve_ivp is told
    run = solve_ivp(rate, (0.0, 1e9), (0.0, 1.0), "LSODA", events=parted, rtol=1e-12, atol=1e-15, first_step=1e-3)
    return -float(run.y[1, -1])


PUBLISHED: dict[str, Callable[[float], float]] = {
    "hu-guo": hu_guo,
    "hunt-crossley": hunt_crossley,
    "lankarani-nikravesh": lankarani_nikravesh,
    "herbert-mcwhannell": herbert_mcwhannell,
    "gonthier": gonthier,
    "flores": flores,
}


@lru_cache(maxsize=4096)
def damping_factor(
    law: str, restitution: float, stiffness_exponent: float = 1.5, damping_exponent: float = 1.5
) -> float:
    """Damping factor d that `law` gives a contact of nominal `restitution`.

    The published laws say what d is and do not ask for the exponents; "exact" delivers the restitution whatever they
    are.
    """
    m, n = stiffness_exponent, damping_exponent
    if law != "exact":
        return float(PUBLISHED[law](restitution))
    if m == n:
        return float(exact(restitution))
    if restitution == 1.0:
        return 0.0

    def excess(log_damping: float) -> float:
        return math.log(delivered_by(math.exp(log_damping), m, n) / restitution)

    low = high = math.log(exact(restitution))
    while excess(low) < 0.0:
        low -= 1.0
    while excess(high) > 0.0:
        high += 1.0
    return math.exp(brentq(excess, low, high, xtol=1e-14, rtol=1e-14))


def effective_restitution(law: str, restitution: ArrayLike) -> NDArray[np.float64] | float:
    """Restitution that an isolated contact with m = n really has under `law`, of the shape of `restitution`.

    Raises:
        ValueError: `law` is not known, or a restitution is outside (0, 1].
    """
    laws = ("exact", *PUBLISHED)
    if law not in laws:
        raise ValueError(f"law must be one of {laws}, got {law!r}")
    nominal = np.asarray(restitution, np.float64)
    if not np.all((nominal > 0.0) & (nominal <= 1.0)):
        raise ValueError(f"restitution must be above 0 and at most 1 (no unit), got {restitution!r}")
    result = np.vectorize(lambda e: delivered(damping_factor(law, float(e))), otypes=[np.float64])(nominal)
    return result if result.ndim else float(result)
