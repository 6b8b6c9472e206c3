"""Compute readings of a sensor with load cell and low-pass filter; find noise, rest level and bursts in a log."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly
from scipy.linalg import solve_banded

from impact_gym.parameters import SI, Parameters
from impact_gym.support.validation import number

Array = NDArray[np.float64]

GAUSS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)
MIN_STEP = 1e-9  # s; `curve` drops a point this close to the next, because rounding errors would dominate the slope
MIN_HEIGHT = 5.0, 0.2  # a burst exceeds this many standard deviations of noise, and this fraction of the highest burst


def curve(time: Array, values: Array) -> PPoly:
    """Return cubic Hermite pieces through points (k,).

    The slope at an inner point is that of the parabola through it and its neighbours, but 0 at a constant part's ends.
    `scipy.interpolate.CubicHermiteSpline` makes the same curve more slowly.
    """
    apart = np.append(np.diff(time) > MIN_STEP, True)
    time, y = time[apart], values[apart]
    steps = np.diff(time)
    rise = np.diff(y) / steps
    before, after = steps[:-1], steps[1:]
    middle = (after * rise[:-1] + before * rise[1:]) / (before + after)
    middle[(rise[:-1] == 0.0) | (rise[1:] == 0.0)] = 0.0  # slope 0 where a constant part begins or ends
    slope = np.concatenate([rise[:1], middle, rise[-1:]])
    square = (3.0 * rise - 2.0 * slope[:-1] - slope[1:]) / steps
    cube = (slope[:-1] + slope[1:] - 2.0 * rise) / steps**2
    return PPoly.construct_fast(np.array([cube, square, slope[:-1], y[:-1]]), time)


@dataclass(frozen=True, slots=True)
class LoadCell(Parameters):
    """A force sensor at the tool: a mass on an elastic element, which is a spring and damper in parallel.

    The cell reads the element's force R = k u + c u', with its compression u, stiffness k and damping c. The mass m
    obeys m u'' + R = F + m a, with the contact force F and the tool's acceleration a.
    The element is assumed to be much stiffer than the contact.
    """

    mass: Annotated[float, SI("kg", above=0)]  # mass m of the part between element and contact
    frequency: Annotated[float, SI("Hz", above=0)]  # natural frequency, sqrt(k / m) / (2 pi)
    damping_ratio: Annotated[float, SI("-", at_least=0, at_most=0.99)] = 0.0


@dataclass(frozen=True, slots=True)
class Sensor(Parameters):
    """Known properties of one column's sensor. White Gaussian noise is added after the filter."""

    rate: Annotated[float | None, SI("Hz", above=0)] = None  # sampling rate, to check a log's times; None: no check
    low_pass: Annotated[float | None, SI("Hz", above=0)] = None  # cut-off of a first-order filter; None: no filter
    bias: float | Literal["estimated"] = 0.0  # in the column's unit, added to every sample
    noise: Annotated[float | None, SI("(the column's unit)", above=0)] = None  # standard deviation; None: estimated
    cell: LoadCell | None = None  # for a force sensor; None: the sensor reads the contact force itself

    def __post_init__(self) -> None:
        Parameters.__post_init__(self)
        if self.bias != "estimated":
            object.__setattr__(self, "bias", number("Sensor.bias", self.bias, "(the column's unit), or 'estimated'"))

    def senses(self, time: Array, values: Array, at: Array) -> tuple[Array, Array]:
        """Return the sensor's readings (n,) without bias and noise, and their time derivatives, per s.

        Args:
            time: times of the signal's points (k,), s. After the last point the signal is constant. Before the first
                point it is 0 or, without filter and cell, constant.
            values: the signal at these times (k,); between them it is interpolated by `curve`.
            at: times of the readings (n,), s, increasing.
        """
        signal = curve(time, values)
        within = np.clip(at, time[0], time[-1])
        lags = self._lags()
        if not lags:
            return signal(within), np.where(at == within, signal(within, 1), 0.0)
        begin = time[max(int(np.argmax(values != 0.0)) - 1, 0)]  # the last point before the signal changes
        swings = np.arange(begin, at[-1], 0.5 / self.cell.frequency) if self.cell else np.empty(0)
        nodes = np.unique(np.r_[time[(time >= begin) & (time <= at[-1])], at[at >= begin], begin, swings])
        now, value, slope = signal(within), np.zeros(len(at)), np.zeros(len(at))
        for weight, rate in lags:
            lagging = np.interp(at, nodes, _filtered(signal, nodes, rate, time[-1]), left=0.0)
            value += np.real(weight * lagging)
            slope += np.where(at >= begin, np.real(weight * rate * (now - lagging)), 0.0)
        return value, slope

    def _lags(self) -> list[tuple[complex, complex]]:
        """Return weights and rates (1/s) of first-order lags; the real part of their weighted sum is the response."""
        slow = 2.0 * np.pi * self.low_pass if self.low_pass else None
        if self.cell is None:
            return [(1.0, slow)] if slow else []
        omega, ratio = 2.0 * np.pi * self.cell.frequency, self.cell.damping_ratio
        damping, pole = 2.0 * ratio * omega, omega * complex(ratio, np.sqrt(1.0 - ratio**2))
        weight = 1j * (omega**2 - damping * pole) / (pole.imag * pole)
        if slow is None:
            return [(weight, pole)]
        element = omega**2 - damping * slow  # for exp(-slow t) the cell's gain is element / (slow^2 + element)
        return [(element / (slow**2 + element), slow), (weight * slow / (slow - pole), pole)]


def _filtered(signal: PPoly, nodes: Array, rate: complex, last: float) -> NDArray[Any]:
    """Solve y' = rate (signal - y), y = 0 at the first node, by Gaussian quadrature; return y at `nodes` (k,)."""
    h = np.diff(nodes)[:, None]
    inside = nodes[:-1, None] + h * (GAUSS + 1.0) / 2.0
    weight = GAUSS_WEIGHTS * np.exp(-rate * h * (GAUSS[-1] - GAUSS) / 2.0)
    mean = (weight * signal(np.minimum(inside, last))).sum(1) / weight.sum(1)
    kept = np.exp(-rate * h[:, 0])
    # this banded matrix times y is y[0], followed by y[k + 1] - kept[k] y[k]
    steps = np.array([np.ones(len(nodes)), np.append(-kept, 0.0)])
    return solve_banded((1, 0), steps, np.append(0.0, mean * (1.0 - kept)), check_finite=False)


def noise_of(values: Array, sensor: Sensor) -> float:
    """Return the standard deviation of a column's noise: the sensor's, or else an estimate from second differences."""
    return sensor.noise or float(np.median(np.abs(np.diff(values, 2)) / np.sqrt(6.0)) / 0.6745)


def level(values: Array, sensor: Sensor) -> float:
    """Return the reading of a column at rest: the sensor's bias, or else the median of the column."""
    return float(np.median(values)) if sensor.bias == "estimated" else float(sensor.bias)


def bursts(force: Array, sensor: Sensor) -> list[tuple[int, int]]:
    """Return first and last index of each period in which a force exceeds its level by both limits of MIN_HEIGHT."""
    height = force - level(force, sensor)
    deviations, fraction = MIN_HEIGHT
    return runs(height > max(deviations * noise_of(force, sensor), fraction * float(height.max())))


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask, [0]])))
    return [(int(first), int(past) - 1) for first, past in zip(edges[::2], edges[1::2], strict=True)]
