"""Least squares from several starts, and how far each number may move before the log objects.

`Fit.of` is the best of the local minima; `intervals` moves one number at a time and fits all others again.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from impact_gym.identify.descent import ROUGH, Point, as_good, descended, distinct, raced
from impact_gym.identify.model import Model
from impact_gym.identify.starts import scattered

Array = NDArray[np.float64]

STARTS = 8  # of the scattered points that are fitted, the best first; `Fit.again` takes as many more
ROUNDS = 3  # of estimating noise and fitting anew
CONFIDENCE = 0.95
NEAR = 0.02  # of the half width, to which an end of an interval is found
LONGEST = 1.5  # of a coordinate, a first step towards an end
BEYOND = (1.6, 2.5)  # times the way to an end, where the misfit is looked at once more
TRIES = 10  # fits for an end
WIDEST = 1e3  # of a coordinate, a standard deviation that says there is none
SLACK = 0.05  # of the misfit, by which a better fit is better; an end is where it has grown by 3.8
BETTER = 20  # times that a better fit may be met

Ends = tuple[float | None, ...]


@dataclass(frozen=True, eq=False)
class Fit:
    """The best x, the misfit there, its covariance (size, size), and the minima that were found besides."""

    model: Model
    x: Array
    misfit: float  # sum of squared residuals over the noise
    covariance: Array
    others: Sequence[Point]

    @classmethod
    def of(cls, model: Model) -> "Fit":
        """Return the best fit from several starts, the noise that is not known estimated on the way.

        Raises:
            ValueError: no start leads to a blow, or a free number changes nothing.
        """
        first = slice(STARTS)
        begun = scattered(model)[first]
        _refuse_idle(model, begun)
        return cls._settled(model, as_good(model, raced(model, begun + _past_first_blow(model, first))))

    def again(self) -> "Fit":
        """Return the best fit from as many starts more and the minima that are known; itself if that finds no other."""
        model, more = self.model, slice(STARTS, 2 * STARTS)
        known = [Point(self.misfit, self.x), *self.others]
        found = raced(model, scattered(model)[more] + _past_first_blow(model, more))
        good = as_good(model, distinct(model, known + found))
        is_new = {id(one) for one in good} - {id(one) for one in known}
        return self._settled(model, good) if is_new else self

    @classmethod
    def _settled(cls, model: Model, found: Sequence[Point]) -> "Fit":
        for _ in range(ROUNDS):
            found = distinct(model, [descended(model, one.x) for one in found])
            if not _estimate_noise(model, found[0].x) or len(model.noise) == 1:  # which alone changes no minimum
                break
        best, *others = (Point(float(np.sum(model.residuals(one.x) ** 2)), one.x) for one in found)
        return cls(model, best.x, best.misfit, _covariance(model.jacobian(best.x)), others)

    def moved(self, x: Array) -> "Fit":
        """Return the fit that a better point leads to."""
        misfit, x, _ = descended(self.model, x)
        return Fit(self.model, x, misfit, _covariance(self.model.jacobian(x)), self.others)

    @property
    def quantile(self) -> float:
        """How many standard deviations to either side hold CONFIDENCE; Student's where noise is estimated."""
        upper = 0.5 + CONFIDENCE / 2.0
        if all(sensor.noise is not None for sensor in self.model.sensors.values()):
            return float(ndtri(upper))
        return float(stdtrit(self.model.samples - self.model.size, upper))

    def deviation(self, i: int) -> float:
        """Return the standard deviation of x[i] by the curvature at the best fit."""
        return min(math.sqrt(self.covariance[i, i]), WIDEST)


def _refuse_idle(model: Model, points: Sequence[Array]) -> None:
    """Refuse a free number that changes nothing.

    Raises:
        ValueError: names it.
    """
    if not points:
        raise ValueError(
            "scene: neither it nor its neighbours can be simulated to a blow; are motion and distance right?"
        )
    moved = sum(np.abs(model.jacobian(x)).max(axis=0) for x in points)
    for one, most in zip(model.free, moved, strict=False):
        if most == 0.0:
            raise ValueError(
                f"free: the log does not depend on {one.name}, whatever its value; leave it out, or record what does"
            )


def _past_first_blow(model: Model, some: slice) -> list[Array]:
    """Return the minima of the first blow alone: those of what follows are many, and most have no way out."""
    first = model.of_first_blow()
    return [one.x for one in raced(first, scattered(first)[some])] if first.samples < model.samples else []


def _estimate_noise(model: Model, x: Array) -> bool:
    """Set the noise that is not known to what is left of each column at x; return whether that changed anything."""
    left = model.residuals(x) * model.scales()
    share = 1.0 - model.size / model.samples
    changed = False
    for name, sensor in model.sensors.items():
        if sensor.noise is None:
            parts = [left[slot] for (_, column), slot in model.slots.items() if column == name]
            noise = max(math.sqrt(float(np.mean(np.concatenate(parts) ** 2)) / share), 1e-9 * model.noise[name])
            changed |= abs(noise / model.noise[name] - 1.0) > 1e-3
            model.noise[name] = noise
    return changed


