"""The best fit from several starts, and how far each number may move before the log objects.

`Fit.of` is the best of the local minima; `intervals` moves one number at a time and fits all others again.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtrit

from impact_gym.identify.model import Model
from impact_gym.identify.search import ROUGH, Point, as_good, descend, distinct, race, scatter
from impact_gym.identify.sensor import Array, bursts, level

STARTS = 8  # of the scattered points that are fitted, the best first; `Fit.again` takes as many more
NOISE_ROUNDS = 3  # of estimating noise and fitting anew
CONFIDENCE = 0.95
END_TOLERANCE = 0.02  # of the half width, to which an end of an interval is found
MAX_STEP = 1.5  # of a coordinate, a first step towards an end; an interval as long may hide another minimum
MAX_STEPS = 10  # fits on the way to an end
BEYOND = (1.6, 2.5)  # times the way to an end, where the misfit is looked at once more
MAX_DEVIATION = 1e3  # of a coordinate, a standard deviation that says there is none
MIN_IMPROVEMENT = 0.05  # of the misfit, by which a better fit is better; an end is where it has grown by 3.8
MAX_IMPROVEMENTS = 20  # better fits met on the way to the ends
MIN_LEFTOVER = 6.0, 0.5  # of a blow not in the scene: standard deviations that the fit leaves of it, and share of it

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
        starts = scatter(model)[first]
        _refuse_idle(model, starts)
        return cls._polished(model, as_good(model, race(model, starts + _past_first_blow(model, first))))

    def again(self) -> "Fit":
        """Return the best fit from as many starts more and the known minima; itself if there is no other minimum."""
        model, more = self.model, slice(STARTS, 2 * STARTS)
        known = [Point(self.misfit, self.x), *self.others]
        minima = race(model, scatter(model)[more] + _past_first_blow(model, more))
        good = as_good(model, distinct(model, known + minima))
        is_new = {id(point) for point in good} - {id(point) for point in known}
        return self._polished(model, good) if is_new else self

    @classmethod
    def _polished(cls, model: Model, points: Sequence[Point]) -> "Fit":
        for _ in range(NOISE_ROUNDS):
            points = distinct(model, [descend(model, point.x) for point in points])
            if not _estimate_noise(model, points[0].x) or len(model.noise) == 1:  # which alone changes no minimum
                break
        best, *others = (Point(float(np.sum(model.residuals(point.x) ** 2)), point.x) for point in points)
        return cls(model, best.x, best.misfit, _covariance(model.jacobian(best.x)), others)

    def moved(self, x: Array) -> "Fit":
        """Return the fit that a better point leads to, with the noise of its own residual."""
        return self._polished(self.model, [Point(self.misfit, x), Point(self.misfit, self.x), *self.others])

    @property
    def quantile(self) -> float:
        """How many standard deviations to either side hold CONFIDENCE; Student's where noise is estimated."""
        upper = 0.5 + CONFIDENCE / 2.0
        if all(sensor.noise is not None for sensor in self.model.sensors.values()):
            return float(ndtri(upper))
        return float(stdtrit(self.model.samples - self.model.size, upper))

    def excess(self, point: Point) -> float:
        """Return how far the misfit of a point is above the least one: the quantile squared where an interval ends."""
        return max(point.misfit - self.misfit, 0.0)

    def deviation(self, i: int) -> float:
        """Return the standard deviation of x[i] by the curvature at the best fit."""
        return min(math.sqrt(self.covariance[i, i]), MAX_DEVIATION)

    def direction(self, i: int) -> Array:
        """Return how x moves with x[i] along the valley of the misfit, by the curvature at the best fit."""
        return self.covariance[:, i] / self.covariance[i, i]


def fit_with_intervals(model: Model) -> tuple[Fit, list[Ends]]:
    """Return the best fit and the intervals of its free numbers, searched again where they leave much open.

    Raises:
        ValueError: no start leads to a blow, a free number changes nothing, or a log has more blows than the scene.
    """
    fit = Fit.of(model)
    if searched_again := bool(_extra_blows(fit) or _is_vague(fit)):
        fit = fit.again()
    if refusal := _extra_blows(fit):
        raise ValueError(refusal)
    fit, ends = intervals(fit)
    unsure = any(low is None or high is None or high - low > MAX_STEP for low, high in ends)
    if unsure and not searched_again and (other := fit.again()) is not fit:
        fit, ends = intervals(other)
    return fit, ends


def _refuse_idle(model: Model, points: Sequence[Array]) -> None:
    """Refuse a free number that changes nothing."""
    if not points:
        raise ValueError(
            "scene: neither it nor its neighbours can be simulated to a blow; are motion and distance right?"
        )
    slopes = sum(np.abs(model.jacobian(x)).max(axis=0) for x in points)
    for number, slope in zip(model.free, slopes, strict=False):
        if slope == 0.0:
            raise ValueError(
                f"free: the log does not depend on {number.name}, whatever its value; leave it out, or record what does"
            )


