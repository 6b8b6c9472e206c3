"""Read the log of a measured blow, and refuse an invalid log."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.identification.sensor import Array, Sensor, bursts, level, noise_of, runs
from impact_gym.motion import Trapezoid
from impact_gym.scene import Robot, Scene
from impact_gym.support.column_names import Column, unit_hint
from impact_gym.support.csv_files import read_columns
from impact_gym.support.validation import WrongTypeError, numbers, shown

TIME = Column("s", r"((rel|relative|elapsed) )?(time ?stamp|time)s?|t|zeit|x value")
READ = {
    "force": Column("N", r"((contact|impact|normal|tool|hammer|wrench) )*(force|kraft)( ?[xyz])?|f ?[nxyz]?|load"),
    "flange_velocity": Column("m/s", r"flange (velocity|speed|vel)"),
    "tool_velocity": Column("m/s", r"(tool|hammer|tcp) (velocity|speed|vel)"),
    "object_velocity": Column("m/s", r"(object|target) (velocity|speed|vel)"),
    "tool_acceleration": Column("m/s^2", r"(tool|hammer) (acceleration|accel|acc)", needs_unit=True),
    "object_acceleration": Column("m/s^2", r"(object|target) (acceleration|accel|acc)", needs_unit=True),
}
"""Columns that a log may have in addition to `time` (s), with patterns of their names in files."""
UNITS = {name: column.unit for name, column in READ.items()}
COLUMNS = ", ".join(f"{name} ({unit})" for name, unit in UNITS.items())

MIN_SAMPLES = 8
MAX_FORCE = 1e5  # N, largest absolute force in a log
MAX_ACCELERATION = 1e6  # m/s^2, largest absolute acceleration in a log
MAX_SPEED_RATIO = 10.0  # largest ratio of an absolute velocity in a log to the speed of the imposed motion
MAX_STEP = 0.05  # s, largest median time between successive samples
MAX_GAP = 1.5  # if a step exceeds this many median steps, samples were lost or one sample was late, see `Log.lost`
MAX_LOST = 3  # largest number of samples lost in three successive steps
MIN_SWING = 10.0  # in a blow, max - min of at least one column exceeds this many standard deviations of its noise
PUSHED = "force", "object_velocity", "flange_velocity"  # columns that are positive in a blow
LEAST_IMPULSE = 0.03  # least ratio of measured impulse to the impulse of a plastic impact, see `_refuse_other_force`
FLAT_SAMPLES = 3  # a saturated column stays at its largest or least value for at least this number of samples


@dataclass(frozen=True, eq=False)
class Log:
    """The recorded samples of one blow."""

    name: str
    time: Array  # (n,), s
    columns: Mapping[str, Array]  # each (n,), in the units that UNITS lists
    said: str = ""  # sentence on how the file was read; "": the samples are not from a file

    @property
    def lost(self) -> NDArray[np.int64]:
        """Number of samples lost between each sample and the next one, (n - 1,)."""
        steps = np.diff(self.time)
        usual = float(np.median(steps))
        padded = np.concatenate([[usual], steps, [usual]])
        three = padded[:-2] + steps + padded[2:]  # sum of three steps; a late sample between them does not change it
        return np.where(steps > MAX_GAP * usual, np.maximum(np.rint(three / usual) - 3, 0), 0).astype(np.int64)

    @property
    def step(self) -> float:
        """Mean time between two samples, s; lost samples count as samples."""
        return float(self.time[-1] - self.time[0]) / float(len(self.time) - 1 + self.lost.sum())


def read(source: Any, name: str) -> Log:
    """Return a log from a mapping of columns, a CSV file (see `impact_gym.support.csv_files`), or a `Log`."""
    if isinstance(source, Log):
        return source
    said = ""
    if isinstance(source, (str, PathLike)):
        name, (source, said) = str(source), read_columns(Path(source), {"time": TIME, **READ}, ("time", "force"))
    if not isinstance(source, Mapping):
        raise WrongTypeError(f"{name} must be a mapping of columns or the path of a CSV file, got {shown(source)}")
    if "time" not in source or len(source) < 2:
        raise ValueError(f"{name} must have a column time (s) and at least one of {COLUMNS}, got {list(source)}")
    columns = dict[str, Array]()
    for column, values in source.items():
        if column not in ("time", *UNITS):
            raise ValueError(f"{name} has an unknown column {column!r}; known are time (s), {COLUMNS}")
        columns[column] = np.array(numbers(f"{name}, {column}", values, UNITS.get(column, "s")))
    lengths = {column: len(values) for column, values in columns.items()}
    if len(set(lengths.values())) > 1 or min(lengths.values()) < MIN_SAMPLES:
        raise ValueError(f"{name} must have columns of one length, {MIN_SAMPLES} samples at least, got {lengths}")
    time = columns.pop("time")
    for k in np.flatnonzero(np.diff(time) <= 0.0).tolist():
        one, other = (round(t, 9) for t in time[k : k + 2].tolist())
        raise ValueError(f"{name}, time must increase, got {one} s and then {other} s at sample {k + 1}")
    if (usual := float(np.median(np.diff(time)))) > MAX_STEP:
        raise ValueError(f"{name}, time must have steps of at most {MAX_STEP:g} s, got {usual:g} s"
                         + unit_hint(usual, MAX_STEP, begin=time[0]))  # fmt: skip
    log = Log(name, time, columns)
    if log.lost.max() > MAX_LOST:
        k = int(np.argmax(log.lost))
        raise ValueError(f"{name}, time must have at most {MAX_LOST} samples lost in three steps, got {log.lost[k]} at "
                         f"samples {k}, {k + 1}, at {round(float(time[k]), 9)} s; a step is {usual:g} s")  # fmt: skip
    if said:
        rate, count = 1.0 / log.step, int(log.lost.sum())
        shown_rate = f"{rate / 1e3:.4g} kHz" if rate >= 1e3 else f"{rate:.4g} Hz"
        said = f"read {len(time):,} samples at {shown_rate} from {name}: {said}"
        said += f"; {count} sample{'s' * (count > 1)} lost" if count else ""
    return replace(log, said=said)


def check(log: Log, scene: Scene, motion: Trapezoid, sensors: Mapping[str, Sensor]) -> None:
    """Raise ValueError if a log cannot be a blow in `scene`, in which each free mass has its least searched value."""
    noise = {name: max(noise_of(values, sensors[name]), 1e-12) for name, values in log.columns.items()}
    for name, values in log.columns.items():
        what = f"{log.name}, {name}"
        limits = {"N": (MAX_FORCE, "mN"), "m/s": (MAX_SPEED_RATIO * motion.speed, "mm/s")}
        limit, other = limits.get(UNITS[name], (MAX_ACCELERATION, "mm/s^2"))
        largest, unit, rate = float(np.abs(values).max()), UNITS[name], sensors[name].rate
        if largest > limit:
            raise ValueError(f"{what} must be at most {limit:g} {unit}, got {largest:g} {unit}: is it in {other}?")
        if largest == 0.0:
            raise ValueError(f"{what} must not be 0 {unit} in all {len(values)} samples: leave the column out")
        if rate is not None and not 0.99 < rate * log.step < 1.01:
            raise ValueError(f"{what} has {1 / log.step:g} samples per s, but Sensor.rate of {name} is {rate:g} Hz")
        _refuse_clipped(log, name)
        least, most = np.array([values.min(), values.max()]) - level(values, sensors[name])
        if name in PUSHED and sensors[name].bias != "estimated" and -least > max(most, MIN_SWING / 2.0 * noise[name]):
            raise ValueError(f"{what} must be above 0 {unit} in a blow, got {least:g} {unit}: is its sign reversed?")
    if not any(float(np.ptp(values)) > MIN_SWING * noise[name] for name, values in log.columns.items()):
        raise ValueError(f"{log.name} has no blow: no column of {', '.join(log.columns)} rises above the noise")
    if "force" in log.columns:
        _refuse_other_force(log, scene, motion, sensors["force"])


def tool_mass(scene: Scene) -> float:
    """Return the mass (kg) of the tool; a rigid coupling adds the robot (inf if that is rigid or a `RobotTable`)."""
    behind = scene.robot.mass if isinstance(scene.robot, Robot) else math.inf
    return scene.tool.mass + (behind if scene.coupling.fixed else 0.0)


def _refuse_other_force(log: Log, scene: Scene, motion: Trapezoid, sensor: Sensor) -> None:
    force = log.columns["force"] - level(log.columns["force"], sensor)
    speed = min(motion.speed, math.sqrt(2.0 * motion.acceleration * scene.object.distance))
    usual = speed / (1.0 / tool_mass(scene) + 1.0 / scene.object.mass)
    blows = bursts(log.columns["force"], sensor)
    impulse = log.step * sum(float(force[first : last + 1].sum()) for first, last in blows)
    if 0.0 < impulse < LEAST_IMPULSE * usual:
        raise ValueError(f"{log.name}, force must have an impulse of at least {LEAST_IMPULSE * usual:.3g} N s (a tool "
                         f"of {scene.tool.mass:g} kg and an object of {scene.object.mass:g} kg have about {usual:.3g} "
                         f"N s at {speed:g} m/s), got {impulse:.3g} N s: is it in kN? If not, is object.mass or "
                         "tool.mass smaller?")  # fmt: skip


def _refuse_clipped(log: Log, name: str) -> None:
    """Raise ValueError if a column is saturated: it jumps to an extreme other than 0, stays there, and jumps back."""
    values = log.columns[name]
    resolution = np.diff(np.unique(values))
    for end, side in ((values.max(), 1.0), (values.min(), -1.0)):
        for first, last in runs(values == end):
            beside = [side * (end - values[k]) for k in (first - 1, last + 1) if 0 <= k < len(values)]
            flat = last - first + 1 >= FLAT_SAMPLES and len(beside) == 2 and min(beside) > 3.0 * resolution.min()
            if flat and end != 0.0:
                one, other = (round(t, 9) for t in log.time[[first, last]].tolist())
                raise ValueError(f"{log.name}, {name} is saturated: it stays at {end:g} {UNITS[name]} from {one} "
                                 f"to {other} s; record the blow with a larger range of the sensor")  # fmt: skip
