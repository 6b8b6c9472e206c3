"""The result of a fit: estimates, intervals, a figure, and sentences that say what the log cannot determine."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from scipy.special import chdtrc, fdtrc, ndtri  # scipy.stats would double the import time of this package

from impact_gym.identification.fit import Ends, Fit
from impact_gym.identification.log import FLAT_SAMPLES, UNITS
from impact_gym.identification.model import RESTITUTION
from impact_gym.identification.sensor import Array, runs
from impact_gym.quantities import BY_PATH
from impact_gym.scene import Scene
from impact_gym.simulation import simulate

WIDE_RATIO = 2.0  # an interval is wide if its larger end exceeds this times its smaller end (absolute values)
WIDE_RESTITUTION = 0.3  # the restitution's interval is wide if its length exceeds this
FAR = 100.0  # a number is far from its guess if it differs by this factor or more, less twice its standard deviation
MIN_CORRELATION = 0.95  # two numbers are not separated if |correlation| exceeds this and an interval of the two is wide

FALSE_ALARM = 1e-4  # probability that one test of the residuals rejects a correct model
LAGS = 10  # largest lag, in samples, at which the residuals' autocorrelation is tested
MIN_BEFORE = 8  # with fewer samples before the touch, their mean and variance are not tested

Interval = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Identified:
    """The result of `identify`: estimates of the free numbers in SI units, intervals, and sentences on the fit."""

    estimate: Mapping[str, float]  # keys are dotted names, such as "object.mass"
    # 95 % confidence if `warnings` is empty; an end of 0 or +-inf, or of 1 for the restitution, means no limit
    interval: Mapping[str, Interval]
    correlation: Array  # (k, k), of the coordinates (see `model`) of the k free numbers, in the order of `estimate`
    scene: Scene  # the given scene with the estimates
    indistinguishable: tuple[str, ...]  # sentences on what the logs do not determine
    warnings: tuple[str, ...]  # doubts about the fit, the logs or the guess; each was also given as a UserWarning
    start: tuple[float, ...]  # s, for each log: start of the motion, on the log's clock
    noise: Mapping[str, float]  # standard deviation of each column's noise, known or estimated, in the column's unit
    bias: tuple[Mapping[str, float], ...]  # for each log: bias of each column, known or estimated, in the column's unit
    residuals: tuple[Mapping[str, Array], ...] = field(repr=False)  # for each log and column: measured - fitted, (n,)
    fit: Fit = field(repr=False)

    @classmethod
    def of(cls, fit: Fit, ends: Sequence[Ends]) -> "Identified":
        """Return the result of a fit and interval `ends`; also give each sentence of `misfits` as a UserWarning."""
        model, free = fit.model, fit.model.free
        covariance = fit.covariance[: len(free), : len(free)]
        deviations = np.sqrt(np.diag(covariance))
        correlation = covariance / np.outer(deviations, deviations)
        both = [(number.end(low, -1), number.end(high, 1)) for number, (low, high) in zip(free, ends, strict=True)]
        interval = {number.name: (min(pair), max(pair)) for number, pair in zip(free, both, strict=True)}
        doubts = tuple(misfits(fit))
        for doubt in doubts:
            warnings.warn(doubt, stacklevel=3)
        biases, residuals = model.biases(fit.x), -model.residuals(fit.x) * model.scales()
        slots = [{name: model.slots[k, name] for name in log.columns} for k, log in enumerate(model.logs)]
        return cls(
            {number.name: number.number(u) for number, u in zip(free, fit.x, strict=False)}, interval, correlation,
            model.scene_at(fit.x), tuple(_words(model.scene, interval, correlation)), doubts,
            start=tuple(fit.x[len(free) : len(free) + len(model.logs)].tolist()), noise=dict(model.noise),
            bias=tuple({name: float(biases[slot.start]) for name, slot in log.items()} for log in slots),
            residuals=tuple({name: residuals[slot] for name, slot in log.items()} for log in slots), fit=fit,
        )  # fmt: skip

    def plot(self) -> Any:
        """Return a Matplotlib figure: for each log and column, measured and fitted values, and residual / noise."""
        from matplotlib.figure import Figure

        model = self.fit.model
        figure = Figure(figsize=(10.0, 3.0 * len(model.slots)), layout="constrained")
        axes = figure.subplots(len(model.slots), 2, squeeze=False, sharex="row", width_ratios=(2, 1))
        fitted = model.predicted(self.fit.x)[0] + model.biases(self.fit.x)
        left = model.residuals(self.fit.x)
        for ((k, name), slot), (signal, rest) in zip(model.slots.items(), axes, strict=True):
            log = model.logs[k]
            signal.plot(log.time, log.columns[name], ".", markersize=3, label="measured")
            signal.plot(log.time, fitted[slot], label="fitted")
            signal.set(xlabel="time (s)", ylabel=f"{name} ({UNITS[name]})", title=log.name)
            signal.legend()
            rest.plot(log.time, -left[slot], ".", markersize=3)
            rest.set(xlabel="time (s)", ylabel="residual over noise")
            rest.locator_params(axis="x", nbins=4)
        return figure

    def __str__(self) -> str:
        lines = []
        for (name, value), (low, high) in zip(self.estimate.items(), self.interval.values(), strict=True):
            sure = "unreliable interval" if self.warnings else "95 % in"
            lines.append(f"{_with_unit(self.scene, name, f'{name} = {value:.6g}')}, {sure} {low:.6g} to {high:.6g}")
        for (i, first), (j, second) in combinations(enumerate(self.estimate), 2):
            lines.append(f"correlation of {first} and {second}: {self.correlation[i, j]:.2f}")
        return "\n".join([*lines, *self.indistinguishable, *self.warnings])


def misfits(fit: Fit) -> Iterator[str]:
    """Yield a sentence for each number far from its guess (other than the contact's), and for each test that fails.

    Residuals: 1. If the bias is known, the mean before the touch is 0 (normal distribution). 2. The mean square after
    the touch does not exceed the variance before (Fisher's F). 3. The mean square does not exceed a known variance of
    the noise (chi-squared). 4. They are white noise (Ljung and Box, Biometrika 65, 1978). `tool_velocity` has only 3
    and 4; `flange_velocity`, and columns whose noise is below the sensor's resolution, have none. 5. A force or an
    acceleration stays at its extreme no longer than the fit stays within the sensor's resolution of its own extreme.
    """
    model = fit.model
    scene, left = model.scene_at(fit.x), -fit.model.residuals(fit.x)
    for number, u, deviation in zip(model.free, fit.x, fit.deviations, strict=False):
        guess = number.start(model.scene)
        if abs(u - guess) - 2.0 * deviation > np.log(FAR) and not number.name.startswith("contact."):
            words = f"{number.name} is {number.number(u):.3g}, but its guess is {number.number(guess):.3g}"
            yield f"{_with_unit(scene, number.name, words)}: are the units of the log and of the guess right?"
    for (k, name), slot in model.slots.items():
        log, rest, unit = model.logs[k], left[slot], UNITS[name]
        noise, n = model.noise[name], len(rest)
        resolution = np.diff(np.unique(log.columns[name])).min(initial=np.inf)
        for side in (1.0, -1.0) if "velocity" not in name else ():
            y, fitted = side * log.columns[name], side * (log.columns[name] - noise * rest)
            first, last = max(runs(y == y.max()), key=np.ptp)
            longest = max(np.sum(fitted > fitted.max() - resolution), FLAT_SAMPLES - 1)
            if y[first] and last - first >= longest and fitted[first : last + 1].max() > y[first] + resolution / 2.0:
                yield f"{log.name}, {name} stays at {side * y[first]:g} {unit}, longer than the fit: is it saturated?"
        if noise < resolution or name == "flange_velocity":
            continue
        at = log.time - fit.x[len(model.free) + k]
        contacts = simulate(scene, model.motions[k], max(float(at[-1]), log.step)).contacts
        touch = contacts[0].start if contacts else np.inf
        before, behind = rest[at < touch], rest[at >= touch]
        if name != "tool_velocity" and len(before) >= MIN_BEFORE:
            spread, mean = float(np.std(before, ddof=1)), float(np.mean(before))
            limit = -float(ndtri(FALSE_ALARM / 2.0)) * spread / len(before) ** 0.5
            if abs(mean) > limit and model.sensors[name].bias != "estimated":
                yield (f"{log.name}, {name} has a mean of {mean * noise:.3g} {unit} before the touch: the sensor was "
                       'probably not tared; give its bias, or bias = "estimated"')  # fmt: skip
            ratio = float(np.mean(behind**2)) / spread**2 if len(behind) and spread else 0.0
            if not spread:
                yield f"{log.name}, {name} is constant before the touch: a dead band of the sensor may hide its noise"
            elif fdtrc(len(behind), len(before) - 1, ratio) < FALSE_ALARM:
                yield (f"{log.name}, {name}: from the touch on, the residuals are {ratio**0.5:.3g} times the noise "
                       "before the touch: is something missing in the scene or the sensor?")  # fmt: skip
        if model.sensors[name].noise is not None and chdtrc(n, float(np.sum(rest**2))) < FALSE_ALARM:
            yield (f"{log.name}, {name}: the residuals are {float(np.mean(rest**2)) ** 0.5:.3g} times the noise "
                   "given for the sensor")  # fmt: skip
        lags = np.arange(1, min(LAGS, n // 5) + 1)
        centred = rest - rest.mean()
        power = [float(centred[lag:] @ centred[:-lag]) / float(centred @ centred) for lag in lags]
        if len(lags) and chdtrc(len(lags), n * (n + 2) * np.sum(np.square(power) / (n - lags))) < FALSE_ALARM:
            yield (f"{log.name}, {name}: the residuals are not white noise (Ljung and Box): the signal drifts, or the "
                   "scene or the sensor is wrong")  # fmt: skip


def _with_unit(scene: Any, name: str, text: str) -> str:
    if name == "contact.stiffness":
        return f"{text} N/m^{scene.contact.stiffness_exponent:g}"
    return f"{text} {BY_PATH[name].unit}".removesuffix(" -")


def _words(scene: Scene, interval: Mapping[str, Interval], correlation: Array) -> Iterator[str]:
    """Yield a sentence for each number with a wide interval, and for each pair of numbers that is not separated."""
    wide = []
    for name, ends in interval.items():
        least, most = sorted(map(abs, ends))
        if (most - least > WIDE_RESTITUTION) if name == RESTITUTION else (most > WIDE_RATIO * least):
            wide.append(name)
            yield _sentence(scene, name, *ends)
    for (i, first), (j, second) in combinations(enumerate(interval), 2):
        if abs(correlation[i, j]) > MIN_CORRELATION and not {first, second}.isdisjoint(wide):
            size = "larger" if correlation[i, j] > 0 else "smaller"
            yield (f"the log does not separate {first} and {second}: a larger {first} with a {size} {second} fits "
                   f"equally well (correlation {correlation[i, j]:.3f})")  # fmt: skip


def _sentence(scene: Scene, name: str, low: float, high: float) -> str:
    most = 1.0 if name == RESTITUTION else np.inf
    open_below, open_above = low in (-most, 0.0), high in (0.0, most)  # the limits of a negative number are -inf and 0
    if open_below and open_above:
        return f"the log does not determine {name} at all: any value fits equally well"
    if open_above or open_below:
        limit = f"above {low:.3g}" if open_above else f"below {high:.3g}"
        return f"the log does not determine {name}: any value {_with_unit(scene, name, limit)} fits equally well"
    return f"the log hardly determines {name}: it lies between {_with_unit(scene, name, f'{low:.3g} and {high:.3g}')}"
