"""Estimate numbers of a scene from logs of blows (collisions of tool and object).

A log is read and checked in `log`, and simulated through its `sensor` in `model`. `search` and `fit` find the best fit
and the confidence intervals, `result` puts them into words. `held_out` predicts logs that were not fitted.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import Any

from impact_gym.identification import log as logs_of
from impact_gym.identification.fit import fit_with_intervals
from impact_gym.identification.model import Model, free_coordinates
from impact_gym.identification.result import Identified
from impact_gym.identification.sensor import LoadCell, Sensor
from impact_gym.motion import Trapezoid
from impact_gym.scene import Scene
from impact_gym.support.dotted_paths import replaced
from impact_gym.support.validation import WrongTypeError, one_of, shown

__all__ = ["Identified", "LoadCell", "Sensor", "identify"]

FREE: tuple[str, ...] = ("contact.stiffness", "contact.restitution", "object.mass")


def identify(
    log: Any, scene: Scene, motion: Trapezoid | Sequence[Trapezoid], free: Iterable[str] = FREE,
    sensor: Sensor | Mapping[str, Sensor] | None = None,
) -> Identified:  # fmt: skip
    """Fit numbers of a scene to one or more measured blows.

    The fit minimizes the sum of ((simulated - measured) / noise)^2. Each log has its own unknown start, the time at
    which the motion begins. Intervals are from profile likelihoods: one number is moved away from its estimate, and all
    other numbers are fitted again. The interval ends where the sum has become significantly larger.

    Args:
        log: a mapping of columns, the path of a CSV file, or a list of mappings or paths. Columns are `time` (s) and
            at least one of `force` (N, of the contact), `flange_velocity`, `tool_velocity`, `object_velocity` (m/s),
            `tool_acceleration`, `object_acceleration` (m/s^2).
        scene: the known numbers, and a guess of each free number.
        motion: the imposed motion, or one motion for each log.
        free: names of the scene's numbers to fit.
        sensor: properties of the sensor; a mapping from columns to sensors if the logs have several columns. None: no
            filter, no bias, and the noise is estimated.

    Raises:
        TypeError, ValueError: an argument or a log is invalid; the fit does not reproduce a blow; a free number does
            not affect any log.
    """
    one_of("scene", scene, Scene)
    sources = list(log) if isinstance(log, (list, tuple)) else [log]
    coordinates = free_coordinates(scene, free)
    names = [f"log {k + 1}" for k in range(len(sources))] if len(sources) != 1 else ["log"]
    logs = [logs_of.read(source, name) for source, name in zip(sources, names, strict=True)]
    motions = motion_of_each(motion, logs)
    sensors = _by_column(sensor, [name for name in logs_of.UNITS if any(name in each.columns for each in logs)])
    lightest = {number.name: number.searched[0] for number in coordinates if number.name.endswith(".mass")}
    for each, imposed in zip(logs, motions, strict=True):
        logs_of.check(each, replaced(scene, lightest), imposed, sensors)
    model = Model(logs, scene, motions, sensors, coordinates)
    if model.size >= model.samples:
        unknown = f"{model.size} unknowns (start times and biases included)"
        raise ValueError(f"free: there must be more samples than unknowns, got {unknown}, but {model.samples} samples")
    return Identified.of(*fit_with_intervals(model))


def motion_of_each(motion: Trapezoid | Sequence[Trapezoid], logs: Sequence[logs_of.Log]) -> list[Trapezoid]:
    """Return the motion of each log; refuse a log that is given twice."""
    motions: list[Any] = list(motion) if isinstance(motion, (list, tuple)) else [motion] * len(logs)
    for imposed in motions:
        one_of("motion", imposed, Trapezoid)
    if not logs:
        raise ValueError("log must be a log, or a list of one or more, got an empty list")
    if len(motions) != len(logs):
        raise ValueError(f"motion must be one Trapezoid, or one for each of {len(logs)} logs, got {len(motions)}")
    for one, other in combinations(logs, 2):
        if [*map(bytes, one.columns.values())] == [*map(bytes, other.columns.values())]:
            raise ValueError(f"{other.name} has the same samples as {one.name}: give each log once")
    return motions


def _by_column(sensor: Sensor | Mapping[str, Sensor] | None, columns: Sequence[str]) -> dict[str, Sensor]:
    if isinstance(sensor, Sensor) and len(columns) > 1:
        raise ValueError(f"sensor must name its column, such as {{'{columns[0]}': Sensor(...)}}; logs have {columns}")
    if sensor is None or isinstance(sensor, Sensor):
        return dict.fromkeys(columns, sensor or Sensor())
    if not isinstance(sensor, Mapping):
        raise WrongTypeError(f"sensor must be a Sensor or a mapping from columns to Sensors, got {shown(sensor)}")
    for name, known in sensor.items():
        if name not in columns:
            raise ValueError(f"sensor: no log has a column {name!r}; there are {', '.join(columns)}")
        one_of(f"sensor: {name}", known, Sensor)
        if known.cell and name != "force":
            raise ValueError(f"sensor: {name} has a load cell, but only the column force may have one")
    return {name: sensor.get(name, Sensor()) for name in columns}
