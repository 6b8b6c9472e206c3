"""The numbers of an observation, which are rows of `impact_gym.quantities`: their order and their scales."""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.kernels import ENTRY, EPISODE, LINEAR, LOGARITHM, LOGARITHM_OF_ONE_MORE
from impact_gym.quantities import QUANTITIES, Quantity, Scale
from impact_gym.task.task import Task
from impact_gym.to_kernel import places

Floats = NDArray[np.float64]


class Curve(NamedTuple):
    """A function applied to a number before scaling."""

    code: int  # its value in `observation.pxi`
    at: Callable[[float], float]  # the function for one number, as the compiled program computes it
    of: Callable[[Any], Any]  # the function for arrays
    inverse: Callable[[Any], Any]


CURVES = {
    "linear": Curve(LINEAR, float, lambda values: values, lambda values: values),
    "log": Curve(LOGARITHM, math.log, np.log, np.exp),
    "log1p": Curve(LOGARITHM_OF_ONE_MORE, math.log1p, np.log1p, np.expm1),
}

_PLACES = places(EPISODE)


class Entry(NamedTuple):
    """One number of the observation; its scaled value is scaled_low + gain * (curve(value) - offset)."""

    id: str
    words: str
    unit: str
    scale: Scale
    argument: str  # name of the environment's argument that adds the number, or "always"
    place: int  # index of the number in the compiled record EPISODE, counted in numbers
    affine: tuple[float, float]  # offset and gain


class ObservationSpec:
    """The numbers of an observation, their order, and their conversion to SI units and back.

    `ids` and `entries` are in the order of the observation: first the numbers for an actor,
    `observation[..., spec.actor]`, then the true values that `privileged` appends. A critic gets all numbers,
    `observation[..., spec.critic]`. `sensors` has the ids of the sensor values: "time", then the ids of the actor's
    numbers without past readings and time weight.
    """

    def __init__(self, task: Task, drawn: Iterable[str] | None = None) -> None:
        """Make the specification of `task`; `drawn`: ids of the drawn numbers for a critic, None: those of `task`."""
        shown = [row for row in QUANTITIES.values() if _actor_sees(row, task)]
        critic = {*(task.drawn if drawn is None else drawn)}
        rest = (row for row in QUANTITIES.values() if not _actor_sees(row, task))
        hidden = [row for row in rest if _critic_sees(row, task, critic)]
        self.entries = tuple(_entry(row, task) for row in (*shown, *hidden))
        self.ids = tuple(entry.id for entry in self.entries)
        self.actor, self.critic = slice(0, len(shown)), slice(0, len(self.entries))
        self.scaled_low = np.array([entry.scale.scaled_low for entry in self.entries], np.float32)
        self._index = {name: place for place, name in enumerate(self.ids)}
        known = [entry.id for entry in self.entries[self.actor] if entry.argument != "past_readings"]
        self.sensors = sorted((name for name in known if name != "time_weight"), key=lambda name: name != "time")

    @classmethod
    def of_rows(cls, tasks: Sequence[Task]) -> "ObservationSpec":
        """Return the common specification of the rows of a batch.

        In every row a critic gets all numbers that at least one of the tasks draws.
        """
        drawn = {name for task in tasks for name in task.drawn}
        common = cls(tasks[0], drawn)
        for row, task in enumerate(tasks):
            if differing := {*cls(task, drawn).entries} ^ {*common.entries}:
                arguments = {entry.scale.ends or entry.argument for entry in differing}
                raise ValueError(f"the tasks of a batch must have the same observations, but row {row} differs "
                                 f"from row 0 in {' and '.join(sorted(arguments))}")  # fmt: skip
        return common

    def __len__(self) -> int:
        return len(self.entries)

    def __contains__(self, name: object) -> bool:
        return name in self._index

    def index(self, name: str) -> int:
        """Return the index of the number with this id in the observation; raise ValueError if it is not observed."""
        if name not in self._index:
            raise ValueError(f"{name!r} is not observed; observed are {', '.join(self.ids)}")
        return self._index[name]

    def scale(self, name: str) -> Scale:
        """Return the scale of the number with this id."""
        return self.entries[self.index(name)].scale

    def decode(self, observation: ArrayLike, name: str) -> Floats:
        """Return a number (...) in its unit from observations (..., n_obs), which are clipped to its scale."""
        scale = self.scale(name)
        curve = CURVES[scale.curve]
        scaled = np.asarray(observation, np.float64)[..., self.index(name)]
        share = (scaled - scale.scaled_low) / (1.0 - scale.scaled_low)
        begin, end = curve.of(scale.low), curve.of(scale.high)
        return np.asarray(curve.inverse(begin + share * (end - begin)))

    def encode(self, name: str, value: ArrayLike) -> Floats:
        """Return the scaled and clipped values of a number (...) in its unit."""
        entry = self.entries[self.index(name)]
        low, gain = entry.affine
        with np.errstate(divide="ignore"):
            curved = CURVES[entry.scale.curve].of(np.asarray(value, np.float64))
        return np.clip(entry.scale.scaled_low + gain * (curved - low), entry.scale.scaled_low, 1.0)

    def to_kernel(self) -> NDArray[Any]:
        """Return the entries for the compiled program (n,), ENTRY."""
        rows = [
            (entry.place, CURVES[entry.scale.curve].code, entry.affine[0], entry.scale.scaled_low, entry.affine[1])
            for entry in self.entries
        ]
        return np.array(rows, ENTRY)


def _actor_sees(row: Quantity, task: Task) -> bool:
    """Return whether the controller observes the quantity `row` in `task`."""
    match row.observed:
        case "past_readings":
            sensor, _, before = row.id.rpartition("_")
            return int(before) <= task.past_readings and (sensor == "force" or task.deflection_sensor)
        case "operator" | "range_sensor":
            return getattr(task, row.observed) is not None
        case "range_noise":
            return task.range_noise is not None  # a noise of 0 means an exact estimate
        case "observe_range_noise" | "deflection_sensor":
            return bool(getattr(task, row.observed))
    return row.observed == "always"


def _critic_sees(row: Quantity, task: Task, drawn: set[str]) -> bool:
    """Return whether the observation of `task` ends with the true value of the quantity `row`, for a critic."""
    if not task.privileged:
        return False
    if row.id == "time_since_touch":
        return task.alarm == "reading"  # with a switch the observed time since the alarm is the same
    return row.observed == "privileged" or row.id in drawn


def _entry(row: Quantity, task: Task) -> Entry:
    scale = row.scale
    if scale.ends:
        low, high = task.ends(scale.ends)
        scale = scale._replace(low=low, high=high)
    begin, end = map(CURVES[scale.curve].at, (scale.low, scale.high))
    argument = row.observed if _actor_sees(row, task) else "privileged"
    words = f"{row.words} minus flange position" if row.from_flange else row.words
    place = _PLACES.get(f"sensors.{row.id}", _PLACES.get(f"drawn.{row.id}", -1))
    return Entry(row.id, words, row.unit, scale, argument, place, (begin, (1.0 - scale.scaled_low) / (end - begin)))
