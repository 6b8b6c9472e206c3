"""Find the best fit from several starting points, and the interval of each free number by its profile likelihood.

The misfit is the sum of ((predicted - measured) / noise)^2. `intervals` moves one number at a time away from its best
value and fits all others again. (MINOS of iminuit 2.33 missed 36 of 360 interval ends.)
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri, stdtrit

from impact_gym.identification.model import Model
from impact_gym.identification.search import ROUGH, Point, as_good, descend, distinct, race, scatter
from impact_gym.identification.sensor import Array, bursts, level

STARTS = 8  # largest number of points of `scatter` from which a search starts
NOISE_ROUNDS = 3  # largest number of rounds of `Fit.polished`; each round fits, and then estimates the noise
CONFIDENCE = 0.95
END_TOLERANCE = 0.02  # `profile` stops if sqrt(misfit - least misfit) / quantile differs from 1 by less than this
MAX_STEP = 1.5  # largest first step of `profile` in a coordinate (see `model`); wider intervals cause another search
MAX_STEPS = 10  # largest number of steps of `profile`
BEYOND = (1.6, 2.5)  # `_end` also tries values beyond an end: best value + these multiples of (end - best value)
MAX_DEVIATION = 1e3  # largest value of `Fit.deviations`
MIN_IMPROVEMENT = 0.05  # a point replaces the best fit if the misfit falls by more than this; the limit then doubles
# A fit lacks a blow of a log if the sum of the residuals (measured - fitted) in the blow exceeds two limits: the
# first number times the sum's standard deviation, and the second number times the sum of the measured force in the blow
MIN_LEFTOVER = 6.0, 0.5

Ends = tuple[float | None, ...]


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit: the best x (see `model`), its misfit and covariance (size, size), and the other local minima found."""

    model: Model
    x: Array
    misfit: float
    covariance: Array
    valley: Array  # covariance if each free coordinate has a normal prior about x with the standard deviation MAX_STEP
    others: Sequence[Point]
    improvement: float = MIN_IMPROVEMENT

    def again(self) -> "Fit":
        """Search from STARTS more points; return the best fit, or this fit if no new minimum is good (`as_good`)."""
        model, known = self.model, [Point(self.misfit, self.x), *self.others]
        good = as_good(model, distinct(model, known + _minima(model, STARTS)))
        is_new = {id(point) for point in good} - {id(point) for point in known}
        return self.polished(model, good) if is_new else self

    @classmethod
    def polished(cls, model: Model, points: Sequence[Point]) -> "Fit":
        """Refine the fits at `points`, estimate unknown noise from the residuals, and return the best fit."""
        for _ in range(NOISE_ROUNDS):
            points = distinct(model, [descend(model, point.x) for point in points])
            changed = _estimate_noise(model, points[0].x)
            if not changed or len(model.noise) == 1:  # the noise of a single column does not change the best x
                break
        best, *others = (Point(float(np.sum(model.residuals(point.x) ** 2)), point.x) for point in points)
        jacobian, loosely = model.jacobian(best.x), np.eye(len(model.free), model.size) / MAX_STEP
        valley = _covariance(np.concatenate([jacobian, loosely]))
        return cls(model, best.x, best.misfit, _covariance(jacobian), valley, others)

    @property
    def quantile(self) -> float:
        """Half width of a 95 % interval in standard deviations: Student's t if any noise is estimated, else normal."""
        known = all(sensor.noise is not None for sensor in self.model.sensors.values())
        degrees, upper = self.model.samples - self.model.size, 0.5 + CONFIDENCE / 2.0
        return float(ndtri(upper) if known else stdtrit(degrees, upper))

    @property
    def deviations(self) -> Array:
        """Standard deviations of x from the curvature of the misfit at the best fit, at most MAX_DEVIATION."""
        return np.minimum(np.sqrt(np.diag(self.covariance)), MAX_DEVIATION)


