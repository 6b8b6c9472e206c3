"""The draws of an episode: uniform random numbers, and the numbers that `reset(options=...)` fixes."""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.kernels import RECORD, UNIFORMS
from impact_gym.quantities import EPISODE, QUANTITIES, SCENARIO
from impact_gym.task.scenario import FIELDS
from impact_gym.task.task import PLACES, Task
from impact_gym.validation import number, one_of, shown, whole

RECORD_IDS = tuple(row.id for row in (*SCENARIO, *EPISODE))
"""Ids of all drawn numbers except those of the set-up: keys of the final `info["record"]` and `options["record"]`."""


class EpisodeState(NamedTuple):
    """Times of the alarm and the end of an episode, s; inf for an event yet to come."""

    detection: float  # contact force first above the threshold
    alarm: float  # arrival of the last alarm at the controller, known in advance if a switch raises it
    alarm_over: float  # end of that alarm; inf with an alarm by a switch, which stays on
    end: float  # end of the last control step; the trace continues until all has settled


def skip_episodes(generator: np.random.Generator, count: int) -> None:
    """Advance `generator` by `count` episodes, each of which takes UNIFORMS numbers, whatever the options."""
    generator.bit_generator.advance(count * UNIFORMS)  # type: ignore[attr-defined]  # PCG64, which Gymnasium seeds


@lru_cache(maxsize=8)
def first_uniforms(seed: int, count: int) -> NDArray[np.float64]:
    """Return the uniform numbers (count, UNIFORMS) that environments seeded `seed`, `seed + 1`, ... draw first."""
    seeds = map(np.random.SeedSequence, range(seed, seed + count))  # as Gymnasium makes its generators
    return np.array([np.random.Generator(np.random.PCG64(each)).random(UNIFORMS) for each in seeds])


def records_with(count: int, numbers_by_id: Mapping[str, ArrayLike]) -> NDArray[Any]:
    """Return records (count,) with these numbers, each one for all or (count,); nan where the episode draws."""
    records = np.empty(count, RECORD)
    columns = records.view(np.float64).reshape(count, -1)
    columns.fill(math.nan)
    for name, values in numbers_by_id.items():
        columns[:, PLACES[name]] = values
    return records


def reset_options(options: Any, tasks: Sequence[Task], slots: int | None = None) -> tuple[NDArray[Any], int]:
    """Return the numbers that `reset(options=...)` fixes, as records (slots or 1,), and how many episodes it skips.

    Where the episode draws, records are nan. A scenario overrides a record. With `slots` a value may be a sequence
    (slots,). `tasks` are one for all slots or one for each. A number of the set-up must lie in the range of its task.
    A reaction delay is at most the longest of the task: readings are stored for so long.

    Raises:
        TypeError, ValueError: an unknown option or field, or a value out of range.
    """
    one_of("options", options, Mapping, type(None))
    given, fixed = dict(options or {}), dict[str, ArrayLike]()
    index = given.pop("episode_index", None)
    drawn = dict.fromkeys(name for task in tasks for name in task.drawn)
    for option, known in {"record": [*RECORD_IDS, *drawn], "scenario": FIELDS}.items():
        one_of(f"options[{option!r}]", values := given.pop(option, {}), Mapping)
        for name, value in values.items():
            if name not in known:
                raise ValueError(f"options[{option!r}] has no field {name!r}; its fields are {list(known)}")
            fixed[name] = _checked(f"options[{option!r}][{name!r}]", name, value, tasks, slots)
            if name == "distance" and option == "scenario":  # the distance in a record may be out of reach
                for distance, task in zip(np.resize(fixed[name], slots or 1), cycle(tasks), strict=False):
                    task.check_distance(float(distance), f"options[{option!r}][{name!r}]")
    for name in given:
        raise ValueError(f"unknown option {name!r}; allowed are 'scenario', 'record', 'episode_index'")
    skipped = 0 if index is None else whole("options['episode_index']", index, at_least=0)
    return records_with(slots or 1, fixed), skipped


def _checked(field: str, name: str, value: Any, tasks: Sequence[Task], slots: int | None) -> ArrayLike:
    """Return the number that an option fixes, or a list with one for each slot."""
    several = isinstance(value, Sequence) and not isinstance(value, (str, bytes))
    listed = slots is not None and (several or getattr(value, "ndim", 0) > 0)
    if listed and len(value) != slots:
        raise ValueError(f"{field} must be a number or {slots} of them in {QUANTITIES[name].unit}, got {len(value)}")
    pairs = zip(value, cycle(tasks), strict=False) if listed else ((value, task) for task in tasks)
    checked = list[float]()
    for slot, (each, task) in enumerate(pairs):
        limits = QUANTITIES[name].limits._asdict()
        if name in task.drawn:
            limits = dict(zip(("at_least", "at_most"), task.drawn[name], strict=True))
        elif name == "reaction_delay":
            limits["at_most"] = task.longest(name)
        checked.append(number(f"{field}[{slot}]" if listed else field, each, QUANTITIES[name].unit, **limits))
        if name == "noise_seed" and checked[-1] % 1.0:
            raise ValueError(f"{field} must be a whole number, got {shown(each)}")
    return checked if listed else checked[-1]
