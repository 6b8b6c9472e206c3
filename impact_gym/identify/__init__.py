"""From a measured blow to the numbers of a scene, and how sure they are: `impact_gym.identify(log, scene, motion)`.

    `log`, `sensor`   reading and checking what was measured; what a sensor makes of a signal
    `coordinates`     free numbers, on the scales they are fitted on
    `model`           residuals by our simulator, and their derivatives
    `search`, `fit`   from several starts to the best fit; profile likelihoods
    `result`          estimates, intervals, what the log cannot tell
    `held_out`        half of the logs predicts the other half

`impact_gym.identify` is the function; this package is found by `from impact_gym.identify import ...` all the same.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from impact_gym.identify import log as logs_of
from impact_gym.identify.coordinates import free_coordinates
from impact_gym.identify.fit import fit_with_intervals
from impact_gym.identify.model import Model
from impact_gym.identify.result import Identified
from impact_gym.identify.sensor import LoadCell, Sensor
from impact_gym.motion import Trapezoid
from impact_gym.scene import Scene
from impact_gym.validation import WrongTypeError, one_of, shown

__all__ = ["Identified", "LoadCell", "Sensor", "identify"]

FREE: tuple[str, ...] = ("contact.stiffness", "contact.restitution", "object.mass")


def identify(
    log: Any, scene: Scene, motion: Trapezoid | Sequence[Trapezoid], free: Iterable[str] | Mapping[str, Any] = FREE,
    sensor: Sensor | Mapping[str, Sensor] | None = None,
) -> Identified:  # fmt: skip
    """Fit numbers of a scene to a measured blow, or to several that have these numbers in common.

    Least squares on `simulate`; each log has its own unknown start, the instant at which the motion begins. Intervals
    are profile likelihoods: how far a number may move, all else fitted anew, before the misfit grows beyond noise.

    Args:
        log: mapping of columns or path of a CSV file, or a list of such: `time` (s) and any of `force` (N, of the
            contact), `flange_velocity`, `tool_velocity`, `object_velocity` (m/s). It may begin and end anywhere about
            the blow.
        scene: what is known; of the free numbers, a guess: the search also begins from what the blow's
            impulse and width say.
        motion: imposed motion, or one for each log.
        free: names of numbers of the scene, or these with a range (low, high) that is known for sure.
        sensor: what is known of the sensor; by column, where the logs have more than one. None: no filter, no bias,
            noise estimated.

    Raises:
        TypeError, ValueError: an argument is none of these or out of range; a log is no blow, or several; the log does
            not depend on a free number. One line names it, the value, the unit and what is allowed.
    """
    one_of("scene", scene, Scene)
    sources = list(log) if isinstance(log, (list, tuple)) else [log]
    motions: list[Any] = list(motion) if isinstance(motion, (list, tuple)) else [motion] * len(sources)
    for imposed in motions:
        one_of("motion", imposed, Trapezoid)
    if not sources or len(motions) != len(sources):
        raise ValueError(f"motion must be one Trapezoid, or one for each of {len(sources)} logs, got {len(motions)}")
    coordinates = free_coordinates(scene, free)
    names = [f"log {k + 1}" for k in range(len(sources))] if len(sources) > 1 else ["log"]
    logs = [logs_of.read(source, name) for source, name in zip(sources, names, strict=True)]
    sensors = _by_column(sensor, [name for name in logs_of.UNITS if any(name in each.columns for each in logs)])
    for each, imposed in zip(logs, motions, strict=True):
        logs_of.check(each, scene, imposed, sensors, coordinates)
    model = Model.of(logs, scene, motions, sensors, coordinates)
    if model.size >= model.samples:
        unknown = f"{model.size} unknowns with starts and biases"
        raise ValueError(f"free must leave more samples than unknowns, got {unknown}, but {model.samples} samples")
    return Identified.of(*fit_with_intervals(model))


def _by_column(sensor: Sensor | Mapping[str, Sensor] | None, columns: Sequence[str]) -> dict[str, Sensor]:
    if sensor is None:
        return dict.fromkeys(columns, Sensor())
    if isinstance(sensor, Sensor):
        if len(columns) > 1:
            raise ValueError(f"sensor must say which column it is of, {{'{columns[0]}': Sensor(...)}}; got {columns}")
        return {columns[0]: sensor}
    if not isinstance(sensor, Mapping):
        raise WrongTypeError(f"sensor must be a Sensor or a mapping from columns to them, got {shown(sensor)}")
    for name, known in sensor.items():
        if name not in columns:
            raise ValueError(f"sensor: no log has a column {name!r}; there are {', '.join(columns)}")
        one_of(f"sensor: {name}", known, Sensor)
        if known.cell and name != "force":
            raise ValueError(f"sensor: {name} has a load cell, which a force alone may have")
    return {name: sensor.get(name, Sensor()) for name in columns}
