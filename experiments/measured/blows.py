"""Logs of measured blows: numbers of the scene fitted on half of them, the other half predicted, by several models.

A log has the columns of `impact_gym.identify`. All that is compared is read off the samples, of the log and of what the
model's sensors would have recorded, in the same way. Then the halves change places, so that each blow is predicted.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from impact_gym.fidelity import fixed_tool, rigid_robot
from impact_gym.identify import Identified, Sensor, identify
from impact_gym.identify.__main__ import parse
from impact_gym.identify.log import Log, read
from impact_gym.identify.model import Model
from impact_gym.identify.search import descend, start_at
from impact_gym.identify.sensor import level, runs
from impact_gym.motion import Trapezoid
from impact_gym.scene import Scene
from impact_gym.validation import numbers

FEWEST = 4  # blows
SUFFICES = 1.2  # times the least error: a simpler model suffices up to here
MEASURES = {
    "object_velocity": "post-impact velocity", "peak_force": "peak force", "duration": "duration", "impulse": "impulse",
}  # fmt: skip
HALF = 0.5  # of the peak, above which a blow's duration is counted
END = 0.25  # of a log, its last samples: the velocity after the blow

AS_IT_IS = "as it is"
MODELS: Mapping[str, Callable[[Scene], Scene]] = {
    "tool fixed to a rigid flange": lambda scene: fixed_tool(rigid_robot(scene)),
    "robot rigid": rigid_robot,
    AS_IT_IS: lambda scene: scene,
    "as it is, damping independent of the speed": lambda scene: replace(
        scene, contact=replace(scene.contact, dissipation="fixed")
    ),
}
"""From the simplest on; what a scene has not cannot be taken from it."""


@dataclass(frozen=True)
class Blows:
    """Logs, and what is known of them."""

    logs: Sequence[Log]
    scene: Scene
    motions: Sequence[Trapezoid]  # one for each
    sensors: Mapping[str, Sensor]
    free: Sequence[str]

    def part(self, rows: slice) -> "Blows":
        """Return some of them."""
        return replace(self, logs=self.logs[rows], motions=self.motions[rows])


def read_blows(paths: Sequence[Path], content: Mapping[str, Any], free: Sequence[str]) -> Blows:
    """Return the blows of CSV files, one each, or of HDF5 files, of which every group is one.

    Args:
        paths: of the files.
        content: tables of the scene, as for `impact-gym identify`; `motion.speed` may be a list, one for each blow.
        free: names of the numbers to fit.

    Raises:
        ValueError: a file is no log, or there are too few; names it.
    """
    logs = [log for path in paths for log in _logs(path)]
    if len(logs) < FEWEST:
        raise ValueError(f"{FEWEST} logs of blows or more are needed, half of them to fit, got {len(logs)}")
    scene, motion, sensors = parse({**content, "motion": {**content.get("motion", {}), "speed": 1.0}}, free)
    speed = content.get("motion", {}).get("speed")
    speeds = numbers("motion.speed", speed, "m/s", above=0.0) if isinstance(speed, list) else [speed] * len(logs)
    if len(speeds) != len(logs):
        raise ValueError(f"motion.speed must be one number or one for each of {len(logs)} logs, in m/s, got {speed!r}")
    return Blows(logs, scene, [replace(motion, speed=each) for each in speeds], sensors, free)


def _logs(path: Path) -> Iterator[Log]:
    """Yield the logs of a file."""
    if path.suffix not in (".h5", ".hdf5"):
        yield read(path, str(path))
        return
    try:
        import h5py
    except ImportError:
        raise ValueError(f"{path} is read with h5py: pip install h5py") from None
    try:
        with h5py.File(path) as file:
            groups = {name: each for name, each in file.items() if hasattr(each, "items")} or {"": file}
            tables = {name: {key: column[()] for key, column in each.items()} for name, each in groups.items()}
    except (OSError, TypeError) as problem:
        raise ValueError(f"{path} is not read as HDF5: {problem}") from None
    for name, table in tables.items():
        yield read(table, f"{path}, {name}" if name else str(path))


def models(blows: Blows) -> dict[str, Blows]:
    """Return the same blows with each model of the scene, from the simplest on."""
    scenes = {name: changed(blows.scene) for name, changed in MODELS.items()}
    kept = [name for name, scene in scenes.items() if name == AS_IT_IS or scene != blows.scene]
    return {name: replace(blows, scene=scenes[name]) for name in kept}


def predicted(blows: Blows) -> tuple[dict[str, NDArray[np.float64]], list[Identified]]:
    """Return what was measured and predicted, by measure, and the fits of both halves.

    Each measure has columns (blows, 4): measured, predicted without having been fitted, and the ends of the 95 %
    interval: that of one blow more, from how far those that were fitted are off; nan where there is no such column.
    """
    table = {measure: np.full((len(blows.logs), 4), np.nan) for measure in MEASURES}
    fits = []
    for begin in (0, 1):
        fitted, held = blows.part(slice(begin, None, 2)), blows.part(slice(1 - begin, None, 2))
        fit = identify([{**log.columns, "time": log.time} for log in fitted.logs], blows.scene, list(fitted.motions),
                       blows.free, blows.sensors or None)  # fmt: skip
        seen, there = _sensed(fitted, fit), _sensed(held, fit)
        for measure, rows in table.items():
            ratio = np.array([each[measure][0] / each[measure][1] for each in seen])
            wide = student.ppf(0.975, len(ratio) - 1) * np.std(ratio, ddof=1) * np.sqrt(1.0 + 1.0 / len(ratio))
            values = np.array([each[measure] for each in there])
            ends = values[:, 1:] * (np.mean(ratio) + wide * np.array([-1.0, 1.0]))
            rows[1 - begin :: 2] = np.column_stack([values, ends])
        fits.append(fit)
    return table, fits


def _sensed(blows: Blows, fit: Identified) -> list[dict[str, tuple[float, float]]]:
    """Return each blow's measures, of the log and of a fitted scene, of which the start alone is fitted."""
    found = []
    for log, motion in zip(blows.logs, blows.motions, strict=True):
        model = Model.of([log], fit.scene, [motion], fit.fit.model.sensors, [])
        x = descend(model, start_at(model, np.empty(0), 0.5).x).x
        made = model.predicted(x)[0] + model.biases(x)
        columns = {name: made[slot] for (_, name), slot in model.slots.items()}
        both = [_measures(Log(log.name, log.time, each), model.sensors) for each in (log.columns, columns)]
        found.append({measure: (both[0][measure], both[1][measure]) for measure in MEASURES})
    return found


