"""The random numbers of an episode, and numbers that `reset(options=...)` fixes."""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.kernels import RECORD, UNIFORMS
from impact_gym.quantities import EPISODE, QUANTITIES, SCENARIO
from impact_gym.support.validation import number, one_of, shown, unit_text
from impact_gym.task.scenario import FIELDS
from impact_gym.task.task import PLACES, Task

RECORD_IDS = tuple(row.id for row in (*SCENARIO, *EPISODE))
"""Ids of the numbers in every record."""


class EpisodeState(NamedTuple):
    """Times (s) of detection, alarm and end of an episode; inf: not yet, or never."""

    detection: float  # when the contact force first exceeded the threshold
    alarm: float  # when the last alarm reaches the controller; with `alarm="force"`, set at the detection already
    alarm_over: float  # when the last alarm ends; inf with `alarm="force"`
    end: float  # end of the last control step; the trace can continue after it


@lru_cache(maxsize=8)
def first_uniforms(seed: int, count: int) -> NDArray[np.float64]:
    """Return the uniform numbers (count, UNIFORMS) of the first episode with each seed: `seed`, `seed + 1`, ..."""
    seeds = map(np.random.SeedSequence, range(seed, seed + count))  # as Gymnasium seeds its generators
    return np.array([np.random.Generator(np.random.PCG64(each)).random(UNIFORMS) for each in seeds])


def records_with(count: int, numbers_by_id: Mapping[str, ArrayLike]) -> NDArray[Any]:
    """Return records (count,) with the given values, each a number or an array (count,); all other numbers are nan."""
    records = np.empty(count, RECORD)
    columns = records.view(np.float64).reshape(count, -1)
    columns.fill(math.nan)
    for name, values in numbers_by_id.items():
        columns[:, PLACES[name]] = values
    return records


def reset_options(options: Any, tasks: Sequence[Task], slots: int | None = None) -> NDArray[Any]:
    """Return the numbers that `reset(options=...)` fixes, as records (slots,) or (1,); nan: not fixed.

    "scenario" and "record" must not both give a number. With `slots`, the size of a batch, a value may be a sequence
    (slots,). `tasks` has one task for all slots, or one for each slot. A number of the set-up must lie in the
    range of each task that draws it. A reaction delay must not exceed the longest reaction delay of the task.
    """
    one_of("options", options, Mapping, type(None))
    given, fixed = dict(options or {}), dict[str, ArrayLike]()
    drawn = dict.fromkeys(name for task in tasks for name in task.drawn)
    for option, known in {"record": [*RECORD_IDS, *drawn], "scenario": FIELDS}.items():
        one_of(f"options[{option!r}]", values := given.pop(option, {}), Mapping)
        for name, value in values.items():
            if name not in known:
                raise ValueError(f"options[{option!r}] has no field {shown(name)}; its fields are {list(known)}")
            if name in fixed:
                raise ValueError(f"options give {name!r} twice: leave it out of 'record' or of 'scenario'")
            fixed[name] = _checked(f"options[{option!r}][{name!r}]", name, value, tasks, slots)
            if name == "distance" and option == "scenario":  # a record may have a distance out of reach
                for distance, task in zip(np.resize(fixed[name], slots or 1), cycle(tasks), strict=False):
                    task.check_distance(float(distance), f"options[{option!r}][{name!r}]")
    for name in given:
        raise ValueError(
            f"unknown option {shown(name)}; allowed are 'scenario', 'record' and, in a batch, 'reset_mask'"
        )
    return records_with(slots or 1, fixed)


def _checked(field: str, name: str, value: Any, tasks: Sequence[Task], slots: int | None) -> ArrayLike:
    several = isinstance(value, Sequence) and not isinstance(value, (str, bytes))
    listed = slots is not None and (several or getattr(value, "ndim", 0) > 0)
    if listed and len(value) != slots:
        unit = unit_text(QUANTITIES[name].unit, "in ")
        raise ValueError(f"{field} must be 1 or {slots} numbers {unit}, got {len(value)}")
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