def _covariance(jacobian: Array) -> Array:
    """Return the inverse of J^T J; of what no sample depends on, as good as infinite."""
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0.0] = 1.0
    _, values, rows = np.linalg.svd(jacobian / size, full_matrices=False)
    spread = rows.T / np.maximum(values, 1e-10 * values[0])
    return spread @ spread.T / np.outer(size, size)


def intervals(fit: Fit) -> tuple[Fit, list[Ends]]:
    """Return both ends of each free number's interval, None where there is none, and the fit they belong to.

    Other minima that the quantile does not exclude widen an interval. Where a better fit is met, that is the fit.
    """
    for _ in range(BETTER):
        try:
            return fit, [tuple(_end(fit, i, side) for side in (-1, 1)) for i in range(len(fit.model.free))]
        except _BetterError as found:
            fit = fit.moved(found.x)
    raise RuntimeError(f"identify: {BETTER} times a better fit was met next to the best one")


class _BetterError(Exception):
    def __init__(self, x: Array) -> None:
        self.x = x


def _end(fit: Fit, i: int, side: int) -> float | None:
    """Return the outermost end on one side (-1, 1) of x[i], from the best fit and all that are as good."""
    limit = fit.quantile**2
    ends = [profile(fit, i, side, fit.x, 0.0)]
    for misfit, x, _ in fit.others:
        if ends[-1] is not None and misfit - fit.misfit < limit and side * (x[i] - ends[-1]) > 0.0:
            ends.append(profile(fit, i, side, x, math.sqrt(max(misfit - fit.misfit, 0.0) / limit)))
    for factor in BEYOND:  # behind a ridge the misfit may fall again
        if ends[-1] is None:
            break
        last = fit.model.free[i].reach[side > 0]
        u = float(fit.x[i]) + factor * (ends[-1] - float(fit.x[i]))
        x = fit.x + fit.covariance[:, i] / fit.covariance[i, i] * (u - fit.x[i])
        x[i] = u
        misfit, x, _ = descended(fit.model, x, i, ROUGH) if side * (last - u) > 0.0 else Point(math.inf, x)
        if misfit < fit.misfit - SLACK:
            raise _BetterError(x)
        if misfit - fit.misfit < limit:
            ends.append(profile(fit, i, side, x, math.sqrt(max(misfit - fit.misfit, 0.0) / limit)))
    return ends[-1]


def vague(fit: Fit) -> bool:
    """Whether `uncertain` can be foreseen, by the curvature or by another minimum that is as good."""
    good = [fit.x, *(one.x for one in fit.others if one.misfit - fit.misfit < fit.quantile**2)]
    widths = [
        2.0 * fit.quantile * fit.deviation(i) + float(np.ptp(good, axis=0)[i]) for i in range(len(fit.model.free))
    ]
    return max(widths) > LONGEST


def uncertain(fit: Fit, pairs: Sequence[Ends]) -> bool:
    """Whether an interval has no end, or is so long that the misfit may have more minima than were found."""
    return any(low is None or high is None or high - low > LONGEST for low, high in pairs)


def profile(fit: Fit, i: int, side: int, x: Array, t: float) -> float | None:
    """Return where on one `side` (-1, 1) of x[i] the misfit, all else fitted anew, passes the quantile, or None.

    The first step goes where the curvature at the best fit says; if the misfit agrees to NEAR, that is the end. x is a
    minimum, `t` its misfit in quantiles.

    Raises:
        _BetterError: a point on the way fits better than the best.
    """
    model, begin = fit.model, float(x[i])
    last = model.free[i].reach[side > 0]
    along = fit.covariance[:, i] / fit.covariance[i, i]
    inner, outer = (begin, t, x), None
    u = begin + side * min((1.0 - t) * fit.quantile * fit.deviation(i), LONGEST)
    for _ in range(TRIES):
        u = max(u, last) if side < 0 else min(u, last)
        start = inner[2] + along * (u - inner[0])
        start[i] = u
        misfit, found, _ = descended(model, start, i, ROUGH)
        if misfit < fit.misfit - SLACK:
            raise _BetterError(found)
        t = math.sqrt(max(misfit - fit.misfit, 0.0)) / fit.quantile
        if abs(t - 1.0) < NEAR:
            return u
        if t > 1.0:
            outer = u, t
        elif u == last:
            return None
        else:
            inner = u, t, found
        if outer is None:
            u = begin + (u - begin) * min(max(1.0 / max(t, 0.1), 1.2), 4.0)
        else:
            share = (1.0 - inner[1]) / (outer[1] - inner[1])
            u = inner[0] + (outer[0] - inner[0]) * min(max(share, 0.1), 0.9)
    return u
