"""Free numbers of a scene as the coordinates of a fit: logarithms, and of the restitution e the one of e/(1-e)."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from difflib import get_close_matches
from typing import Any

from impact_gym.scene import Scene
from impact_gym.sweeps import numbers_of, replaced
from impact_gym.validation import WrongTypeError, number

RESTITUTION = "contact.restitution"
SEARCHED = {"contact.stiffness": (1e2, 1e8), RESTITUTION: (0.03, 0.99)}
"""Where a fit looks for starting points, unless told otherwise."""
SPREAD = 10.0  # times what the scene has, up and down, of other numbers
BEYOND = 1e4  # times the searched range on either side, where the fit gives up
STEEPEST = 14.0  # of ln(e/(1-e)): e within 1e-6 of an end


@dataclass(frozen=True)
class Coordinate:
    """One free number, and how far it may go."""

    name: str
    sign: float  # of the number
    searched: tuple[float, float]  # of the number's size
    closed: bool  # the searched range is all there is

    @property
    def reach(self) -> tuple[float, float]:
        """Least and largest coordinate."""
        if self.closed:
            return self.coordinate(self.searched[0]), self.coordinate(self.searched[1])
        if self.name == RESTITUTION:
            return -STEEPEST, STEEPEST
        return math.log(self.searched[0] / BEYOND), math.log(self.searched[1] * BEYOND)

    def coordinate(self, size: float) -> float:
        """Return the coordinate of a number of this size."""
        if self.name == RESTITUTION:
            return min(math.log(size / (1.0 - size)) if size < 1.0 else STEEPEST, STEEPEST)
        return math.log(size)

    def number(self, u: float) -> float:
        """Return the number at coordinate `u`; beyond its reach it stays."""
        low, high = self.reach
        u = min(max(u, low), high)
        return 1.0 / (1.0 + math.exp(-u)) if self.name == RESTITUTION else self.sign * math.exp(u)

    def end(self, u: float | None, side: int) -> float:
        """Return an end of an interval, where `u` is None that of all the number may be."""
        if u is not None:
            return self.number(u)
        if self.closed:
            return self.number(self.reach[side > 0])
        return float(side > 0) if self.name == RESTITUTION else self.sign * (math.inf if side > 0 else 0.0)


def free_coordinates(scene: Scene, free: Iterable[str] | Mapping[str, Any]) -> tuple[Coordinate, ...]:
    """Return the coordinates of the numbers that `free` names, or maps to a pair (low, high) they are known to be in.

    Raises:
        ValueError: a name is not one of the scene's numbers, or is there twice; a number is 0, or its pair is no range.
    """
    if isinstance(free, str):
        raise WrongTypeError(f"free must be a sequence of names, or a mapping to ranges, got the text {free!r}")
    known = list(numbers_of({field.name: getattr(scene, field.name) for field in fields(scene)}))
    named = list(free)
    if not named or len(set(named)) < len(named):
        raise ValueError(f"free must name at least one number of the scene, and none twice, got {named}")
    found = []
    for name in named:
        if name not in known:
            near = get_close_matches(str(name), known, 1)
            meant = f"; did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"free: the scene has no number {name!r}{meant}; it has {', '.join(known)}")
        value = number_at(scene, name)
        pair = free[name] if isinstance(free, Mapping) else None
        if pair is None and value == 0.0:
            raise ValueError(f"free: {name} is 0 in the scene, which gives its scale: give a guess, or a range for it")
        default = SEARCHED.get(name, (abs(value) / SPREAD, abs(value) * SPREAD))
        sign = math.copysign(1.0, value)
        found.append(Coordinate(name, sign, default if pair is None else _range(name, pair), pair is not None))
    return tuple(found)


def _range(name: str, pair: Any) -> tuple[float, float]:
    if not hasattr(pair, "__len__") or len(pair) != 2:
        raise WrongTypeError(f"free: the range of {name} must be a pair (low, high), got {pair!r}")
    most = 1.0 if name == RESTITUTION else math.inf
    low, high = (number(f"free: the range of {name}", end, "(its unit)", above=0, at_most=most) for end in pair)
    if not low < high:
        raise ValueError(f"free: the range of {name} must rise, got {low!r} to {high!r}")
    return low, high


def number_at(scene: Scene, name: str) -> float:
    """Return the number of a scene with a dotted name."""
    value: Any = scene
    for part in name.split("."):
        value = getattr(value, part)
    return float(value)


def changed(scene: Scene, numbers: Mapping[str, float]) -> Scene:
    """Return `scene` with other `numbers`, by their dotted names."""
    return replaced(scene, numbers)