def fit_with_intervals(model: Model) -> tuple[Fit, list[Ends]]:
    """Return the best fit and its intervals; search again if the fit lacks a blow or an interval exceeds MAX_STEP."""
    fit = Fit.polished(model, as_good(model, _minima(model, 0)))
    if searched_again := bool(_extra_blows(fit) or _is_vague(fit)):
        fit = fit.again()
    if refusal := _extra_blows(fit):
        raise ValueError(refusal)
    fit, ends = intervals(fit)
    unsure = any(low is None or high is None or high - low > MAX_STEP for low, high in ends)
    if unsure and not searched_again and (other := fit.again()) is not fit:
        fit, ends = intervals(other)
    return fit, ends


def _minima(model: Model, after: int) -> list[Point]:
    """Skip the `after` best starting points; return the fits of `race` from the next STARTS points."""
    which = slice(after, after + STARTS)
    starts, first = scatter(model)[which], model.of_first_blow()
    if not after:
        if not starts:
            raise ValueError("scene: no starting point of the search can be simulated; are motion and distance right?")
        slopes = np.sum([np.abs(model.jacobian(x)).max(axis=0) for x in starts], axis=0)
        for number in (number for number, slope in zip(model.free, slopes, strict=False) if slope == 0.0):
            raise ValueError(f"free: the log does not depend on {number.name}; leave it out or record another column")
    if first.samples < model.samples:  # several blows cause many minima: start also from fits to the first blow
        starts += [point.x for point in race(first, scatter(first)[which])]
    return race(model, starts)


def _extra_blows(fit: Fit) -> str:
    """Return an error message if the force in a log has several blows and the fit lacks some; else an empty text."""
    model = fit.model
    for k, log in enumerate(model.logs):
        if "force" not in log.columns:
            continue
        force, sensor = log.columns["force"], model.sensors["force"]
        left = -model.residuals(fit.x)[model.slots[k, "force"]]  # measured - fitted, in standard deviations of noise
        signal = (force - level(force, sensor)) / model.noise["force"]
        deviations, fraction = MIN_LEFTOVER
        blows, extra = bursts(force, sensor), 0
        for first, last in blows:
            more, blow = left[first : last + 1], signal[first : last + 1]
            extra += int(more.sum() > max(deviations * len(more) ** 0.5, fraction * blow.sum()))
        if extra and len(blows) > 1:
            times = ", ".join(f"{round(float(log.time[first]), 9)}" for first, _ in blows)
            return (f"{log.name} has {len(blows)} blows, at {times} s, but the fit has no more than "
                    f"{len(blows) - extra} of them: cut the log to one blow, or make a log of each blow")  # fmt: skip
    return ""


def _estimate_noise(model: Model, x: Array) -> bool:
    """Estimate the unknown noise of each column from its residuals at x; return whether any changed by over 0.1 %."""
    left = model.residuals(x) * model.scales()
    spare = 1.0 - model.size / model.samples
    changed = False
    for name, sensor in model.sensors.items():
        if sensor.noise is None:
            parts = [left[slot] for (_, column), slot in model.slots.items() if column == name]
            noise = max(math.sqrt(float(np.mean(np.concatenate(parts) ** 2)) / spare), 1e-9 * model.noise[name])
            changed |= abs(noise / model.noise[name] - 1.0) > 1e-3
            model.noise[name] = noise
    return changed


def _covariance(jacobian: Array) -> Array:
    """Return the inverse of J^T J for a jacobian J; very large where J^T J is singular."""
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0.0] = 1.0
    _, values, rows = np.linalg.svd(jacobian / size, full_matrices=False)
    spread = rows.T / np.maximum(values, 1e-10 * values[0])
    return spread @ spread.T / np.outer(size, size)


class _BetterError(Exception):
    """Raised with a point x that fits better than the best fit so far."""


