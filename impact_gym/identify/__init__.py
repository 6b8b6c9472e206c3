"""From a measured blow to the numbers of a scene, and how sure they are: `impact_gym.identify(log, scene, motion)`.

    `log`          reading and checking what was measured
    `sensor`       what a sensor makes of a signal
    `coordinates`  free numbers, on the scales they are fitted on
    `model`        residuals by our simulator, and their derivatives
    `starts`       where a fit begins
    `descent`      least squares, and which of several starts go on
    `fit`          the best fit, and profile likelihoods
    `words`        what the log cannot tell
    `result`       what comes of it, and its picture

`impact_gym.identify` is the function; this package is found by `from impact_gym.identify import ...` all the same.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from impact_gym.identify import log as logs_of
from impact_gym.identify.coordinates import free_coordinates
from impact_gym.identify.fit import Fit, intervals, uncertain, vague
from impact_gym.identify.model import Model
from impact_gym.identify.result import Identified, more_blows
from impact_gym.identify.sensor import Sensor
from impact_gym.identify.words import indistinguishable
from impact_gym.motion import Trapezoid
from impact_gym.scene import Scene
from impact_gym.validation import WrongTypeError, one_of

__all__ = ["Identified", "Sensor", "identify"]

FREE = ("contact.stiffness", "contact.restitution", "object.mass")


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
        scene: what is known; of the free numbers, a guess, which hardly matters.
        motion: imposed motion, or one for each log.
        free: names of numbers of the scene, or these with a range (low, high) that is known for sure.
        sensor: what is known of the sensor; by column, where the logs have more than one. None: no filter, no bias,
            noise estimated.

    Raises:
        TypeError, ValueError: an argument is none of these or out of range; a log is no blow, or several; the log does
            not depend on a free number. One line names it, the value, the unit and what is allowed.
    """
    one_of("scene", scene, Scene)
    given = list(log) if isinstance(log, (list, tuple)) else [log]
    motions: list[Any] = list(motion) if isinstance(motion, (list, tuple)) else [motion] * len(given)
    for one in motions:
        one_of("motion", one, Trapezoid)
    if not given or len(motions) != len(given):
        raise ValueError(f"motion must be one Trapezoid, or one for each of {len(given)} logs, got {len(motions)}")
    found = free_coordinates(scene, free)
    read = [logs_of.read(one, f"log {k + 1}" if len(given) > 1 else "log") for k, one in enumerate(given)]
    sensors = _by_column(sensor, [name for name in logs_of.UNITS if any(name in one.columns for one in read)])
    for one, its_motion in zip(read, motions, strict=True):
        logs_of.check(one, its_motion, sensors)
    model = Model.of(read, scene, motions, sensors, found)
    fit = Fit.of(model)
    if twice := bool(more_blows(fit) or vague(fit)):
        fit = fit.again()
    if sentence := more_blows(fit):
        raise ValueError(sentence)
    fit, pairs = intervals(fit)
    if not twice and uncertain(fit, pairs) and (other := fit.again()) is not fit:
        fit, pairs = intervals(other)
    k = len(found)
    deviations = np.sqrt(np.diag(fit.covariance))[:k]
    correlation = fit.covariance[:k, :k] / np.outer(deviations, deviations)
    estimate = model.numbers(fit.x)
    interval = {}
    for one, pair in zip(found, pairs, strict=True):
        low, high = sorted(one.end(u, side) for u, side in zip(pair, (-1, 1), strict=True))
        interval[one.name] = (low, high)
    said = indistinguishable(fit, interval, correlation)
    return Identified(estimate, interval, correlation, model.scene_at(fit.x), said, fit)


def _by_column(sensor: Sensor | Mapping[str, Sensor] | None, columns: Sequence[str]) -> dict[str, Sensor]:
    if sensor is None:
        return dict.fromkeys(columns, Sensor())
    if isinstance(sensor, Sensor):
        if len(columns) > 1:
            raise ValueError(f"sensor must say which column it is of, {{'{columns[0]}': Sensor(...)}}; got {columns}")
        return {columns[0]: sensor}
    if not isinstance(sensor, Mapping):
        raise WrongTypeError(f"sensor must be a Sensor or a mapping from columns to them, got {sensor!r}")
    for name, one in sensor.items():
        if name not in columns:
            raise ValueError(f"sensor: no log has a column {name!r}; there are {', '.join(columns)}")
        one_of(f"sensor: {name}", one, Sensor)
    return {name: sensor.get(name, Sensor()) for name in columns}
