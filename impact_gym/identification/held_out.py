"""Predict the blows of each half of the logs from a fit to the other half."""

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from impact_gym.identification import FREE, Identified, Sensor, identify, motion_of_each
from impact_gym.identification.log import Log, read
from impact_gym.identification.model import Model
from impact_gym.identification.search import descend, start_at
from impact_gym.identification.sensor import Array, level, runs
from impact_gym.motion import Trapezoid
from impact_gym.scene import Scene

UNITS = {"object_velocity": "m/s", "peak_force": "N", "impulse": "N s", "duration": "s"}
"""Units of a blow's quantities: final velocity of the object; peak, integral and width (at half peak) of the force."""
END = 0.25  # the final velocity is the mean over this last fraction of a log


class Prediction(NamedTuple):
    """The prediction of one quantity of a blow; units as in UNITS."""

    log: str
    quantity: str
    measured: float
    predicted: float
    equal: float  # median measured value of blows in the other half with the same motion; nan: there are none


@dataclass(frozen=True)
class HeldOut:
    """Predictions of all blows, each from a fit to the half of the logs without the blow."""

    predictions: tuple[Prediction, ...]

    def errors(self, quantity: str) -> tuple[Array, Array]:
        """Return |relative error| (blows,) of `Prediction.predicted`, and of `Prediction.equal` as a prediction."""
        rows = [each[2:] for each in self.predictions if each.quantity == quantity]
        measured, predicted, equal = np.array(rows).reshape(-1, 3).T
        with np.errstate(divide="ignore"):  # a measured value may be 0
            return np.abs(predicted - measured) / np.abs(measured), np.abs(equal - measured) / np.abs(measured)

    def __str__(self) -> str:
        lines = ["predictions by a fit to the other half of the logs:"]
        for log, quantity, measured, predicted, _ in self.predictions:
            off = 100.0 * (predicted / measured - 1.0) if measured else math.inf
            lines.append(f"{log}: {quantity} {measured:.4g} {UNITS[quantity]}, predicted {predicted:.4g}, {off:+.1f} %")
        for quantity in dict.fromkeys(each.quantity for each in self.predictions):
            errors, of_equals = self.errors(quantity)
            known = of_equals[np.isfinite(of_equals)]
            beside = f"; blows with the same motion differ by {100.0 * np.median(known):.1f} %" if len(known) else ""
            lines.append(f"{quantity}: median error {100.0 * np.median(errors):.1f} %, 95th percentile "
                         f"{100.0 * np.quantile(errors, 0.95):.1f} %{beside}")  # fmt: skip
        return "\n".join(lines)

    def csv(self) -> str:
        """Return the predictions as CSV, a row for each blow and quantity."""
        table = csv.writer(text := io.StringIO(), lineterminator="\n")
        table.writerow(["log", "quantity", "unit", "measured", "predicted", "equal blows"])
        table.writerows([log, quantity, UNITS[quantity], *values] for log, quantity, *values in self.predictions)
        return text.getvalue()


def hold_out(
    log: Sequence[Any], scene: Scene, motion: Trapezoid | Sequence[Trapezoid],
    free: Iterable[str] = FREE, sensor: Sensor | Mapping[str, Sensor] | None = None,
) -> HeldOut:  # fmt: skip
    """Fit every second log and predict the other logs, then swap the halves; for the arguments see `identify`.

    Raises:
        TypeError, ValueError: as in `identify`; also if there are fewer than two logs, or logs with different columns.
    """
    if (count := len(log) if isinstance(log, (list, tuple)) else 1) < 2:
        raise ValueError(f"hold-out needs 2 logs or more, got {count}")
    logs = [read(source, f"log {k + 1}") for k, source in enumerate(log)]
    columns = logs[0].columns.keys()
    for each in logs:
        if each.columns.keys() != columns:
            raise ValueError(f"hold-out needs logs with equal columns: {each.name} has {', '.join(each.columns)}, but"
                             f" the first log has {', '.join(columns)}")  # fmt: skip
    if not {"force", "object_velocity"} & columns:
        raise ValueError(f"hold-out needs a column force or object_velocity, got {', '.join(columns)}")
    motions = motion_of_each(motion, logs)
    fits = [identify(logs[half::2], scene, motions[half::2], free, sensor) for half in (0, 1)]
    measured = [_quantities(each, fits[0]) for each in logs]
    predictions = []
    for k, each in enumerate(logs):
        fitted = range(1 - k % 2, len(logs), 2)  # indices of the logs in the other half
        made = _quantities(_predicted(each, motions[k], fits[fitted.start]), fits[0])
        for quantity, value in measured[k].items():
            equal = [measured[other][quantity] for other in fitted if motions[other] == motions[k]] or [math.nan]
            predictions.append(Prediction(each.name, quantity, value, made[quantity], float(np.median(equal))))
    return HeldOut(tuple(predictions))


def _predicted(log: Log, motion: Trapezoid, fit: Identified) -> Log:
    """Return a log of predicted readings; only start and biases are fitted to `log`."""
    model = Model([log], fit.scene, [motion], fit.fit.model.sensors, ())
    x = descend(model, start_at(model, np.empty(0), 0.5).x).x
    samples = model.predicted(x)[0] + model.biases(x)
    return Log(log.name, log.time, {name: samples[slot] for (_, name), slot in model.slots.items()})


def _quantities(log: Log, fit: Identified) -> dict[str, float]:
    found = {}
    if "object_velocity" in log.columns:
        found["object_velocity"] = float(np.mean(log.columns["object_velocity"][-max(int(END * len(log.time)), 1) :]))
    if "force" in log.columns:
        force = log.columns["force"] - level(log.columns["force"], fit.fit.model.sensors["force"])
        found["peak_force"], found["impulse"] = float(force.max()), float(np.trapezoid(force, log.time))
        found["duration"] = log.step * _width(force)
    return found


def _width(force: Array) -> float:
    """Return the width of a blow at half of its peak, in samples, interpolated linearly."""
    high, padded = 0.5 * force.max(), np.concatenate([[0.0], force, [0.0]])
    first, last = next(run for run in runs(padded > high) if run[0] <= padded.argmax() <= run[1])
    inside = [(padded[a] - high) / (padded[a] - padded[b]) for a, b in ((first, first - 1), (last, last + 1))]
    return float(last - first + sum(inside))