def _measures(log: Log, sensors: Mapping[str, Sensor]) -> dict[str, float]:
    """Return what is read off a log; nan where it lacks the column."""
    found = dict.fromkeys(MEASURES, np.nan)
    if "object_velocity" in log.columns:
        last = log.columns["object_velocity"][-max(int(END * len(log.time)), 1) :]
        found["object_velocity"] = float(np.mean(last))
    if "force" in log.columns:
        force = log.columns["force"] - level(log.columns["force"], sensors["force"])
        found["peak_force"], found["impulse"] = float(force.max()), float(log.step * force.sum())
        found["duration"] = _width(force) * log.step
    return found


def _width(force: NDArray[np.float64]) -> float:
    """Return how many samples lie between the places where a blow passes HALF of its peak, linear between samples."""
    high, padded = HALF * force.max(), np.concatenate([[0.0], force, [0.0]])
    first, last = next(run for run in runs(padded > high) if run[0] <= padded.argmax() <= run[1])
    inside = [(padded[a] - high) / (padded[a] - padded[b]) for a, b in ((first, first - 1), (last, last + 1))]
    return float(last - first + sum(inside))


def errors(table: Mapping[str, NDArray[np.float64]]) -> dict[str, tuple[float, float, float]]:
    """Return the median and the 95 % relative error of each measure that there is, and the share in its interval."""
    found = {}
    for measure, rows in table.items():
        measured, made, low, high = rows.T
        if np.isfinite(measured).any():
            off = np.abs(made / measured - 1.0)
            inside = (low <= measured) & (measured <= high)
            found[measure] = float(np.median(off)), float(np.quantile(off, 0.95)), float(np.mean(inside))
    return found


def sufficient(found: Mapping[str, Mapping[str, tuple[float, float, float]]]) -> str:
    """Return the simplest model whose median error is in no measure above SUFFICES times the least of all models."""
    least = {measure: min(of[measure][0] for of in found.values()) for measure in next(iter(found.values()))}
    good = [name for name, of in found.items() if all(of[m][0] <= SUFFICES * least[m] for m in least)]
    return good[0] if good else min(found, key=lambda name: max(found[name][m][0] / least[m] for m in least))
