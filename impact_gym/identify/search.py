"""Where a fit begins, and least squares from there: several starts race each other to the minima.

A start is a scene with the impulse and the width of the measured blow, or one scattered over what is searched, with the
start of the motion and the biases that suit the log best.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from impact_gym.identify.coordinates import MASS, RESTITUTION, STIFFNESS
from impact_gym.identify.log import Log, tool_mass
from impact_gym.identify.model import Model
from impact_gym.identify.sensor import Array, level
from impact_gym.outcome import Trace
from impact_gym.scene import Scene

SCATTERED = 40  # scenes beside the given one
SEED = 0
RESTITUTIONS = 0.1, 0.3, 0.5, 0.7, 0.9, 0.98  # of scenes with the impulse and the width of the measured blow
PASSES, NEAR = 8, 0.1  # simulations to find such a scene, at most, and how near (ln) is enough
HEAVY = 1e3  # times the mass of the tool, where the impulse says a wall
ROUNDS, ROUND_EVALUATIONS = 5, 8  # of a race: fits are compared after so many evaluations of the residuals
MIN_GAP_REDUCTION = 0.2  # drop a fit that keeps more than 80 % of its gap to the best one per round
GOOD_MISFIT = 20.0  # above the least misfit, relative to what noise leaves of a sample: a rough minimum worth polishing
MIN_DISTANCE = 0.03  # of the coordinate of a free number, by which two minima are apart
LARGEST_START = 4.0  # of ln(e/(1-e)), from where a fit may begin: e from 0.02 to 0.98
FINE, ROUGH = 1e-8, 1e-5  # tolerances of misfit and x, relative: of the best fit, and of those on the way


class Point(NamedTuple):
    """Where least squares have come to."""

    misfit: float  # sum of squared residuals over the noise
    x: Array
    is_minimum: bool = True  # False: evaluations ran out on the way to one


def scatter(model: Model) -> list[Array]:
    """Return starting points x, best first: the given scene, those `from_impulse`, a Latin hypercube of the rest."""
    rng = np.random.default_rng(SEED)
    low, high = np.array([[number.coordinate(size) for size in number.searched] for number in model.free]).T
    cells = np.array([rng.permutation(SCATTERED) for _ in model.free]).T
    points = low + (high - low) * (cells + rng.random(cells.shape)) / SCATTERED
    given = np.array([number.start(model.scene) for number in model.free])
    starts = [start_at(model, point, rng.random()) for point in [given, *from_impulse(model, given), *points]]
    starts.sort(key=lambda start: start.misfit)
    return [start.x for start in starts if np.isfinite(start.misfit)]


def from_impulse(model: Model, given: Array) -> list[Array]:
    """Return free coordinates with which the first log's force has its impulse and its width, for each of RESTITUTIONS.

    An impulse is (1 + e) v / (1/m + 1/m_tool), and a width, impulse over peak, goes with k^(-1/(n + 1)) for a force
    k delta^n (Johnson, Contact Mechanics, 1985, sec. 11.4): each pass corrects both by what a simulation has of them.
    """
    places = {number.name: i for i, number in enumerate(model.free)}
    k = next((k for k, log in enumerate(model.logs) if "force" in log.columns), None)
    if k is None or not {MASS, STIFFNESS} & set(places):
        return []
    log, sensor = model.logs[k], model.sensors["force"]
    force, few = log.columns["force"], max(len(log.time) // 20, 1)
    rests = np.median(force[:few]), np.median(force[-few:])  # of which one may lie in the blow
    force = force - (min(rests) if sensor.bias == "estimated" else sensor.bias)
    impulse, peak = float(np.trapezoid(force, log.time)), float(force.max())

    def put(name: str, u: float) -> None:
        if name in places:
            x[places[name]] = model.free[places[name]].clipped(u)

    points = []
    for restitution in RESTITUTIONS if RESTITUTION in places else RESTITUTIONS[:1]:
        x, light, heavy = given.copy(), -math.inf, math.inf  # coordinates of masses too light, too heavy
        put(RESTITUTION, math.log(restitution / (1.0 - restitution)))
        for _ in range(PASSES if impulse > 0.0 else 0):
            try:
                scene = model.scene_at(x)
                trace = model.trace(scene, k, model.latest(scene, k))
            except (ValueError, RuntimeError):
                break
            touch = int(np.argmax(trace.contact_force > 0.0))
            parted = touch + int(np.argmin(trace.contact_force[touch:]))
            n = max(np.searchsorted(trace.time, trace.time[touch] + log.time[-1] - log.time[0]), parted + 1)
            sensed = model.sensed(scene, trace, "force", trace.time[:n])[0]
            more = float(np.trapezoid(sensed, trace.time[:n])) / impulse
            if more <= 0.0:
                break
            longer, mass, u = more * peak / float(sensed.max()), tool_mass(scene), math.log(scene.object.mass)
            light, heavy = (u, heavy) if more < 1.0 else (light, u)
            inverse = (1.0 / scene.object.mass + 1.0 / mass) * more - 1.0 / mass
            u = -math.log(max(inverse, 1.0 / (HEAVY * scene.tool.mass)))
            put(MASS, u if light < u < heavy else (light + heavy) / 2.0)
            exponent = scene.contact.stiffness_exponent + 1.0
            put(STIFFNESS, math.log(scene.contact.stiffness) + exponent * math.log(longer))
            if max(abs(math.log(more)), abs(math.log(longer))) < NEAR:
                break
        points.append(x)
    return points


def start_at(model: Model, point: Array, share: float) -> Point:
    """Return free coordinates with the start times and biases at which the misfit is least.

    Times are tried on the log's own grid, moved by a `share` of a sample, and none at which the log begins later than
    its own length after the touch, or ends as much before it.
    """
    x = np.zeros(model.size)
    x[: len(point)] = point
    total = 0.0
    try:
        scene = model.scene_at(x)
        for k, log in enumerate(model.logs):
            trace = model.trace(scene, k, model.latest(scene, k))
            misfit, delay, biases = _align(model, scene, log, trace, share)
            x[len(point) + k] = log.time[0] + delay
            for name, bias in biases.items():
                if (k, name) in model.biased:
                    x[model.bias_place(k, name)] = bias
            total += misfit
    except (ValueError, RuntimeError):
        return Point(np.inf, x, is_minimum=False)
    return Point(total, x, is_minimum=False)


def _align(model: Model, scene: Scene, log: Log, trace: Trace, share: float) -> tuple[float, float, dict[str, float]]:
    """Return the least misfit of a motion with a log, the start of the motion after the log's (s), and the biases."""
    step, n = log.step, len(log.time)
    touch = trace.time[np.argmax(trace.contact_force > 0.0)] if np.any(trace.contact_force > 0.0) else np.inf
    last = min(trace.time[-1], touch + 2.0 * n * step)
    first = max(touch - 2.0 * n * step, 0.0) if np.isfinite(touch) else 0.0
    times: Array = first + (np.arange(int((last - first) / step), dtype=float) + share) * step
    m = len(times)  # shift k puts sample j of the motion on sample j + k of the log; the log ends within the motion
    misfit, biases = np.zeros(m + 1), {}
    length = 1 << int(n + m).bit_length()
    lags = np.arange(n - m, n + 1)
    begin, end = np.maximum(-lags, 0), np.minimum(n - lags, m)
    for name, values in log.columns.items():
        sensor = model.sensors[name]
        free = sensor.bias == "estimated"
        rest = level(values, sensor)
        y = values - rest
        sensed = model.sensed(scene, trace, name, times)[0]
        spectrum = np.fft.rfft(y, length) * np.conj(np.fft.rfft(sensed, length))
        products = np.fft.irfft(spectrum, length)
        sums, squares = (np.concatenate([[0.0], np.cumsum(part)]) for part in (sensed, sensed**2))
        inside, power = sums[end] - sums[begin], squares[end] - squares[begin]
        off = (np.sum(y) - inside) / n
        misfit += (np.sum(y**2) - 2.0 * products[lags % length] + power - free * n * off**2) / model.noise[name] ** 2
        biases[name] = off + rest
    best = int(np.argmin(misfit))
    delay = (n - m + best - share) * step - first
    return float(misfit[best]), delay, {name: float(bias[best]) for name, bias in biases.items()}


