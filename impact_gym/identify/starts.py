"""Where a fit begins: scenes scattered over what is searched, each at the start time that suits the log best."""

import numpy as np
from numpy.typing import NDArray

from impact_gym.identify.coordinates import number_at
from impact_gym.identify.log import Log, level
from impact_gym.identify.model import Model
from impact_gym.simulation import Trace

Array = NDArray[np.float64]

SCATTERED = 40
SEED = 0


def scattered(model: Model) -> list[Array]:
    """Return starting points x, best first: the scene as it is given, and a Latin hypercube of its free numbers."""
    rng = np.random.default_rng(SEED)
    low, high = np.array([[one.coordinate(size) for size in one.searched] for one in model.free]).T
    cells = np.array([rng.permutation(SCATTERED) for _ in model.free]).T
    points = low + (high - low) * (cells + rng.random(cells.shape)) / SCATTERED
    points = np.vstack([_given(model), points])
    placed = [_placed(model, point, rng.random()) for point in points]
    order = np.argsort([misfit for misfit, _ in placed], kind="stable")
    return [placed[k][1] for k in order if np.isfinite(placed[k][0])]


def _given(model: Model) -> Array:
    """Return the coordinates of the scene's own numbers, the middle of a range that they are not in."""
    given = []
    for one in model.free:
        size = abs(number_at(model.scene, one.name))
        low, high = one.reach
        inside = size > 0.0 and low <= one.coordinate(size) <= high
        given.append(one.coordinate(size) if inside else (low + high) / 2.0)
    return np.array(given)


def _placed(model: Model, point: Array, share: float) -> tuple[float, Array]:
    """Return the misfit of a scene, and x with the start times and biases at which it is least.

    Times are tried on the log's own grid, moved by a `share` of a sample, and none at which the log begins later than
    its own length after the touch.
    """
    x = np.zeros(model.size)
    x[: len(point)] = point
    total = 0.0
    try:
        scene = model.scene_at(x)
        for k, log in enumerate(model.logs):
            first = model.traced(scene, k, model.latest(scene, k))
            misfit, shift, rest = _aligned(model, log, first, share)
            x[len(point) + k] = log.time[0] + shift
            for place, (other, name) in enumerate(model.biased):
                if other == k:
                    x[len(point) + len(model.logs) + place] = rest[name]
            total += misfit
    except (ValueError, RuntimeError):
        return np.inf, x
    return total, x


def _aligned(model: Model, log: Log, trace: Trace, share: float) -> tuple[float, float, dict[str, float]]:
    """Return the least misfit of a motion with a log, the start of the motion after the log's (s), and the biases."""
    step, n = log.step, len(log.time)
    touch = trace.time[np.argmax(trace.contact_force > 0.0)] if np.any(trace.contact_force > 0.0) else np.inf
    last = min(trace.time[-1], touch + 2.0 * n * step)
    times: Array = (np.arange(int(last / step), dtype=float) + share) * step
    m = len(times)  # shift k puts sample j of the motion on sample j + k of the log; the log ends within the motion
    misfit, rests = np.zeros(m + 1), {}
    length = 1 << int(n + m).bit_length()
    for name, values in log.columns.items():
        sensor = model.sensors[name]
        free = sensor.bias == "estimated"
        rest = level(values, sensor)
        y = values - rest
        read = model.read(trace, name, times)[0]
        spectrum = np.fft.rfft(y, length) * np.conj(np.fft.rfft(read, length))
        products = np.fft.irfft(spectrum, length)
        lags = np.arange(n - m, n + 1)
        sums, squares = (np.concatenate([[0.0], np.cumsum(part)]) for part in (read, read**2))
        begin, end = np.maximum(-lags, 0), np.minimum(n - lags, m)
        inside, power = sums[end] - sums[begin], squares[end] - squares[begin]
        off = (np.sum(y) - inside) / n
        misfit += (np.sum(y**2) - 2.0 * products[lags % length] + power - free * n * off**2) / model.noise[name] ** 2
        rests[name] = off + rest
    best = int(np.argmin(misfit))
    shift = (n - m + best) * step - share * step
    return float(misfit[best]), shift, {name: float(rest[best]) for name, rest in rests.items()}
