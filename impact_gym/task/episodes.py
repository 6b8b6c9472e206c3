"""What an episode draws: from which uniform numbers, and how it is asked for again."""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import cycle
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.kernels import RECORD, UNIFORMS
from impact_gym.quantities import EPISODE, QUANTITIES, SCENARIO
from impact_gym.task.scenario import FIELDS
from impact_gym.task.task import PLACES, Task
from impact_gym.validation import number, numbers, one_of, shown, whole

RECORD_IDS = tuple(row.id for row in (*SCENARIO, *EPISODE))
"""All that an episode draws but for numbers of its set-up; keys of the final `info["record"]` and of
`options["record"]`, which plays it again."""

_RESET_OPTIONS = ("scenario", "record", "episode_index")


def generator(seed: int) -> np.random.Generator:
    """Return the generator that an environment seeded `seed` draws from, as Gymnasium makes it."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed)))


def skip_episodes(generator: np.random.Generator, count: int) -> None:
    """Move `generator` on as if `count` episodes had been drawn from it.

    An episode takes as many numbers whatever the options: so episode k of a seed is found without playing the others.
    """
    generator.bit_generator.advance(count * UNIFORMS)  # type: ignore[attr-defined]  # PCG64, which Gymnasium seeds


@lru_cache(maxsize=8)
def first_uniforms(seed: int, count: int) -> NDArray[np.float64]:
    """Return the uniform numbers (count, UNIFORMS) of what environments seeded `seed`, `seed + 1`, ... draw first."""
    return np.array([generator(seed + place).random(UNIFORMS) for place in range(count)])


def free_records(count: int) -> NDArray[Any]:
    """Return records (count,) in which nothing is fixed: all is nan."""
    free = np.empty(count, RECORD)
    free.view(np.float64).fill(math.nan)
    return free


def fix(records: NDArray[Any], numbers_by_id: Mapping[str, ArrayLike]) -> NDArray[Any]:
    """Return `records` (n,) with numbers, or one for each of them, by id; they are changed in place."""
    columns = records.view(np.float64).reshape(len(records), -1)
    for name, values in numbers_by_id.items():
        columns[:, PLACES[name]] = values
    return records


def fixed_records(options: Any, tasks: Sequence[Task], slots: int | None = None) -> NDArray[Any]:
    """Return what `reset(options=...)` fixes as records (slots or 1,), nan where the episode draws.

    A scenario goes before a record. With `slots` a value may also be a sequence of so many, one for each. `tasks` are
    one for all slots or one for each: what its episode draws of its set-up stays within its range, a reaction delay
    below its longest, for which force readings are kept; what it does not draw stays as it is.

    Raises:
        TypeError, ValueError: an unknown option or field, or a value out of range; names what is allowed.
    """
    records = free_records(slots or 1)
    drawn = dict.fromkeys(name for task in tasks for name in task.drawn)
    for option, known in {"record": [*RECORD_IDS, *drawn], "scenario": FIELDS}.items():
        given = (options or {}).get(option, {})
        one_of(f"options[{option!r}]", given, Mapping)
        for name, value in given.items():
            if name not in known:
                raise ValueError(f"options[{option!r}] has no field {name!r}; its fields are {list(known)}")
            fix(records, {name: _checked(name, value, tasks, slots, f"options[{option!r}][{name!r}]")})
    return records


def _checked(name: str, value: Any, tasks: Sequence[Task], slots: int | None, field: str) -> ArrayLike:
    """Return what an option fixes a number at, one value or one for each slot."""
    unit, limits = QUANTITIES[name].unit, [_limits(name, task) for task in tasks]
    values: ArrayLike
    if slots is None or not isinstance(value, (Sequence, np.ndarray)) or isinstance(value, (str, bytes)):
        for each in limits:
            values = number(field, value, unit, **each)
    else:
        alike = len(limits) == 1
        values = numbers(field, value, unit, **(limits[0] if alike else {}))
        if len(values) != slots:
            raise ValueError(f"{field} must be a number or {slots} of them in {unit}, got {len(values)}")
        for slot, one in enumerate(() if alike else values):
            number(f"{field}[{slot}]", one, unit, **limits[slot])
    if name == "distance" and field.startswith("options['scenario']"):  # a record may hold what was drawn beyond it
        for distance, task in zip(np.resize(values, max(len(tasks), np.size(values))), cycle(tasks), strict=False):
            task.check_distance(float(distance), field)
    if name == "noise_seed" and np.any(np.mod(values, 1.0)):
        raise ValueError(f"{field} must be a whole number, got {shown(value)}")
    return values


def _limits(name: str, task: Task) -> dict[str, float]:
    """Return the limits of a number that an episode of `task` is given."""
    if name in task.drawn:
        return dict(zip(("at_least", "at_most"), task.drawn[name], strict=True))
    longest = {"at_most": task.longest_delay} if name == "reaction_delay" else {}
    return QUANTITIES[name].limits._asdict() | longest


def episode_index(options: Any) -> int | None:
    """Return which episode of its seed `reset(options=...)` asks for, None if the next one; refuses unknown options.

    Raises:
        TypeError, ValueError: an unknown option, or no whole number.
    """
    if options is None:
        return None
    one_of("options", options, Mapping)
    for name in options:
        if name not in _RESET_OPTIONS:
            raise ValueError(f"unknown option {name!r}; allowed are {', '.join(map(repr, _RESET_OPTIONS))}")
    index = options.get("episode_index")
    return None if index is None else whole("options['episode_index']", index, at_least=0)
