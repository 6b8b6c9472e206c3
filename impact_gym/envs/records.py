"""The record of an episode: all that it draws at random, how it is drawn, and how it is asked for again."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym import kernels
from impact_gym.envs.scenario import AT_MOST, FIELDS, LARGEST_WEIGHT, UNITS
from impact_gym.envs.setting import NUMBERS, places
from impact_gym.envs.task import Task
from impact_gym.validation import WrongTypeError, number, numbers, whole

RECORD: tuple[str, ...] = tuple(name for name in kernels.RECORD.names or () if name != "setting")
"""All that an episode draws but for numbers of its set-up; keys of the final `info["record"]` and of
`options["record"]`, which plays it again."""

RECORD_PLACES = {name.removeprefix("setting."): place for name, place in places(kernels.RECORD).items()}

DRAWS = len(kernels.UNIFORMS.names or ())
"""Uniform numbers an episode takes from its generator, whatever the options: so episode k of a seed can be found
without playing the ones before it."""

_LIMITS: dict[str, tuple[str, dict[str, float]]] = {
    **{
        name: (unit, {"above": 0.0, "at_most": at_most})
        for name, unit, at_most in zip(FIELDS, UNITS, AT_MOST, strict=True)
    },
    "time_weight": ("m/s per s", {"above": 0.0, "at_most": LARGEST_WEIGHT}),
    "distance_estimate": ("m", {}),
    "force_error": ("N", {}),
    "noise_seed": ("(no unit)", {"at_least": 0.0, "at_most": 2.0**53}),
}
_RESET_OPTIONS = ("scenario", "record", "episode_index")


def free_record(count: int) -> NDArray[Any]:
    """Return records (count,) in which nothing is fixed: all is nan."""
    free = np.empty(count, kernels.RECORD)
    free.view(np.float64).fill(math.nan)
    return free


def fixed_record(options: Any, task: Task, slots: int | None = None) -> NDArray[Any]:
    """Return what `reset(options=...)` fixes as records (slots or 1,), nan where the episode draws.

    A scenario goes before a record. With `slots` a value may also be a sequence of so many, one for each. What an
    episode of `task` draws of its set-up stays within its range, a reaction delay below the longest, for which force
    readings are kept.

    Raises:
        TypeError, ValueError: an unknown option or field, or a value out of range; names what is allowed.
    """
    fixed = free_record(slots or 1)
    columns = fixed.view(np.float64).reshape(len(fixed), -1)
    allowed = _LIMITS | {"reaction_delay": ("s", {"at_least": 0.0, "at_most": task.delays[1]})}
    for name, (low, high) in task.drawn.items():
        allowed[name] = NUMBERS[name].unit, {"at_least": low, "at_most": high}
    for option, known in {"record": [*RECORD, *task.drawn], "scenario": FIELDS}.items():
        given = (options or {}).get(option, {})
        if not isinstance(given, Mapping):
            raise WrongTypeError(f"options[{option!r}] must be a mapping of {list(known)}, got {given!r}")
        for name, value in given.items():
            if name not in known:
                raise ValueError(f"options[{option!r}] has no field {name!r}; its fields are {list(known)}")
            unit, limits = allowed[name]
            field = f"options[{option!r}][{name!r}]"
            if slots is None or not isinstance(value, (Sequence, np.ndarray)) or isinstance(value, (str, bytes)):
                values: Any = number(field, value, unit, **limits)
            else:
                values = numbers(field, value, unit, **limits)
                if len(values) != slots:
                    raise ValueError(f"{field} must be a number or {slots} of them in {unit}, got {len(values)}")
            if name == "noise_seed" and np.any(np.mod(values, 1.0)):
                raise ValueError(f"{field} must be a whole number, got {value!r}")
            columns[:, RECORD_PLACES[name]] = values
    return fixed


def episode_index(options: Any) -> int | None:
    """Return which episode of its seed `reset(options=...)` asks for, None if the next one; refuses unknown options.

    Raises:
        TypeError, ValueError: an unknown option, or no whole number.
    """
    if options is None:
        return None
    if not isinstance(options, Mapping):
        raise WrongTypeError(f"options must be a mapping, got {options!r}")
    for name in options:
        if name not in _RESET_OPTIONS:
            raise ValueError(f"unknown option {name!r}; allowed are {', '.join(map(repr, _RESET_OPTIONS))}")
    index = options.get("episode_index")
    return None if index is None else whole("options['episode_index']", index, at_least=0)


def skip_episodes(generator: np.random.Generator, count: int) -> None:
    """Move `generator` on as if `count` episodes had been drawn from it."""
    generator.bit_generator.advance(count * DRAWS)  # type: ignore[attr-defined]  # PCG64, which Gymnasium seeds
