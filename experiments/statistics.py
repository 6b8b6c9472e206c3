"""Means and differences over scenarios, with intervals from a paired bootstrap."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap

RESAMPLES = 9_999
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Estimate:
    """A number with its interval."""

    value: float
    low: float
    high: float


def _interval(data: tuple[NDArray[np.float64], ...], statistic: Any, seed: int) -> Estimate:
    if all(np.ptp(sample) == 0.0 for sample in data):  # nothing varies: nothing to resample
        value = float(statistic(*data, axis=-1))
        return Estimate(value, value, value)
    result = bootstrap(
        data,
        statistic,
        paired=True,
        vectorized=True,
        n_resamples=RESAMPLES,
        batch=500,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(seed),
    )
    low, high = result.confidence_interval
    return Estimate(float(statistic(*data, axis=-1)), float(low), float(high))


def mean(sample: NDArray[np.float64], seed: int = 0) -> Estimate:
    """Mean over scenarios."""
    return _interval((sample,), lambda x, axis: np.mean(x, axis=axis), seed)


def relative_reduction(sample: NDArray[np.float64], baseline: NDArray[np.float64], seed: int = 0) -> Estimate:
    """1 - mean(sample) / mean(baseline); entry k of both is scenario k, and scenarios are resampled as pairs."""
    return _interval((sample, baseline), lambda x, y, axis: 1 - np.mean(x, axis=axis) / np.mean(y, axis=axis), seed)


def mean_reduction(sample: NDArray[np.float64], baseline: NDArray[np.float64], seed: int = 0) -> Estimate:
    """mean(baseline - sample), resampled as pairs."""
    return _interval((sample, baseline), lambda x, y, axis: np.mean(y - x, axis=axis), seed)
