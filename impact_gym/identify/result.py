"""What a fit says: numbers, how sure they are, and a picture."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.identify.fit import Fit
from impact_gym.identify.log import UNITS, bursts, level
from impact_gym.identify.words import unit_of
from impact_gym.scene import Scene

Array = NDArray[np.float64]

SURE = 6.0  # standard deviations, by which a blow that the scene does not make stands out of the fit


@dataclass(frozen=True, eq=False)
class Identified:
    """What the logs say of the free numbers; all in SI units, keyed by their dotted names."""

    estimate: Mapping[str, float]
    interval: Mapping[str, tuple[float, float]]  # 95 %; 0 or inf where the log sets no limit
    correlation: Array  # (k, k), of the estimates in the order of `estimate`, on the scales they are fitted on
    scene: Scene  # with the estimates
    indistinguishable: tuple[str, ...]  # what the log cannot tell, in words; empty if it tells everything
    fit: Fit = field(repr=False)

    @property
    def start(self) -> tuple[float, ...]:
        """When the motion began, on the clock of each log, s."""
        model = self.fit.model
        return tuple(self.fit.x[len(model.free) : len(model.free) + len(model.logs)].tolist())

    @property
    def noise(self) -> Mapping[str, float]:
        """Standard deviation of each column, known or estimated, in its unit."""
        return dict(self.fit.model.noise)

    @property
    def bias(self) -> tuple[Mapping[str, float], ...]:
        """Bias of each column of each log, known or estimated, in its unit."""
        return tuple({name: float(values[0]) for name, values in log.items()} for log in self._split("biases"))

    @property
    def residuals(self) -> tuple[Mapping[str, Array], ...]:
        """Measured less fitted, (n,) for each column of each log, in its unit."""
        model = self.fit.model
        left = -model.residuals(self.fit.x) * model.scales()
        return self._parts(left)

    def _split(self, what: str) -> tuple[Mapping[str, Array], ...]:
        return self._parts(getattr(self.fit.model, what)(self.fit.x))

    def _parts(self, values: Array) -> tuple[Mapping[str, Array], ...]:
        slots = self.fit.model.slots
        return tuple(
            {name: values[slots[k, name]] for name in log.columns} for k, log in enumerate(self.fit.model.logs)
        )

    def plot(self) -> Any:
        """Return a Matplotlib figure: each column as it was measured and fitted, and what is left over the noise."""
        from matplotlib.figure import Figure

        model = self.fit.model
        rows = list(model.slots)
        figure = Figure(figsize=(10.0, 3.0 * len(rows)), layout="constrained")
        axes = figure.subplots(len(rows), 2, squeeze=False, sharex="row", width_ratios=(2, 1))
        fitted = model.predicted(self.fit.x)[0] + model.biases(self.fit.x)
        left = model.residuals(self.fit.x)
        for (k, name), (signal, rest) in zip(rows, axes, strict=True):
            log, slot = model.logs[k], model.slots[k, name]
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
        for name, value in self.estimate.items():
            (low, high), unit = self.interval[name], unit_of(self.scene, name).replace("(no unit)", "")
            lines.append(f"{name} = {value:.6g} {unit}".rstrip() + f", 95 % in {low:.6g} to {high:.6g}")
        for (i, first), (j, second) in combinations(enumerate(self.estimate), 2):
            lines.append(f"correlation of {first} and {second}: {self.correlation[i, j]:.2f}")
        return "\n".join([*lines, *self.indistinguishable])


def more_blows(fit: Fit) -> str:
    """Return a sentence about a log with more blows than the fitted motion has, an empty one if there is none."""
    model = fit.model
    for k, log in enumerate(model.logs):
        if "force" not in log.columns:
            continue
        force, sensor = log.columns["force"], model.sensors["force"]
        found = bursts(force, sensor)
        times = [float(log.time[first]) for first, _ in found]
        left = -model.residuals(fit.x)[model.slots[k, "force"]]  # standard deviations
        signal = (force - level(force, sensor)) / model.noise["force"]
        lonely = []
        for time, (first, last) in zip(times, found, strict=True):
            own = slice(first, last + 1)
            if left[own].sum() > max(SURE * (last - first + 1) ** 0.5, 0.5 * signal[own].sum()):
                lonely.append(time)
        if lonely and len(found) > 1:
            return (
                f"{log.name} has {len(found)} blows, at {', '.join(f'{time:g}' for time in times)} s, the scene makes"
                f" no more than {len(found) - len(lonely)} of them: cut it to one, or give each as a log of its own"
            )
    return ""
