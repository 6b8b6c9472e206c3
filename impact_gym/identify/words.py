"""What a log cannot tell, said in words, with the reason where one can be seen."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from impact_gym.identify.coordinates import RESTITUTION
from impact_gym.identify.fit import Fit
from impact_gym.identify.log import bursts
from impact_gym.scene import Rigid
from impact_gym.simulation import simulate

WIDE = 2.0  # high over low of an interval that says little
WIDE_RESTITUTION = 0.3  # high less low
TOGETHER = 0.95  # correlation of two numbers, one of them wide, that are not told apart
FEW = 4  # samples in a blow, too few to see its shape
HEAVY = 5.0  # times the tool, of an object whose mass the force hardly shows


def unit_of(scene: Any, name: str) -> str:
    """Return the unit of a number of a scene."""
    part, *_, field = name.split(".")
    record = getattr(scene, part)
    if name == "contact.stiffness":
        return f"N/m^{record.stiffness_exponent:g}"
    return str(record._checks[field][1].unit)


def indistinguishable(fit: Fit, interval: Mapping[str, tuple[float, float]], correlation: Any) -> tuple[str, ...]:
    """Return a sentence for each number, and each pair of them, that the logs do not tell."""
    names = list(interval)
    wide = {name: _is_wide(name, *interval[name]) for name in names}
    if not any(wide.values()):
        return ()
    reasons = list(_reasons(fit))
    because = f", because {' and '.join(reasons)}" if reasons else ""
    said = [_sentence(fit.model.scene, name, *interval[name]) + because for name in names if wide[name]]
    for i, first in enumerate(names):
        for j, second in enumerate(names[:i]):
            if abs(correlation[i, j]) > TOGETHER and (wide[first] or wide[second]):
                other = "larger" if correlation[i, j] > 0 else "smaller"
                said.append(
                    f"the log does not tell {second} and {first} apart: a larger one with a {other} other fits as well"
                    f" (correlation {correlation[i, j]:.3f})"
                )
    return tuple(said)


def _is_wide(name: str, low: float, high: float) -> bool:
    if name == RESTITUTION:
        return high - low > WIDE_RESTITUTION
    least, most = sorted((abs(low), abs(high)))
    return most > WIDE * least


def _sentence(scene: Any, name: str, low: float, high: float) -> str:
    unit = unit_of(scene, name).replace("(no unit)", "")
    nothing_above = high == (1.0 if name == RESTITUTION else np.inf)
    if low == 0.0 and nothing_above:
        return f"the log does not tell {name} at all: any value fits as well"
    if nothing_above:
        return f"the log does not tell {name}: any value above {low:.3g} {unit}".rstrip() + " fits as well"
    if low == 0.0:
        return f"the log does not tell {name}: any value below {high:.3g} {unit}".rstrip() + " fits as well"
    return f"the log hardly tells {name}: it lies between {low:.3g} and {high:.3g} {unit}".rstrip()


def _reasons(fit: Fit) -> Iterator[str]:
    """Yield what about the sensor or the scene hides a blow."""
    model = fit.model
    scene = model.scene_at(fit.x)
    blows, seen = [], [(0, 0.0)]
    for k, log in enumerate(model.logs):
        until = float(log.time[-1]) - fit.x[len(model.free) + k]
        for one in simulate(scene, model.motions[k], max(until, log.step)).contacts[:1]:
            blows.append((until if one.end is None else one.end) - one.start)
        if "force" in log.columns and model.sensors["force"].low_pass is None:
            lengths = [last - first + 1 for first, last in bursts(log.columns["force"], model.sensors["force"])]
            seen.append((max(lengths, default=0), log.step))
    samples, step = max(seen)
    if 0 < samples < FEW:
        yield f"no more than {samples} samples, {1e3 * step:.3g} ms apart, lie in the blow"
    lags = [1.0 / (2.0 * np.pi * one.low_pass) for one in model.sensors.values() if one.low_pass is not None]
    if blows and len(lags) == len(model.sensors) and min(lags) > max(blows):
        yield f"the filter takes {1e3 * min(lags):.2g} ms and the blow lasts {1e3 * max(blows):.2g} ms"
    heavy = scene.object.mass > HEAVY * scene.tool.mass and not isinstance(scene.coupling, Rigid)
    if heavy and set(model.sensors) == {"force"} and any(one.name == "object.mass" for one in model.free):
        yield "an object much heavier than the tool is to the force as good as a wall"
