"""Scenarios: what an episode draws at random, the ranges it draws from, and the named sets of ranges."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from impact_gym.validation import WrongTypeError, number

Range = tuple[float, float]

FIELDS = ("object_mass", "contact_stiffness", "restitution", "distance")
"""What makes a scenario; keys of `options["scenario"]` and of the final `info["scenario"]`."""

LOGARITHMIC = (True, True, False, False)
LARGEST_WEIGHT = 1e6  # m/s per s and m/s per N; keeps rewards finite
LONGEST_DELAY = 1.0  # s
WIDEST = 1e12  # high over low of a range
UNITS = ("kg", "N/m^1.5", "(no unit)", "m")
AT_MOST = (math.inf, math.inf, 1.0, math.inf)


def interval(field: str, value: Any, unit: str, **limits: float) -> Range:
    """Return `value`, a number or a pair (low, high), as a checked pair.

    Raises:
        TypeError, ValueError: not a number or a pair of them, out of range, or inverted; names `field`.
    """
    if isinstance(value, (tuple, list)) or getattr(value, "ndim", 0) > 0:
        if len(value) != 2:
            raise ValueError(f"{field} must be a number or a pair (low, high) in {unit}, got {value!r}")
        low = number(f"{field}[0]", value[0], unit, **limits)
        high = number(f"{field}[1]", value[1], unit, **limits)
        if low > high:
            raise ValueError(f"{field} must not be inverted: low {low:g} is above high {high:g} {unit}")
        if low > 0 and not high / low <= WIDEST:
            raise ValueError(f"{field} must not span more than a factor {WIDEST:g}, got {low:g} to {high:g} {unit}")
        return low, high
    single = number(field, value, unit, **limits)
    return single, single


@dataclass(frozen=True)
class ScenarioRanges:
    """Ranges an episode's scenario is drawn from; a number is a range of width 0."""

    object_mass: Range = (0.1, 2.5)  # kg, log-uniform
    contact_stiffness: Range = (1e3, 1e6)  # N/m^1.5, log-uniform
    restitution: Range = (0.1, 1.0)  # -, uniform
    distance: Range = (0.15, 0.35)  # m, uniform

    def __post_init__(self) -> None:
        for name, unit, at_most in zip(FIELDS, UNITS, AT_MOST, strict=True):
            checked = interval(f"ScenarioRanges.{name}", getattr(self, name), unit, above=0.0, at_most=at_most)
            object.__setattr__(self, name, checked)

    @classmethod
    def of(cls, value: "ScenarioRanges | Mapping[str, Any] | str") -> "ScenarioRanges":
        """Return ranges from ranges, from a mapping of some of their fields, or from the name of a set."""
        if isinstance(value, ScenarioRanges):
            return value
        if isinstance(value, str):
            if value not in NAMED:
                raise ValueError(f"scenario must be one of {sorted(NAMED)} or a record of ranges, got {value!r}")
            return NAMED[value]
        if isinstance(value, Mapping):
            for name in value:
                if name not in FIELDS:
                    raise ValueError(f"scenario has no field {name!r}; its fields are {list(FIELDS)}")
            return cls(**value)
        raise WrongTypeError(f"scenario must be a ScenarioRanges, a mapping of its fields or a name, got {value!r}")

    def pairs(self) -> tuple[Range, ...]:
        """Return the ranges in the order of FIELDS."""
        return tuple(getattr(self, name) for name in FIELDS)


NAMED = {
    "train": ScenarioRanges(),
    "test": ScenarioRanges(),  # the same ranges, met with seeds that training never uses
    "hard": ScenarioRanges(  # outside the training ranges on every axis: light, stiff, inelastic, near
        object_mass=(0.02, 0.1), contact_stiffness=(1e6, 1e8), restitution=(0.02, 0.1), distance=(0.05, 0.15)
    ),
}
