"""The free numbers of a design, `NAME=LOW:HIGH`: what is wrong with them shows before anything is searched."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from agents.baselines.rule import Floats, Parameter
from agents.setups import Setup
from agents.setups.feasible import corners, warnings
from agents.setups.keys import known, within
from impact_gym.quantities import QUANTITIES
from impact_gym.scene import SpringDamper
from impact_gym.task import Task
from impact_gym.task.arguments import changed
from impact_gym.task.task import MOUNT_IDS
from impact_gym.validation import number

WIDE = 10.0
"""A range whose ends differ by this factor is searched by ratio, as stiffness and mass always are."""
DESIGN = tuple(name for name in MOUNT_IDS if not name.startswith("robot."))
"""The numbers that may be free; which of them a coupling has depends on its kind."""


class Free(NamedTuple):
    """A number of the design that the search may choose."""

    name: str  # dotted, such as coupling.stiffness
    low: float
    high: float
    start: float = np.nan  # of the search

    @property
    def logarithmic(self) -> bool:
        """Whether it is searched by ratio."""
        return QUANTITIES[self.name].by_ratio(self.low) or 0.0 < WIDE * self.low <= self.high

    def parameter(self) -> Parameter:
        """Return the search's parameter; it begins in the middle where `start` is not within the range."""
        low, high = float(self.searched(self.low)), float(self.searched(self.high))
        begin = float(self.searched(self.start)) if self.low <= self.start <= self.high else 0.5 * (low + high)
        return Parameter(self.name, QUANTITIES[self.name].unit, low, high, begin)

    def searched(self, value: ArrayLike) -> Floats:
        """Return the search's numbers for physical values, any shape."""
        return np.log(value) if self.logarithmic else np.asarray(value, np.float64)

    def value(self, searched: Floats) -> Floats:
        """Return the physical values of the search's numbers, any shape."""
        return np.clip(np.exp(searched) if self.logarithmic else searched, self.low, self.high)

    def spread(self, count: int) -> list[float]:
        """Return `count` values from low to high, equally spaced as the search sees them."""
        space = np.geomspace if self.logarithmic else np.linspace
        return [float(value) for value in space(self.low, self.high, count)]


def read(text: str) -> Free:
    """Return the free number in `NAME=LOW:HIGH`.

    Raises:
        ValueError: the text has another form, no design has such a number, or LOW is not below HIGH.
    """
    name, equals, ends = text.partition("=")
    low, colon, high = ends.partition(":")
    try:
        pair = float(low), float(high)
    except ValueError:
        pair = None
    if not (name and equals and colon) or pair is None:
        raise ValueError(f"--free must be NAME=LOW:HIGH, such as coupling.stiffness=10:300, got {text!r}")
    known("--free ", [name], DESIGN)
    free = Free(name, *(number(f"--free {name}", end, QUANTITIES[name].unit) for end in pair))
    if not free.low < free.high:
        raise ValueError(f"--free {name} must have LOW below HIGH, got {free.low:g}:{free.high:g}")
    return free


def read_all(texts: Sequence[str], setup: Setup) -> list[Free]:
    """Return the free numbers of a set-up's coupling and tool; they begin with its own, the middle of what it draws.

    Raises:
        ValueError: there is none, one is named twice, or the set-up has no such number.
    """
    if not texts:
        raise ValueError("--free must name a number of the design at least, such as coupling.stiffness=10:300")
    numbers, task = [read(text) for text in texts], Task(**setup.environment)
    own = {"tool_mass": task.tool_mass}
    own |= {f"coupling.{field.name}": getattr(task.coupling, field.name) for field in fields(task.coupling)}
    names = [free.name for free in numbers]
    for name in names:
        if name not in own:
            kind = type(task.coupling).__name__
            raise ValueError(f"--free {name}: {setup.called} has a {kind} coupling, whose design is {', '.join(own)}")
        if names.count(name) > 1:
            raise ValueError(f"--free {name} is named twice")
    return [free._replace(start=float(own[free.name])) for free in numbers]


def as_built(design: Mapping[str, float], tolerance: float) -> dict[str, list[float]]:
    """Return the numbers of a design as ranges, which reach by a share `tolerance` to either side."""
    return {name: sorted([value * (1.0 - tolerance), value * (1.0 + tolerance)]) for name, value in design.items()}


def searched_environment(setup: Setup, numbers: Sequence[Free], deflection: float | None) -> dict[str, Any]:
    """Return the set-up's arguments with a range for each free number, as episodes would draw it.

    Raises:
        ValueError: an end of a range is no coupling; or no design in them holds the tool, within `deflection` (m).
    """
    with within("--free"):
        environment = changed(setup.environment, {free.name: [free.low, free.high] for free in numbers})
        task = Task(**environment)
        warnings(task)
        least = task.acceleration_range[0]
        lag = min(least * lag_of(corner) for corner in corners(task))
        if deflection is not None and lag > deflection:
            raise ValueError(
                f"no design in these ranges holds the tool within {1e3 * deflection:g} mm: even at {least:g} m/s^2, "
                f"the least that the arm makes, the stiffest lets it lag {1e3 * lag:.3g} mm behind"
            )
    return environment


def lag_of(task: Task) -> float:
    """Return how far the tool stays behind in equilibrium for each m/s^2 of acceleration, s^2; 0 without a spring."""
    return task.tool_mass / task.coupling.stiffness if isinstance(task.coupling, SpringDamper) else 0.0
