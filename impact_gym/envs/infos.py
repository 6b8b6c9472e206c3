"""The `info` of each episode, from the compiled program's records."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.kernels import EPISODE
from impact_gym.pack import STATUS_MESSAGES, indices
from impact_gym.quantities import QUANTITIES
from impact_gym.support.dotted_paths import grouped
from impact_gym.task.episodes import RECORD_IDS
from impact_gym.task.scenario import FIELDS
from impact_gym.task.task import Task

Records = NDArray[Any]
_PLACES = indices(EPISODE)

_NUMBERS = {
    "object_velocity": "object_velocity",
    "approach_time": "approach_time",
    "time_weight": "drawn.time_weight",
    "reward_terms.time": "rewards.time",
    "reward_terms.velocity": "rewards.speed",
    "reward_terms.force": "rewards.force",
    "reward_terms.missed": "rewards.miss",
    **{f"scenario.{name}": f"drawn.{name}" for name in FIELDS},
    **{f"record.{name}": f"drawn.{name}" for name in RECORD_IDS},
}
"""Numbers that every info has: the entry's name, and the field of the compiled record EPISODE that holds its value."""

SLIDE = ("slide", "rest_time")
"""Entries that an info has only if there is friction under the object."""

LINKED = {
    "touch_time": "approach_time",
    "done_time": "done_time",
    "withheld_share": "withheld_share",
    "stop_delay": "stop_delay",
}
"""Entries that an info has only with an operator, and their fields in EPISODE."""

OTHERS = ("peak_force", "contact_count", "missed", "status")
"""Further entries that every info has; `Infos` reads or computes their values."""


def numbers_of(tasks: Sequence[Task]) -> dict[str, str]:
    """Return the numbers that an info has for at least one of `tasks`: name and field in EPISODE, see `_NUMBERS`."""
    drawn = [name for name in QUANTITIES if any(name in task.drawn for task in tasks)]
    slide = SLIDE if any(task.friction for task in tasks) else ()
    numbers = _NUMBERS | {f"record.{name}": f"drawn.{name}" for name in drawn} | {name: name for name in slide}
    return numbers | LINKED if tasks[0].operator else numbers


class Infos:
    """The nested dicts of infos, with an index in place of each value. The methods replace the indices by values."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        """Find where EPISODE holds the numbers; `tasks` has one task for all rows, or one for each row."""
        numbers = numbers_of(tasks)
        entries = {name: place for place, name in enumerate([*numbers, *OTHERS])}
        self._numbers = np.array([[_PLACES[name]] for name in numbers.values()])
        self._layout = grouped(entries)
        limits = [(task.force_limit or np.inf, task.velocity_limit or np.inf) for task in tasks]
        self._limits = np.array(limits).T if np.isfinite(limits).any() else None
        self._layouts = [grouped({name: entries[name] for name in (*numbers_of([task]), *OTHERS)}) for task in tasks]

    def costs(self, episodes: Records) -> dict[str, NDArray[np.int64]]:
        """Return the entry `cost` (size,) of a step's info, see `ImpactApproachEnv`; nothing if no task has a limit."""
        if self._limits is None:
            return {}
        (force, speed), terms = self._limits, episodes["terms"]  # before the end of an episode, both terms are 0
        return {"cost": ((terms["force"] > force) | (terms["speed"] > speed)).astype(np.int64)}

    def infos(self, episodes: Records, chains: Records, rows: NDArray[np.int64]) -> list[dict[str, Any]]:
        """Return the info of each of `rows`; the info's record has the numbers that the row's task draws."""
        numbers, others = self._values(episodes, chains, rows)
        values = zip(*numbers.tolist(), *(column.tolist() for column in others), strict=True)
        layouts = [self._layouts[row % len(self._layouts)] for row in rows.tolist()]
        return [filled(layout, of_row) for layout, of_row in zip(layouts, values, strict=True)]

    def columns(self, episodes: Records, chains: Records, rows: NDArray[np.int64]) -> dict[str, Any]:
        """Return one info of arrays (size,) with the numbers that any task draws; outside `rows`: 0, False or None."""
        size, (numbers, others) = len(episodes), self._values(episodes, chains, rows)
        columns = np.zeros((len(numbers), size))
        columns[:, rows] = numbers
        blank = [np.zeros(size), np.zeros(size, np.int64), np.zeros(size, np.bool_), np.full(size, None)]
        for column, some in zip(blank, others, strict=True):
            column[rows] = some
        return filled(self._layout, (*columns, *blank))

    def _values(self, episodes: Records, chains: Records, rows: NDArray[np.int64]) -> tuple[Records, list[Records]]:
        """Return the values for infos of `rows` (k,): numbers (n, k) from EPISODE, and arrays (k,) for OTHERS."""
        numbers = episodes.view(np.float64).reshape(len(episodes), -1)[rows, self._numbers]
        count, status, messages = chains["contacts"][rows], episodes["status"][rows], np.full(len(rows), "ok", object)
        for row in status.nonzero()[0]:
            messages[row] = STATUS_MESSAGES[int(status[row])]
        missed = (episodes["terminated"][rows] == 1) & (count == 0)
        return numbers, [chains["peak_force"][rows], count, missed, messages]


def filled(layout: Mapping[str, Any], values: Sequence[Any]) -> dict[str, Any]:
    """Return a copy of the nested mapping `layout` in which each index is replaced by `values[index]`."""
    return {name: filled(place, values) if isinstance(place, dict) else values[place] for name, place in layout.items()}