def descend(
    model: Model, x: Array, fixed: int | None = None, tolerance: float = FINE,
    evaluations: int = ROUNDS * ROUND_EVALUATIONS,
) -> Point:  # fmt: skip
    """Return where least squares come to from x, with x[fixed] held, within so many evaluations."""
    free = np.delete(np.arange(model.size), [] if fixed is None else [fixed])
    x = x.copy()
    if not np.all(np.isfinite(x)):
        return Point(math.inf, x, is_minimum=False)
    # Starts and biases count from where they begin: MINPACK's tolerance of x is relative to x, and a clock that is
    # seconds from the motion's would end the search before samples of microseconds are told apart.
    origin = np.where(np.arange(model.size) < len(model.free), 0.0, x)
    for i, number in enumerate(model.free):  # at the end of what a restitution may be nothing would move it
        if number.name == RESTITUTION and i != fixed:
            x[i] = min(max(x[i], -LARGEST_START), LARGEST_START)

    def whole(part: Array) -> Array:
        point = x.copy()
        point[free] = origin[free] + part
        return point

    solution = least_squares(
        lambda part: model.residuals(whole(part)), (x - origin)[free],
        jac=lambda part: model.jacobian(whole(part), skip=fixed)[:, free], method="lm", x_scale="jac",
        max_nfev=evaluations, ftol=tolerance, xtol=tolerance, gtol=tolerance,
    )  # fmt: skip
    end = whole(solution.x)
    for i, number in enumerate(model.free):
        end[i] = number.clipped(end[i])
    return Point(2.0 * float(solution.cost), end, solution.status > 0)