def intervals(fit: Fit) -> tuple[Fit, list[Ends]]:
    """Return the fit and the two ends of each free number's interval; an end is None if that side is unlimited.

    An interval includes all found minima whose misfit exceeds the least misfit by less than quantile^2. If a clearly
    better point is found, a fit from this point replaces the best fit, and all intervals are computed again.
    """
    while True:  # this loop ends, because the required decrease of the misfit doubles with each better point
        try:
            return fit, [tuple(_end(fit, i, side) for side in (-1, 1)) for i in range(len(fit.model.free))]
        except _BetterError as better:
            points = [Point(fit.misfit, better.args[0]), Point(fit.misfit, fit.x), *fit.others]
            fit = replace(Fit.polished(fit.model, points), improvement=2.0 * fit.improvement)


def _end(fit: Fit, i: int, side: int) -> float | None:
    """Return the lower (`side` -1) or upper (`side` 1) end of x[i]'s interval, see `intervals`; None: no limit."""
    limit = fit.quantile**2
    end = profile(fit, i, side, Point(fit.misfit, fit.x))
    for point in fit.others:
        if end is not None and point.misfit - fit.misfit < limit and side * (point.x[i] - end) > 0.0:
            end = profile(fit, i, side, point)
    for factor in BEYOND:
        if end is None:
            break
        last = fit.model.free[i].reach[side > 0]
        u = float(fit.x[i]) + factor * (end - float(fit.x[i]))
        point = _refit(fit, i, u, Point(fit.misfit, fit.x)) if side * (last - u) > 0.0 else Point(math.inf, fit.x)
        if point.misfit - fit.misfit < limit:
            end = profile(fit, i, side, point)
    return end


def _is_vague(fit: Fit) -> bool:
    """Estimate interval widths from curvature and the spread of good minima; return whether any exceeds MAX_STEP."""
    good = [fit.x, *(point.x for point in fit.others if point.misfit - fit.misfit < fit.quantile**2)]
    widths = 2.0 * fit.quantile * fit.deviations + np.ptp(good, axis=0)
    return bool(widths[: len(fit.model.free)].max() > MAX_STEP)


def _refit(fit: Fit, i: int, u: float, near: Point) -> Point:
    """Fit with x[i] = `u`, starting near `near`; raise _BetterError if the misfit is clearly below that of `fit`."""
    points = []
    # first start: `near`, moved along column i of `valley` to x[i] = u; second start, if needed: only x[i] changed
    for along in (fit.valley[:, i] / fit.valley[i, i], np.zeros_like(near.x)):
        start = near.x + along * (u - near.x[i])
        start[i] = u
        points.append(descend(fit.model, start, i, ROUGH))
        if points[-1].misfit < fit.misfit - fit.improvement:
            raise _BetterError(points[-1].x)
        if points[-1].misfit - fit.misfit < ((1.0 + END_TOLERANCE) * fit.quantile) ** 2:
            break
    return min(points, key=lambda point: point.misfit)


def profile(fit: Fit, i: int, side: int, begin: Point) -> float | None:
    """Move x[i] from `begin` down (`side` -1) or up (`side` 1) until misfit - least misfit is about quantile^2.

    Return this x[i], or after MAX_STEPS the nearest x[i] tried beyond it, or None if no x[i] tried was beyond it.
    """
    first, last = float(begin.x[i]), fit.model.free[i].reach[side > 0]
    inner, outer = (first, math.sqrt(max(begin.misfit - fit.misfit, 0.0) / fit.quantile**2), begin), None
    u = first + side * min((1.0 - inner[1]) * fit.quantile * fit.deviations[i], MAX_STEP)
    for _ in range(MAX_STEPS):
        u = max(u, last) if side < 0 else min(u, last)
        point = _refit(fit, i, u, inner[2])
        t = math.sqrt(max(point.misfit - fit.misfit, 0.0)) / fit.quantile
        if abs(t - 1.0) < END_TOLERANCE:
            return u
        if t > 1.0:
            outer = u, t
        elif u == last:
            return None
        else:
            inner = u, t, point
        if outer is None:
            u = first + (u - first) * min(max(1.0 / max(t, 0.1), 1.2), 4.0)
        else:
            u = inner[0] + (outer[0] - inner[0]) * min(max((1.0 - inner[1]) / (outer[1] - inner[1]), 0.1), 0.9)
    return outer[0] if outer else None
