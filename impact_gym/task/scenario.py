"""Ranges of a scenario, and named sets of ranges."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Any

from impact_gym.parameters import Parameters
from impact_gym.quantities import QUANTITIES, SCENARIO
from impact_gym.support.dotted_paths import record_from
from impact_gym.support.validation import Range, WrongTypeError, choice, shown

FIELDS = tuple(quantity.id for quantity in SCENARIO)


@dataclass(frozen=True)
class ScenarioRanges(Parameters):
    """Ranges from which an episode draws its scenario; a number is a range of width 0."""

    object_mass: Annotated[Range, QUANTITIES["object_mass"]] = (0.1, 2.5)  # kg
    contact_stiffness: Annotated[Range, QUANTITIES["contact_stiffness"]] = (1e3, 1e6)  # N/m^1.5
    restitution: Annotated[Range, QUANTITIES["restitution"]] = (0.1, 1.0)  # -
    distance: Annotated[Range, QUANTITIES["distance"]] = (0.15, 0.35)  # m

    @classmethod
    def of(cls, value: "ScenarioRanges | Mapping[str, Any] | str") -> "ScenarioRanges":
        """Return the ranges that `value` describes: `ScenarioRanges`, a mapping of some fields, or a set's name."""
        if isinstance(value, ScenarioRanges):
            return value
        if isinstance(value, str):
            choice("scenario, a name,", value, sorted(NAMED))
            return NAMED[value]
        if isinstance(value, Mapping):
            for name in value:
                if name not in FIELDS:
                    raise ValueError(f"scenario has no field {shown(name)}; its fields are {list(FIELDS)}")
            return cls(**value)
        raise WrongTypeError(f"scenario must be a ScenarioRanges, a mapping or a name, got {shown(value)}")

    def by_id(self) -> dict[str, Range]:
        """Return a dict from the id of each number to its range."""
        return {name: getattr(self, name) for name in FIELDS}


NAMED = {
    "train": ScenarioRanges(),
    "test": ScenarioRanges(),  # the ranges of "train"
    "hard": ScenarioRanges(  # lighter, stiffer, less elastic and nearer objects than in "train"
        object_mass=(0.02, 0.1), contact_stiffness=(1e6, 1e8), restitution=(0.02, 0.1), distance=(0.05, 0.15)
    ),
}


def ranged_record(name: str, value: Any, kinds: tuple[type[Any], ...]) -> tuple[Any, dict[str, Range]]:
    """Return the record (of a class in `kinds`) that `value` describes, and the ranges in `value` by dotted path.

    The record has the median of each range. Each combination of the ranges' ends must be valid.
    """
    if not isinstance(value, Mapping):
        return record_from(name, value, kinds), {}
    rows = {inner: QUANTITIES.get(f"{name}.{inner}") for inner, given in value.items() if given is not None}
    pairs = {inner: row.interval(value[inner]) for inner, row in rows.items() if row and row.draw}
    for corner in product(*(sorted({*pair}) for pair in pairs.values())):
        record_from(name, {**value, **dict(zip(pairs, corner, strict=True))}, kinds)
    middles = {inner: QUANTITIES[f"{name}.{inner}"].middle(*pair) for inner, pair in pairs.items()}
    ranges = {f"{name}.{inner}": pair for inner, pair in pairs.items() if pair[0] < pair[1]}
    return record_from(name, {**value, **middles}, kinds), ranges
