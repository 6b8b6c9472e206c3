"""A measured blow: reading it, and refusing what cannot be one, in one line that says where and what is allowed."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.identify.sensor import Sensor
from impact_gym.motion import Trapezoid
from impact_gym.validation import WrongTypeError

Array = NDArray[np.float64]

UNITS = {"force": "N", "flange_velocity": "m/s", "tool_velocity": "m/s", "object_velocity": "m/s"}
"""What a log may have beside `time` (s)."""

FEWEST = 8  # samples
LARGEST_FORCE = 1e5  # N
FASTEST = 10.0  # times the motion's speed
SLOWEST = 0.05  # s between two samples
GAP = 1.5  # times the usual step
CLEAR = 5.0  # standard deviations of the noise, by which a blow stands out
FLAT = 3  # samples with the very same largest value, between much smaller ones


@dataclass(frozen=True, eq=False)
class Log:
    """One blow as it was recorded."""

    name: str
    time: Array  # (n,), s
    columns: Mapping[str, Array]  # (n,) each, see UNITS

    @property
    def step(self) -> float:
        """Usual time between two samples, s."""
        return float(np.median(np.diff(self.time)))


def read(source: Any, name: str) -> Log:
    """Return the log in a mapping of columns, or in a CSV file with their names in its first line.

    Raises:
        TypeError, ValueError: it is neither; columns are missing, unknown or of different lengths; a value is no finite
            number; time does not increase or has a gap.
    """
    if isinstance(source, (str, PathLike)):
        name, source = str(source), _table(Path(source))
    if not isinstance(source, Mapping):
        raise WrongTypeError(f"{name} must be a mapping of columns or the path of a CSV file, got {source!r}")
    for column in source:
        if column not in ("time", *UNITS):
            raise ValueError(f"{name} has an unknown column {column!r}; known are time (s), {_known()}")
    if "time" not in source or len(source) < 2:
        raise ValueError(f"{name} must have a column time (s) and at least one of {_known()}, got {list(source)}")
    columns = {column: _numbers(f"{name}, {column}", values) for column, values in source.items()}
    lengths = {column: len(values) for column, values in columns.items()}
    if len(set(lengths.values())) > 1 or min(lengths.values()) < FEWEST:
        raise ValueError(f"{name} must have columns of one length, {FEWEST} samples at least, got {lengths}")
    time = columns.pop("time")
    steps = np.diff(time)
    usual = float(np.median(steps))
    if np.any(steps <= 0.0):
        k = int(np.argmax(steps <= 0.0))
        raise ValueError(f"{name}, time must increase, but sample {k + 1} is at {time[k + 1]:g} s after {time[k]:g} s")
    if usual > SLOWEST:
        raise ValueError(
            f"{name}, time must have at most {SLOWEST:g} s between samples, got {usual:g} s: is it in ms, not in s?"
        )
    if steps.max() > GAP * usual:
        k = int(np.argmax(steps))
        raise ValueError(
            f"{name}, time must have no gaps, but {steps[k]:g} s lie between samples {k} and {k + 1}, at {time[k]:g} s"
            f", where the usual step is {usual:g} s"
        )
    return Log(name, time, columns)


def _known() -> str:
    return ", ".join(f"{name} ({unit})" for name, unit in UNITS.items())


def _table(path: Path) -> dict[str, Sequence[Any]]:
    try:
        with path.open(newline="") as file:
            lines = [line for line in csv.reader(file) if line]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path} is not read as CSV: {error}") from error
    if not lines:
        raise ValueError(f"{path} is empty; its first line must name the columns: time, and any of {_known()}")
    head = [name.strip() for name in lines[0]]
    for number, line in enumerate(lines[1:], start=1):
        if len(line) != len(head):
            raise ValueError(f"{path}, sample {number - 1} must have {len(head)} values as the first line, got {line}")
    if len(set(head)) < len(head):
        raise ValueError(f"{path} must name no column twice, got {head}")
    return dict(zip(head, zip(*lines[1:], strict=True), strict=True)) if lines[1:] else dict.fromkeys(head, ())


def _numbers(field: str, values: Any) -> Array:
    try:
        found = np.array(values, np.float64)
    except (TypeError, ValueError):
        found = np.array([_number(value) for value in values]) if np.ndim(values) == 1 else np.empty((0, 0))
    if found.ndim != 1:
        raise WrongTypeError(f"{field} must be a sequence of numbers, got {values!r}")
    if not np.all(np.isfinite(found)):
        k = int(np.argmin(np.isfinite(found)))
        raise ValueError(f"{field} must be finite numbers, got {values[k]} at sample {k}")
    return found


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return np.nan


def check(log: Log, motion: Trapezoid, sensors: Mapping[str, Sensor]) -> None:
    """Refuse a log in other units, off the sensor's rate, clipped, or without a blow.

    Raises:
        ValueError: names column, value, unit and what is allowed.
    """
    limits = {"force": (LARGEST_FORCE, "mN"), **dict.fromkeys(list(UNITS)[1:], (FASTEST * motion.speed, "mm/s"))}
    for name, values in log.columns.items():
        (limit, other), unit, rate = limits[name], UNITS[name], sensors[name].rate
        largest = float(np.abs(values).max())
        if largest > limit:
            raise ValueError(
                f"{log.name}, {name} must be below {limit:g} {unit}, got {largest:g} {unit}: is it in {other}?"
            )
        if rate is not None and not 0.99 < rate * log.step < 1.01:
            raise ValueError(
                f"{log.name}, time has a sample every {log.step:g} s, but Sensor.rate of {name} is {rate:g} Hz, one"
                f" every {1 / rate:g} s"
            )
        _refuse_clipped(log, name)
    if not any(_stands_out(values, sensors[name]) for name, values in log.columns.items()):
        raise ValueError(f"{log.name} has no blow: nothing in {', '.join(log.columns)} stands out of the noise")


def noise_of(values: Array, sensor: Sensor) -> float:
    """Return the noise of a column, as it is known or from what a smooth signal cannot be."""
    if sensor.noise is not None:
        return sensor.noise
    bends = np.abs(np.diff(values, 2)) / np.sqrt(6.0)
    return float(np.median(bends) / 0.6745)


def level(values: Array, sensor: Sensor) -> float:
    """Return what a column reads at rest: its bias, as it is known or guessed."""
    return float(np.median(values)) if sensor.bias == "estimated" else float(sensor.bias)


def bursts(values: Array, sensor: Sensor) -> list[tuple[int, int]]:
    """Return first and last sample of each time that a force stands out of the noise, and above a fifth of its peak."""
    rest = level(values, sensor)
    over = values - rest > max(CLEAR * noise_of(values, sensor), 0.2 * float((values - rest).max()))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], over, [0]])))
    return [(int(first), int(last) - 1) for first, last in zip(edges[::2], edges[1::2], strict=True)]


def _stands_out(values: Array, sensor: Sensor) -> bool:
    return float(np.ptp(values)) > 2.0 * CLEAR * max(noise_of(values, sensor), 1e-12)


def _refuse_clipped(log: Log, name: str) -> None:
    """Refuse a flat end of the range: equal values where the neighbours are further off than the resolution."""
    values = log.columns[name]
    apart = np.diff(np.unique(values))
    for end, side in ((values.max(), 1.0), (values.min(), -1.0)):
        flat = np.flatnonzero(np.diff(np.concatenate([[0], values == end, [0]])))
        for first, past in zip(flat[::2], flat[1::2], strict=True):
            beside = [side * (end - values[k]) for k in (first - 1, past) if 0 <= k < len(values)]
            if past - first >= FLAT and len(beside) == 2 and min(beside) > 3.0 * apart.min() and end != 0.0:
                raise ValueError(
                    f"{log.name}, {name} is saturated: it stays at {end:g} {UNITS[name]} from {log.time[first]:g} to"
                    f" {log.time[past - 1]:g} s; record the blow with a larger range"
                )