def _extra_blows(fit: Fit) -> str:
    """Return a sentence about a log with more blows than the fitted motion has, an empty one if there is none."""
    model = fit.model
    for k, log in enumerate(model.logs):
        if "force" not in log.columns:
            continue
        force, sensor = log.columns["force"], model.sensors["force"]
        left = -model.residuals(fit.x)[model.slots[k, "force"]]  # standard deviations
        signal = (force - level(force, sensor)) / model.noise["force"]
        deviations, share = MIN_LEFTOVER
        blows = bursts(force, sensor)
        extra = [
            left[first : last + 1].sum()
            > max(deviations * (last - first + 1) ** 0.5, share * signal[first : last + 1].sum())
            for first, last in blows
        ]
        if any(extra) and len(blows) > 1:
            times = ", ".join(f"{log.time[first]:g}" for first, _ in blows)
            return (f"{log.name} has {len(blows)} blows, at {times} s, the scene makes no more than "
                    f"{len(blows) - sum(extra)} of them: cut it to one, or give each as a log of its own")  # fmt: skip
    return ""


def _past_first_blow(model: Model, starts: slice) -> list[Array]:
    """Return the minima of the first blow alone: those of what follows are many, and most have no way out."""
    first = model.of_first_blow()
    return [point.x for point in race(first, scatter(first)[starts])] if first.samples < model.samples else []


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


class _BetterError(Exception):
    """A point fits better than the best fit."""

    def __init__(self, x: Array) -> None:
        self.x = x


def intervals(fit: Fit) -> tuple[Fit, list[Ends]]:
    """Return both ends of each free number's interval, None where there is none, and the fit they belong to.

    Other minima that the quantile does not exclude widen an interval. Where a better fit is met, that is the fit.
    """
    for _ in range(MAX_IMPROVEMENTS):
        try:
            return fit, [tuple(_end(fit, i, side) for side in (-1, 1)) for i in range(len(fit.model.free))]
        except _BetterError as better:
            fit = fit.moved(better.x)
    raise RuntimeError(f"identify: {MAX_IMPROVEMENTS} times a better fit was met next to the best one")


def _end(fit: Fit, i: int, side: int) -> float | None:
    """Return the outermost end on one side (-1, 1) of x[i], from the best fit and all that are as good."""
    limit = fit.quantile**2
    end = profile(fit, i, side, Point(fit.misfit, fit.x))
    for point in fit.others:
        if end is not None and point.misfit - fit.misfit < limit and side * (point.x[i] - end) > 0.0:
            end = profile(fit, i, side, point)
    for factor in BEYOND:  # behind a ridge the misfit may fall again
        if end is None:
            break
        last = fit.model.free[i].reach[side > 0]
        u = float(fit.x[i]) + factor * (end - float(fit.x[i]))
        point = _refit(fit, i, u, Point(fit.misfit, fit.x)) if side * (last - u) > 0.0 else Point(math.inf, fit.x)
        if point.misfit - fit.misfit < limit:
            end = profile(fit, i, side, point)
    return end


def _is_vague(fit: Fit) -> bool:
    """Whether an interval will be longer than MAX_STEP, by the curvature or by another minimum that is as good."""
    good = [fit.x, *(point.x for point in fit.others if point.misfit - fit.misfit < fit.quantile**2)]
    spread = np.ptp(good, axis=0)
    widths = [2.0 * fit.quantile * fit.deviation(i) + float(spread[i]) for i in range(len(fit.model.free))]
    return max(widths) > MAX_STEP


def _refit(fit: Fit, i: int, u: float, near: Point) -> Point:
    """Return the fit with x[i] held at `u`, begun from a point near, from where it follows the valley.

    Raises:
        _BetterError: it is better than the best.
    """
    start = near.x + fit.direction(i) * (u - near.x[i])
    start[i] = u
    point = descend(fit.model, start, i, ROUGH)
    if point.misfit < fit.misfit - MIN_IMPROVEMENT:
        raise _BetterError(point.x)
    return point


def profile(fit: Fit, i: int, side: int, begin: Point) -> float | None:
    """Return where on one `side` (-1, 1) of x[i] the misfit, all else fitted anew, passes the quantile, or None.

    The first step goes from a minimum where the curvature at the best fit says; if the misfit agrees to END_TOLERANCE,
    that is the end.

    Raises:
        _BetterError: a point on the way fits better than the best.
    """
    first, last = float(begin.x[i]), fit.model.free[i].reach[side > 0]
    inner, outer = (first, math.sqrt(fit.excess(begin) / fit.quantile**2), begin), None
    u = first + side * min((1.0 - inner[1]) * fit.quantile * fit.deviation(i), MAX_STEP)
    for _ in range(MAX_STEPS):
        u = max(u, last) if side < 0 else min(u, last)
        point = _refit(fit, i, u, inner[2])
        t = math.sqrt(fit.excess(point)) / fit.quantile
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
            share = (1.0 - inner[1]) / (outer[1] - inner[1])
            u = inner[0] + (outer[0] - inner[0]) * min(max(share, 0.1), 0.9)
    return u