def race(model: Model, starts: Sequence[Array]) -> list[Point]:
    """Return the distinct minima that rough fits from `starts` come to, the best first.

    After each round the fits are compared. Of those that have met the best goes on; one that is clearly worse than the
    best of all, and has hardly come closer in this round, is dropped.
    """
    points = [Point(math.inf, x, is_minimum=False) for x in starts]
    for _ in range(ROUNDS):
        before = [point.misfit for point in points]
        points = [p if p.is_minimum else descend(model, p.x, None, ROUGH, ROUND_EVALUATIONS) for p in points]
        least, good = min((point.misfit for point in points), default=math.inf), _good_misfit(model, points)
        gaps = [(1.0 - MIN_GAP_REDUCTION) * (misfit - least) for misfit in before]
        points = distinct(model, [
            point for point, gap in zip(points, gaps, strict=True)
            if point.is_minimum or point.misfit < good or point.misfit - least < gap
        ])  # fmt: skip
    return points


def as_good(model: Model, points: Sequence[Point]) -> list[Point]:
    """Return those points that may lead to the best minimum, or to one as good."""
    good = _good_misfit(model, points)
    return [point for point in points if point.misfit < good]


def _good_misfit(model: Model, points: Sequence[Point]) -> float:
    least = min((point.misfit for point in points), default=math.inf)
    return least + GOOD_MISFIT * (1.0 + least / model.samples)


def distinct(model: Model, points: Sequence[Point]) -> list[Point]:
    """Return the points at which the free numbers are not the same, the best first."""
    kept: list[Point] = []
    for point in sorted(points, key=lambda point: point.misfit):
        if all(np.abs(point.x - other.x)[: len(model.free)].max() > MIN_DISTANCE for other in kept):
            kept.append(point)
    return kept
