"""The numbers of an observation (rows of `impact_gym.quantities`), their order and scales."""

import math
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.kernels import ENTRY, EPISODE, LINEAR, LOGARITHM, LOGARITHM_OF_ONE_MORE
from impact_gym.pack import indices
from impact_gym.quantities import QUANTITIES, Quantity, Scale
from impact_gym.task.task import Task

Floats = NDArray[np.float64]


class Curve(NamedTuple):
    """A function applied to a number before scaling."""

    code: int  # number of the function in `observation.pxi`
    at: Callable[[float], float]  # the function for one number, as the compiled program computes it
    of: Callable[[Any], Any]  # the function for arrays
    inverse: Callable[[Any], Any]


CURVES = {
    "linear": Curve(LINEAR, float, lambda values: values, lambda values: values),
    "log": Curve(LOGARITHM, math.log, np.log, np.exp),
    "log1p": Curve(LOGARITHM_OF_ONE_MORE, math.log1p, np.log1p, np.expm1),
}

_PLACES = indices(EPISODE)


class ObservationSpec:
    """The numbers of an observation, their order, and their conversion to SI units and back.

    `ids` and the rows `entries` are in the order of the observation: first the numbers for an actor (slice `actor`),
    then the true values that `privileged` appends. A critic gets all numbers (slice `critic`). `sensors` has the keys
    of the environment's `sensors()`: "time", then the actor's other numbers except past readings and time weight.
    """

    def __init__(self, task: Task, drawn: Iterable[str] | None = None) -> None:
        """Specify the observation of `task`. A critic also observes the ids `drawn`, by default `task.drawn`."""
        critic = {*(task.drawn if drawn is None else drawn)}
        entries = filter(None, (_entry(row, task, critic) for row in QUANTITIES.values()))
        self.entries = tuple(sorted(entries, key=lambda entry: entry.observed == "privileged"))
        self.ids = tuple(entry.id for entry in self.entries)
        seen = [row for row in self.entries if row.observed != "privileged"]
        self.actor, self.critic = slice(0, len(seen)), slice(0, len(self.entries))
        self.scaled_low = np.array([entry.scale.scaled_low for entry in self.entries], np.float32)
        self._index = {name: index for index, name in enumerate(self.ids)}
        known = [row.id for row in seen if row.observed != "past_readings" and row.id != "time_weight"]
        self.sensors = sorted(known, key=lambda name: name != "time")

    @classmethod
    def of_rows(cls, tasks: Sequence[Task]) -> "ObservationSpec":
        """Return the specification of a batch. With `privileged`, tasks observe every number that any task draws."""
        drawn = {name for task in tasks for name in task.drawn}
        common = cls(tasks[0], drawn)
        for row, task in enumerate(tasks):
            if differing := {*cls(task, drawn).entries} ^ {*common.entries}:
                arguments = {each.scale.ends or each.observed for each in differing}
                raise ValueError(f"the tasks of a batch must have the same observations, but row {row} differs "
                                 f"from row 0 in {' and '.join(sorted(arguments))}")  # fmt: skip
        return common

    def __len__(self) -> int:
        return len(self.entries)

    def index(self, name: str) -> int:
        """Return the index of the number with this id in the observation; ValueError if it is not observed."""
        if name not in self._index:
            raise ValueError(f"{name!r} is not observed; observed are {', '.join(self.ids)}")
        return self._index[name]

    def scale(self, name: str) -> Scale:
        """Return the scale of the number with this id."""
        return self.entries[self.index(name)].scale

    def decode(self, observation: ArrayLike, name: str) -> Floats:
        """Return the values (...) of a number, in its unit, from observations (..., n_obs), which are clipped."""
        scale = self.scale(name)
        curve = CURVES[scale.curve]
        scaled = np.asarray(observation, np.float64)[..., self.index(name)]
        share = (scaled - scale.scaled_low) / (1.0 - scale.scaled_low)
        begin, end = curve.of(scale.low), curve.of(scale.high)
        return np.asarray(curve.inverse(begin + share * (end - begin)))

    def encode(self, name: str, value: ArrayLike) -> Floats:
        """Return scaled and clipped values (...) of a number; `value` (...) is in the unit of the number."""
        scale = self.scale(name)
        low, gain = affine(scale)
        with np.errstate(divide="ignore"):
            curved = CURVES[scale.curve].of(np.asarray(value, np.float64))
        return np.clip(scale.scaled_low + gain * (curved - low), scale.scaled_low, 1.0)

    def pack(self) -> NDArray[Any]:
        """Return the entries as an array (n,) of ENTRY, for the compiled program."""
        rows = []
        for name, scale in ((row.id, row.scale) for row in self.entries):
            offset, gain = affine(scale)
            rows.append((place(name), CURVES[scale.curve].code, offset, scale.scaled_low, gain))
        return np.array(rows, ENTRY)


def place(name: str) -> int:
    """Return the index of an observed number among all numbers of the record EPISODE."""
    return _PLACES[f"sensors.{name}" if f"sensors.{name}" in _PLACES else f"drawn.{name}"]


def affine(scale: Scale) -> tuple[float, float]:
    """Return offset and gain: a scaled value is scaled_low + gain * (curve(value) - offset)."""
    begin, end = map(CURVES[scale.curve].at, (scale.low, scale.high))
    return begin, (1.0 - scale.scaled_low) / (end - begin)


def _entry(row: Quantity, task: Task, drawn: Container[str]) -> Quantity | None:
    """Return `row` as `task` observes it, with the scale of the task; None: it is not observed."""
    match row.observed:
        case "past_readings":
            sensor, _, before = row.id.rpartition("_")
            seen = int(before) <= task.past_readings and (sensor == "force" or task.deflection_sensor)
        case "operator" | "range_sensor" | "range_noise":  # a `range_noise` of 0 also gives an estimate
            seen = getattr(task, row.observed) is not None
        case "observe_range_noise" | "deflection_sensor":
            seen = getattr(task, row.observed)
        case _:
            seen = row.observed == "always"
    hidden = row.observed == "privileged" or row.id in drawn
    if row.id == "time_since_touch":
        hidden = task.alarm == "reading"  # with a switch this number equals `time_since_alarm`
    if not (seen or (hidden and task.privileged)):
        return None
    words = f"{row.words} minus flange position" if row.from_flange else row.words
    low, high = task.ends(row.scale.ends) if row.scale.ends else row.scale[:2]
    argument = row.observed if seen else "privileged"
    return replace(row, words=words, observed=argument, scale=row.scale._replace(low=low, high=high))
