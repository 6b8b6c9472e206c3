"""Choose starting points x of a fit, run least squares from several of them, and stop the worst fits early.

The free numbers of a starting point come from the given scene, from a measured blow (impulse and width), or from a
Latin hypercube over the searched ranges. Its start times and biases minimize the misfit.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from impact_gym.identification.log import tool_mass
from impact_gym.identification.model import MASS, RESTITUTION, STIFFNESS, Model
from impact_gym.identification.sensor import Array, level
from impact_gym.scene import Scene

SCATTERED = 40  # number of points of the Latin hypercube
SEED = 0
RESTITUTIONS = 0.1, 0.3, 0.5, 0.7, 0.9, 0.98  # restitutions that `from_impulse` tries, if the restitution is free
PASSES = 8  # largest number of simulations by `from_impulse` for one starting point
NEAR = 0.1  # `from_impulse` stops correcting if |ln(simulated / measured)| is below this for impulse and width
HEAVY = 1e3  # largest ratio of object mass to tool mass that `from_impulse` computes from an impulse
ROUNDS = 5  # number of rounds in `race`; each round ends with a comparison of the fits
ROUND_EVALUATIONS = 8  # largest number of times that a round of `race` evaluates the residuals of one fit
# fraction by which a round must reduce (misfit - least misfit) of a fit that is not good and has not converged
MIN_GAP_REDUCTION = 0.2
GOOD_MISFIT = 20.0  # a fit is good if its misfit < least misfit + this * (1 + least misfit / number of samples)
MIN_DISTANCE = 0.03  # two fits are distinct if a coordinate (see `model`) of a free number differs by more than this
LARGEST_START = 4.0  # largest |ln(e/(1-e))| of the restitution e at the start of a fit, so that e is 0.018 to 0.982
FINE, ROUGH = 1e-8, 1e-5  # relative tolerances of least squares: FINE for final fits, ROUGH for intermediate fits


class Point(NamedTuple):
    """A vector x and its misfit."""

    misfit: float  # sum of ((predicted - measured) / noise)^2
    x: Array
    is_minimum: bool = True  # False: least squares did not converge, or was not run


def scatter(model: Model) -> list[Array]:
    """Return the starting points x that can be simulated, the best first."""
    rng = np.random.default_rng(SEED)
    low, high = np.array([[number.coordinate(size) for size in number.searched] for number in model.free]).T
    cells = np.array([rng.permutation(SCATTERED) for _ in model.free]).T
    points = low + (high - low) * (cells + rng.random(cells.shape)) / SCATTERED
    given = np.array([number.start(model.scene) for number in model.free])
    starts = [start_at(model, point, rng.random()) for point in [given, *from_impulse(model, given), *points]]
    starts.sort(key=lambda start: start.misfit)
    return [start.x for start in starts if np.isfinite(start.misfit)]


def from_impulse(model: Model, given: Array) -> list[Array]:
    """Return a point for each restitution; its blow has about the impulse and width of the first log with a force.

    With restitution e, speed v and the object's mass m the impulse is (1 + e) v / (1/m + 1/m_tool). The width is
    impulse / peak. For a force k delta^n (penetration delta) the width is proportional to k^(-1/(n + 1)) (Johnson,
    Contact Mechanics, 1985, sec. 11.4). The function repeats: simulate a blow, then correct m and k.
    """
    indices = {number.name: i for i, number in enumerate(model.free)}
    k = next((k for k, log in enumerate(model.logs) if "force" in log.columns), None)
    if k is None or not {MASS, STIFFNESS} & set(indices):
        return []
    log, sensor = model.logs[k], model.sensors["force"]
    force, few = log.columns["force"], max(len(log.time) // 20, 1)
    rests = np.median(force[:few]), np.median(force[-few:])  # use the lower one: the blow may cover one end
    force = force - (min(rests) if sensor.bias == "estimated" else sensor.bias)
    impulse, peak = float(np.trapezoid(force, log.time)), float(force.max())

    def put(name: str, u: float) -> None:
        if name in indices:
            x[indices[name]] = np.clip(u, *model.free[indices[name]].reach)

    points = []
    for restitution in RESTITUTIONS if RESTITUTION in indices else RESTITUTIONS[:1]:
        x, light, heavy = given.copy(), -math.inf, math.inf  # light, heavy: limits of ln(object mass)
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


def start_at(model: Model, point: Array, fraction: float) -> Point:
    """Return `point` with the best start times and biases; `fraction` (of a log step) shifts the tried start times."""
    x = np.append(point, np.zeros(model.size - len(point)))
    try:
        scene = model.scene_at(x)
        misfit = sum(_align(model, scene, x, k, fraction) for k in range(len(model.logs)))
    except (ValueError, RuntimeError):
        misfit = math.inf
    return Point(misfit, x, is_minimum=False)


def _align(model: Model, scene: Scene, x: Array, k: int, fraction: float) -> float:
    """Set the start and the biases of log k in x to those that fit best; return the misfit."""
    log, trace = model.logs[k], model.trace(scene, k, model.latest(scene, k))
    step, n = log.step, len(log.time)
    touch = trace.time[np.argmax(trace.contact_force > 0.0)] if np.any(trace.contact_force > 0.0) else np.inf
    last = min(trace.time[-1], touch + 2.0 * n * step)
    first = max(touch - 2.0 * n * step, 0.0) if np.isfinite(touch) else 0.0
    times: Array = first + (np.arange(int((last - first) / step), dtype=float) + fraction) * step
    m = len(times)  # at lag k, sample j of the motion lies at sample j + k of the log
    misfit, biases = np.zeros(m + 1), dict[str, Array]()
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
    x[len(model.free) + k] = log.time[0] + ((n - m + best - fraction) * step - first)
    for name, bias in biases.items():
        if (k, name) in model.bias_indices:
            x[model.bias_indices[k, name]] = bias[best]
    return float(misfit[best])


def descend(
    model: Model, x: Array, fixed: int | None = None, tolerance: float = FINE,
    evaluations: int = ROUNDS * ROUND_EVALUATIONS,
) -> Point:  # fmt: skip
    """Run least squares from x, with x[fixed] constant and at most `evaluations` evaluations of the residuals."""
    free = np.delete(np.arange(model.size), [] if fixed is None else [fixed])
    x = x.copy()
    if not np.all(np.isfinite(x)):
        return Point(math.inf, x, is_minimum=False)
    # start times and biases are counted from their initial values, because MINPACK's tolerance is relative to x
    origin = np.where(np.arange(model.size) < len(model.free), 0.0, x)
    for i, number in enumerate(model.free):  # start away from restitutions 0 and 1, where the derivative vanishes
        if number.name == RESTITUTION and i != fixed:
            x[i] = np.clip(x[i], -LARGEST_START, LARGEST_START)

    def full(part: Array) -> Array:
        point = x.copy()
        point[free] = origin[free] + part
        return point

    solution = least_squares(
        lambda part: model.residuals(full(part)), (x - origin)[free],
        jac=lambda part: model.jacobian(full(part), skip=fixed)[:, free], method="lm", x_scale="jac",
        max_nfev=evaluations, ftol=tolerance, xtol=tolerance, gtol=tolerance,
    )  # fmt: skip
    end = full(solution.x)
    end[: len(model.free)] = [np.clip(u, *number.reach) for u, number in zip(end, model.free, strict=False)]
    return Point(2.0 * float(solution.cost), end, solution.status > 0)


def race(model: Model, starts: Sequence[Array]) -> list[Point]:
    """Fit roughly from all `starts`, in rounds of a few steps; return the distinct fits that remain, the best first.

    A fit that has not converged is dropped if it is clearly worse than the best fit and hardly improved in a round.
    """
    points = [Point(math.inf, x, is_minimum=False) for x in starts]
    for _ in range(ROUNDS):
        before = [point.misfit for point in points]
        points = [p if p.is_minimum else descend(model, p.x, None, ROUGH, ROUND_EVALUATIONS) for p in points]
        least = min((point.misfit for point in points), default=math.inf)
        good = {id(point) for point in as_good(model, points)}
        gaps = [(1.0 - MIN_GAP_REDUCTION) * (misfit - least) for misfit in before]
        points = distinct(model, [point for point, gap in zip(points, gaps, strict=True)
                                  if point.is_minimum or id(point) in good or point.misfit - least < gap])  # fmt: skip
    return points


def as_good(model: Model, points: Sequence[Point]) -> list[Point]:
    """Return the points whose misfit is near the least misfit, see GOOD_MISFIT."""
    least = min((point.misfit for point in points), default=math.inf)
    return [point for point in points if point.misfit < least + GOOD_MISFIT * (1.0 + least / model.samples)]


def distinct(model: Model, points: Sequence[Point]) -> list[Point]:
    """Return the points, the best first; leave out a point whose free numbers are nearly those of a better point."""
    kept: list[Point] = []
    for point in sorted(points, key=lambda point: point.misfit):
        if all(np.abs(point.x - other.x)[: len(model.free)].max() > MIN_DISTANCE for other in kept):
            kept.append(point)
    return kept
