"""Intervals over training seeds and scenarios by bootstrap, and comparisons of two contestants.

All contestants play the same scenarios, so all have the same resamples (common random numbers). The seeds of a training
are its replicates. For the probability of improvement see R. Agarwal et al., Deep Reinforcement Learning at the Edge of
the Statistical Precipice, NeurIPS 2021.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import nctdtrit, ndtri

Floats = NDArray[np.float64]
Front = tuple[Floats, Floats]
"""Mean approach time (s) and V_p (m/s) at each weight, in the sample and in each resample: (1 + n, weights) each."""
RESAMPLES = 2_000
CONFIDENCE = 0.95
CONTENT = 0.95  # share of all trainings that a tolerance bound covers


@dataclass(frozen=True)
class Estimate:
    """A number with its interval."""

    value: float
    low: float
    high: float

    def __neg__(self) -> "Estimate":
        return Estimate(-self.value, -self.high, -self.low)

    def __format__(self, spec: str) -> str:
        return f"{self.value:{spec}} [{self.low:{spec}}, {self.high:{spec}}]"


class Resamples:
    """Bootstrap resamples of scenarios and seeds; resample 0 is the sample itself."""

    def __init__(self, scenarios: int, resamples: int = RESAMPLES, seed: int = 0) -> None:
        self._seed, self.scenarios, self.count = seed, scenarios, resamples
        self._scenario_shares = _shares((seed, 0), scenarios, resamples)

    def means(self, values: Floats) -> Floats:
        """Return the mean of `values` (seeds, ..., scenarios) over seeds and scenarios in each resample: (1 + n, ...).

        Values (scenarios,) count as those of one seed. Seeds are resampled independently of scenarios, and identically
        in all calls with the same number of seeds.
        """
        values = np.atleast_2d(values).astype(np.float64)
        seeds = len(values)
        shares = _shares((self._seed, seeds), seeds, self.count)
        flat = values.reshape(-1, self.scenarios) @ self._scenario_shares.T  # (seeds * ..., 1 + n)
        by_seed = flat.reshape(seeds, -1, self.count + 1)
        means = np.einsum("rs,skr->rk", shares, by_seed)
        return means.reshape(self.count + 1, *values.shape[1:-1])


@lru_cache(maxsize=32)
def _shares(seed: tuple[int, int], units: int, resamples: int) -> Floats:
    """Return the share of each unit in the sample and in each resample (1 + n, units).

    A resample draws units - 1 units, which makes the variance of a mean unbiased. With ten seeds, drawing ten makes the
    variance a tenth too small (J. N. K. Rao, C. F. J. Wu, J. Am. Stat. Assoc. 83 (1988) 231-241).
    """
    drawn = max(units - 1, 1)
    even = np.full(units, 1.0 / units)
    rng = np.random.default_rng(seed)
    return np.vstack([even, rng.multinomial(drawn, even, resamples) / drawn])


def estimate(resampled: Floats) -> Estimate:
    """Return the value of resample 0 with the percentile interval of the others; non-finite values are left out."""
    finite = resampled[1:][np.isfinite(resampled[1:])]
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile(finite, [tail, 100.0 - tail]) if finite.size else (np.nan, np.nan)
    return Estimate(float(resampled[0]), float(low), float(high))


def tolerated(scores: Floats) -> float:
    """Return the score that CONTENT of all trainings reach, with CONFIDENCE, from `scores` (n,); higher is better.

    It is the one-sided tolerance bound of normal scores, mean - k s, with k from the noncentral t distribution (G. J.
    Hahn, W. Q. Meeker, Statistical Intervals, section 4.4): an interval of the mean does not bound a single training.
    One score gives nan.
    """
    n = len(scores)
    if n < 2:
        return np.nan
    k = nctdtrit(n - 1, ndtri(CONTENT) * np.sqrt(n), CONFIDENCE) / np.sqrt(n)
    return float(np.mean(scores) - k * np.std(scores, ddof=1))


def along(curve_x: Floats, curve_y: Floats, at: Floats) -> Floats:
    """Return y at x = `at` (n,) on each of n broken lines (n, k), constant beyond the ends.

    Playing one of two weights at random in each episode gives the straight line between them.
    """
    order = np.argsort(curve_x, axis=1)
    x, y = np.take_along_axis(curve_x, order, 1), np.take_along_axis(curve_y, order, 1)
    return np.array([np.interp(point, *line) for point, *line in zip(at, x, y, strict=True)])


def quantile_groups(values: Floats, count: int) -> list[tuple[NDArray[np.bool_], float, float]]:
    """Return the mask (n,), lower and upper edge of `count` equally large groups of `values` (n,), in order.

    If values repeat, edges can coincide; then there are fewer groups.
    """
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, count + 1)))
    last = max(len(edges) - 2, 0)
    group = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, last)
    return [(group == k, float(edges[k]), float(edges[min(k + 1, len(edges) - 1)])) for k in range(last + 1)]


@dataclass(frozen=True)
class Comparison:
    """Bootstrap values (1 + n,) of one measure for two contestants; lower is better; entry 0 is the full sample.

    Both contestants have the same resamples, so the variation that they share cancels.
    """

    ours: Floats
    theirs: Floats

    @classmethod
    def of_means(cls, ours: Floats, theirs: Floats) -> Self:
        """Compare the means of values (cases,) or (seeds, cases) on the same cases."""
        resamples = Resamples(ours.shape[-1])
        return cls(resamples.means(ours), resamples.means(theirs))

    @classmethod
    def of_fronts(cls, ours: Front, theirs: Front) -> Self:
        """Compare V_p (m/s) of our front with their front, a single point, at the mean approach time of that point."""
        (time,), (velocity,) = theirs[0].T, theirs[1].T
        return cls(along(*ours, time), velocity)

    @property
    def less(self) -> Estimate:
        """Their value minus ours, in their unit."""
        return estimate(self.theirs - self.ours)

    @property
    def ratio(self) -> Estimate:
        """Ours over theirs."""
        return estimate(self.ours / self.theirs)

    @property
    def reduction(self) -> Estimate:
        """Their value minus ours, as a share of theirs."""
        return estimate(1.0 - self.ours / self.theirs)
