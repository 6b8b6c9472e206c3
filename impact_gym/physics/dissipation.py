"""Damping factors of contacts for a nominal restitution, and the restitution that a contact really has.

If stiffness and damping have equal exponents, m = n, the damping factor is d = (chi / k_c) v_in, with the hysteresis
damping chi, stiffness k_c and approach velocity v_in. An isolated contact (no other force) of restitution e satisfies
d - ln(1 + d) = -z - ln(1 - z), with z = d e (see `damping.pxi`). Published laws are approximate solutions for d.
Skrinjar, Slavic, Boltezar, Int. J. Mech. Sci. 145 (2018) 171-187 (the paper's reference 11) collect these and more.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from impact_gym.kernels import delivered, delivered_linear, exact_damping, hu_guo, separation_velocity
from impact_gym.support.validation import choice


class DampingLaw(NamedTuple):
    """A published law: damping factor d as a function of the nominal restitution e."""

    factor: Callable[[float], float]
    formula: str
    source: str


PUBLISHED = {
    "hu-guo": DampingLaw(hu_guo, r"\tfrac32 (1 - e) / e", "Hu and Guo (2015), the paper's eq. 7"),
    "hunt-crossley": DampingLaw(lambda e: 1.5 * (1.0 - e), r"\tfrac32 (1 - e)", "J. Appl. Mech. 42 (1975) 440-445"),
    "lankarani-nikravesh": DampingLaw(
        lambda e: 0.75 * (1.0 - e) * (1.0 + e), r"\tfrac34 (1 - e^2)", "J. Mech. Des. 112 (1990) 369-376"
    ),
    "herbert-mcwhannell": DampingLaw(
        lambda e: 6.0 * (1.0 - e) / ((2.0 * e - 1.0) ** 2 + 3.0),
        "6 (1 - e) / ((2e - 1)^2 + 3)", "J. Eng. Ind. 99 (1977) 263-266",
    ),
    "gonthier": DampingLaw(
        lambda e: (1.0 - e) * (1.0 + e) / e,
        "(1 - e^2) / e", "with McPhee, Lange, Piedboeuf, Multibody Syst. Dyn. 11 (2004) 209-233, for small e",
    ),
    "flores": DampingLaw(
        lambda e: 1.6 * (1.0 - e) / e,
        r"\tfrac85 (1 - e) / e", "with Machado, Silva, Martins, Multibody Syst. Dyn. 25 (2011) 357-375",
    ),
}  # fmt: skip
"""Published laws by name. "hunt-crossley" and "lankarani-nikravesh" are meant for e near 1."""


def damping_factor(
    law: str, restitution: float, stiffness_exponent: float = 1.5, damping_exponent: float = 1.5
) -> float:
    """Return the damping factor d that `law` gives for a nominal `restitution`.

    Published laws do not depend on the exponents. With the d of "exact", an isolated contact has the nominal
    restitution, whatever the exponents. For "fixed" (see `Contact`), the result is d at the reference velocity, which
    equals the d of "exact".
    """
    if law not in ("exact", "fixed"):
        return float(PUBLISHED[law].factor(restitution))
    return _exact_factor(restitution, stiffness_exponent, damping_exponent)


@lru_cache(maxsize=4096)
def _exact_factor(restitution: float, m: float, n: float) -> float:
    if m == n:
        return float(exact_damping(restitution))
    if restitution == 1.0:
        return 0.0

    def excess(log_damping: float) -> float:
        d = math.exp(log_damping)  # damping factor of an isolated contact, u'' = -max(u^m + d u^n u', 0)
        result = delivered_linear(d) if (m, n) == (1.0, 0.0) else separation_velocity(d, m, n)
        return math.log(result / restitution)

    low = high = math.log(exact_damping(restitution))
    while excess(low) < 0.0:
        low -= 1.0
    while excess(high) > 0.0:
        high += 1.0
    return math.exp(brentq(excess, low, high, xtol=1e-14, rtol=1e-14))


def effective_restitution(law: str, restitution: ArrayLike) -> NDArray[np.float64] | float:
    """Return the actual restitution of an isolated contact with m = n under `law`, for each nominal `restitution`.

    Raises:
        ValueError: `law` is neither "exact" nor published, or a restitution is outside (0, 1].
    """
    choice("law", law, ("exact", *PUBLISHED))
    nominal = np.asarray(restitution, np.float64)
    if not np.all((nominal > 0.0) & (nominal <= 1.0)):
        raise ValueError(f"restitution must be above 0 and at most 1 (no unit), got {restitution!r}")
    result = np.vectorize(lambda e: delivered(damping_factor(law, float(e))), otypes=[np.float64])(nominal)
    return result if result.ndim else float(result)
