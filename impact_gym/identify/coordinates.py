"""Free numbers of a scene as coordinates of a fit: their logarithms, and that of e/(1-e) for the restitution e."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from impact_gym.scene import Scene, SpringDamper
from impact_gym.task.nested import flatten, get, parts
from impact_gym.validation import WrongTypeError, number, shown

MASS, STIFFNESS, RESTITUTION = "object.mass", "contact.stiffness", "contact.restitution"
SEARCHED = {STIFFNESS: (1e2, 1e8), RESTITUTION: (0.03, 0.99), MASS: (5e-3, 5e2)}
"""Ranges in which a fit looks for starting points, unless told otherwise."""
SEARCH_FACTOR = 10.0  # of other numbers: from a tenth to ten times what the scene has
REACH_FACTOR = 1e4  # beyond the searched range on either side, where the fit gives up
WALL = 1e5  # times the mass of a tool on a spring, beyond which an object is a wall and the fit gives up, too
LARGEST_LOGIT = 14.0  # of ln(e/(1-e)): e within 1e-6 of an end


@dataclass(frozen=True)
class Coordinate:
    """One free number, and how far it may go."""

    name: str
    sign: float  # of the number
    searched: tuple[float, float]  # of the number's size
    bounded: bool  # the number is known to be in the searched range
    wall: float = math.inf  # from which size on it makes no difference

    @property
    def reach(self) -> tuple[float, float]:
        """Least and largest coordinate."""
        if self.bounded:
            return self.coordinate(self.searched[0]), self.coordinate(self.searched[1])
        if self.name == RESTITUTION:
            return -LARGEST_LOGIT, LARGEST_LOGIT
        return math.log(self.searched[0] / REACH_FACTOR), math.log(min(self.searched[1] * REACH_FACTOR, self.wall))

    def coordinate(self, size: float) -> float:
        """Return the coordinate of a number of this size."""
        if self.name == RESTITUTION:
            return min(math.log(size / (1.0 - size)) if size < 1.0 else LARGEST_LOGIT, LARGEST_LOGIT)
        return math.log(size)

    def clipped(self, u: float) -> float:
        """Return `u`, or the end of its reach beyond it."""
        low, high = self.reach
        return min(max(u, low), high)

    def number(self, u: float) -> float:
        """Return the number at coordinate `u`; beyond its reach it stays."""
        u = self.clipped(u)
        return 1.0 / (1.0 + math.exp(-u)) if self.name == RESTITUTION else self.sign * math.exp(u)

    def end(self, u: float | None, side: int) -> float:
        """Return an end of an interval on one side (-1, 1); where `u` is None, that of all the number may be."""
        if u is not None:
            return self.number(u)
        if self.bounded:
            return self.number(self.reach[side > 0])
        return float(side > 0) if self.name == RESTITUTION else self.sign * (math.inf if side > 0 else 0.0)

    def start(self, scene: Scene) -> float:
        """Return the coordinate of the scene's own number, or the middle of the reach if that lies outside."""
        size, (low, high) = abs(get(scene, self.name)), self.reach
        inside = size > 0.0 and low <= self.coordinate(size) <= high
        return self.coordinate(size) if inside else (low + high) / 2.0


def free_coordinates(scene: Scene, free: Iterable[str] | Mapping[str, Any]) -> tuple[Coordinate, ...]:
    """Return the coordinates of the numbers that `free` names, or maps to a pair (low, high) they are known to be in.

    Raises:
        ValueError: a name is not one of the scene's numbers, or is there twice; a number is 0, or its pair is no range.
    """
    if isinstance(free, str):
        raise WrongTypeError(f"free must be a sequence of names, or a mapping to ranges, got the text {free!r}")
    known, names = list(flatten(parts(scene))), list(free)
    if not names or len(set(names)) < len(names):
        raise ValueError(f"free must name at least one number of the scene, and none twice, got {names}")
    coordinates = []
    for name in names:
        if name not in known:
            near = get_close_matches(str(name), known, 1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"free: the scene has no number {name!r}{hint}; it has {', '.join(known)}")
        value = get(scene, name)
        pair = free[name] if isinstance(free, Mapping) else None
        if pair is None and value == 0.0:
            raise ValueError(f"free: {name} is 0 in the scene, which gives its scale: give a guess, or a range for it")
        default = SEARCHED.get(name, (abs(value) / SEARCH_FACTOR, abs(value) * SEARCH_FACTOR))
        searched = default if pair is None else _range(name, pair)
        wall = WALL * scene.tool.mass if name == MASS and isinstance(scene.coupling, SpringDamper) else math.inf
        coordinates.append(Coordinate(name, math.copysign(1.0, value), searched, pair is not None, wall))
    return tuple(coordinates)


def _range(name: str, pair: Any) -> tuple[float, float]:
    if not hasattr(pair, "__len__") or len(pair) != 2:
        raise WrongTypeError(f"free: the range of {name} must be a pair (low, high), got {shown(pair)}")
    most = 1.0 if name == RESTITUTION else math.inf
    low, high = (number(f"free: the range of {name}", end, "(its unit)", above=0, at_most=most) for end in pair)
    if not low < high:
        raise ValueError(f"free: the range of {name} must rise, got {low!r} to {high!r}")
    return low, high
