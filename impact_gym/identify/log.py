"""A measured blow: reading it, and refusing what cannot be one, in one line that says where and what is allowed."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from impact_gym.identify.sensor import Array, Sensor, noise_of, runs
from impact_gym.motion import Trapezoid
from impact_gym.validation import WrongTypeError, numbers

UNITS = {"force": "N", "flange_velocity": "m/s", "tool_velocity": "m/s", "object_velocity": "m/s"}
"""Columns that a log may have beside `time` (s)."""
COLUMNS = ", ".join(f"{name} ({unit})" for name, unit in UNITS.items())

MIN_SAMPLES = 8
MAX_FORCE = 1e5  # N
MAX_SPEED_RATIO = 10.0  # of a velocity over the motion's speed
MAX_STEP = 0.05  # s between two samples
MAX_GAP = 1.5  # times the usual step
MIN_SWING = 10.0  # standard deviations of the noise, from the least to the largest sample of a blow
FLAT_SAMPLES = 3  # with the very same largest value, between much smaller ones: the sensor is saturated


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
            raise ValueError(f"{name} has an unknown column {column!r}; known are time (s), {COLUMNS}")
    if "time" not in source or len(source) < 2:
        raise ValueError(f"{name} must have a column time (s) and at least one of {COLUMNS}, got {list(source)}")
    columns = {column: _column(f"{name}, {column}", values) for column, values in source.items()}
    lengths = {column: len(values) for column, values in columns.items()}
    if len(set(lengths.values())) > 1 or min(lengths.values()) < MIN_SAMPLES:
        raise ValueError(f"{name} must have columns of one length, {MIN_SAMPLES} samples at least, got {lengths}")
    time = columns.pop("time")
    steps = np.diff(time)
    usual = float(np.median(steps))
    if np.any(steps <= 0.0):
        k = int(np.argmax(steps <= 0.0))
        raise ValueError(f"{name}, time must increase, but sample {k + 1} is at {time[k + 1]:g} s after {time[k]:g} s")
    if usual > MAX_STEP:
        raise ValueError(
            f"{name}, time must have at most {MAX_STEP:g} s between samples, got {usual:g} s: is it in ms, not in s?"
        )
    if steps.max() > MAX_GAP * usual:
        k = int(np.argmax(steps))
        raise ValueError(
            f"{name}, time must have no gaps, but {steps[k]:g} s lie between samples {k} and {k + 1}, at {time[k]:g} s"
            f", where the usual step is {usual:g} s"
        )
    return Log(name, time, columns)


def _column(field: str, values: Any) -> Array:
    unit = UNITS.get(field.rpartition(" ")[2], "s")
    return np.array(numbers(field, values.tolist() if hasattr(values, "tolist") else values, unit))


def _table(path: Path) -> dict[str, list[float]]:
    try:
        with path.open(newline="") as file:
            lines = [line for line in csv.reader(file) if line]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path} is not read as CSV: {error}") from error
    if not lines:
        raise ValueError(f"{path} is empty; its first line must name the columns: time, and any of {COLUMNS}")
    table: dict[str, list[float]] = {name.strip(): [] for name in lines[0]}
    if len(table) < len(lines[0]):
        raise ValueError(f"{path} must name no column twice, got {lines[0]}")
    for sample, line in enumerate(lines[1:]):
        if len(line) != len(table):
            raise ValueError(f"{path}, sample {sample} must have {len(table)} values as the first line, got {line}")
        for (name, values), text in zip(table.items(), line, strict=True):
            try:
                values.append(float(text))
            except ValueError:
                raise ValueError(f"{path}, {name} must be numbers, got {text} at sample {sample}") from None
    return table


def check(log: Log, motion: Trapezoid, sensors: Mapping[str, Sensor]) -> None:
    """Refuse a log in other units, off the sensor's rate, clipped, or without a blow.

    Raises:
        ValueError: names column, value, unit and what is allowed.
    """
    for name, values in log.columns.items():
        limit, other = (MAX_FORCE, "mN") if name == "force" else (MAX_SPEED_RATIO * motion.speed, "mm/s")
        largest, unit, rate = float(np.abs(values).max()), UNITS[name], sensors[name].rate
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
    noise = {name: max(noise_of(values, sensors[name]), 1e-12) for name, values in log.columns.items()}
    if not any(float(np.ptp(values)) > MIN_SWING * noise[name] for name, values in log.columns.items()):
        raise ValueError(f"{log.name} has no blow: nothing in {', '.join(log.columns)} stands out of the noise")


def _refuse_clipped(log: Log, name: str) -> None:
    """Refuse a flat end of the range: equal values where the neighbours are further off than the resolution."""
    values = log.columns[name]
    resolution = np.diff(np.unique(values))
    for end, side in ((values.max(), 1.0), (values.min(), -1.0)):
        for first, last in runs(values == end):
            beside = [side * (end - values[k]) for k in (first - 1, last + 1) if 0 <= k < len(values)]
            flat = last - first + 1 >= FLAT_SAMPLES and len(beside) == 2 and min(beside) > 3.0 * resolution.min()
            if flat and end != 0.0:
                raise ValueError(
                    f"{log.name}, {name} is saturated: it stays at {end:g} {UNITS[name]} from {log.time[first]:g} to"
                    f" {log.time[last]:g} s; record the blow with a larger range"
                )
