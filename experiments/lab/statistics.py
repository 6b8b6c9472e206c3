"""Bootstrap intervals over training seeds and scenarios; fronts of approach time and V_p."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import nctdtrit, ndtri

Floats = NDArray[np.float64]
Front = tuple[Floats, Floats]
"""Means of approach time (s) and of V_p (m/s), each (1 + n, weights). Row 0: sample; other rows: n resamples."""
RESAMPLES = 2_000
CONFIDENCE = 0.95  # confidence level of intervals and of tolerance bounds
CONTENT = 0.95  # share of all trainings that a tolerance bound covers


@dataclass(frozen=True)
class Estimate:
    """A number with its confidence interval."""

    value: float
    low: float
    high: float

    def __neg__(self) -> "Estimate":
        return Estimate(-self.value, -self.high, -self.low)

    def __format__(self, spec: str) -> str:
        return f"{self.value:{spec}} [{self.low:{spec}}, {self.high:{spec}}]"


class Resamples:
    """Weights of scenarios and seeds for means over a sample, and over bootstrap resamples of the sample."""

    def __init__(self, scenarios: int, resamples: int = RESAMPLES) -> None:
        self.scenarios, self.count = scenarios, resamples
        self._scenario_shares = _shares((0, 0), scenarios, resamples)

    def means(self, values: NDArray[Any]) -> Floats:
        """Return means (1 + count, ...) of `values`, shape (seeds, ..., scenarios) or (scenarios,); row 0: the sample.

        Seeds are resampled independently of scenarios. Calls with the same number of seeds use the same resamples.
        """
        values = np.atleast_2d(values).astype(np.float64)
        seeds = len(values)
        shares = _shares((0, seeds), seeds, self.count)
        flat = values.reshape(-1, self.scenarios) @ self._scenario_shares.T  # shape (seeds * ..., 1 + count)
        by_seed = flat.reshape(seeds, -1, self.count + 1)
        means = np.einsum("rs,skr->rk", shares, by_seed)
        return means.reshape(self.count + 1, *values.shape[1:-1])

    def means_where(self, values: NDArray[Any], chosen: NDArray[np.bool_]) -> Floats:
        """Return the means of the `chosen` values, as `means`; nan: none is chosen."""
        with np.errstate(invalid="ignore"):
            return self.means(values * chosen) / self.means(chosen)


@lru_cache(maxsize=32)
def _shares(seed: tuple[int, int], units: int, resamples: int) -> Floats:
    # a resample has units - 1 draws; with units draws, a mean's variance would be too small by the factor 1 - 1 / units
    # (J. N. K. Rao, C. F. J. Wu, J. Am. Stat. Assoc. 83 (1988) 231-241)
    drawn = max(units - 1, 1)
    even = np.full(units, 1.0 / units)
    rng = np.random.default_rng(seed)
    return np.vstack([even, rng.multinomial(drawn, even, resamples) / drawn])


def estimate(resampled: Floats) -> Estimate:
    """Return `resampled[0]`, the sample's value, with the percentile interval of the finite resamples (nan if none)."""
    finite = resampled[1:][np.isfinite(resampled[1:])]
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile(finite, [tail, 100.0 - tail]) if finite.size else (np.nan, np.nan)
    return Estimate(float(resampled[0]), float(low), float(high))


def tolerated(scores: Floats) -> float:
    """Return the one-sided tolerance bound of normally distributed `scores` (n,); nan for fewer than two.

    At least the share CONTENT of all trainings has a score above the bound, with the probability CONFIDENCE (G. J.
    Hahn, W. Q. Meeker, Statistical Intervals, section 4.4).
    """
    n = len(scores)
    if n < 2:
        return np.nan
    k = nctdtrit(n - 1, ndtri(CONTENT) * np.sqrt(n), CONFIDENCE) / np.sqrt(n)
    return float(np.mean(scores) - k * np.std(scores, ddof=1))


def along(curve_x: Floats, curve_y: Floats, at: Floats) -> Floats:
    """Return y of n curves (n, k) at x = `at` (n,): linear between points of a curve, constant beyond the ends."""
    order = np.argsort(curve_x, axis=1)
    x, y = np.take_along_axis(curve_x, order, 1), np.take_along_axis(curve_y, order, 1)
    return np.array([np.interp(point, *line) for point, *line in zip(at, x, y, strict=True)])


def velocity_at_time_of(single: Front, front: Front) -> Floats:
    """Return V_p (m/s), (1 + n,), of `front` at the approach time of `single`, a front of one point."""
    return along(*front, single[0][:, 0])


def reduction(ours: Floats, theirs: Floats) -> Estimate:
    """Return (`theirs` - `ours`) / `theirs` of two means (1 + n,), whose n resamples are the same."""
    return estimate(1.0 - ours / theirs)
