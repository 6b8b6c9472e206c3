"""The numbers of a design that are free, `NAME=LOW:HIGH`, and what is wrong with them before anything is searched."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any, NamedTuple

import numpy as np

from agents.baselines.rule import Floats, Parameter
from agents.setups import Setup
from agents.setups.feasible import corners, warnings
from agents.setups.keys import known, within
from impact_gym.envs.setting import NUMBERS
from impact_gym.envs.task import Task
from impact_gym.scene import Rigid, SpringDamper
from impact_gym.validation import number

WIDE = 10.0
"""A range whose ends differ by this factor is searched by ratio, as stiffness and mass always are."""


DESIGN = tuple(name for name in NUMBERS if name == "tool_mass" or name.startswith("coupling."))
"""What may be free; which of these a coupling has depends on its kind."""


class Free(NamedTuple):
    """A number of the design that the search may choose."""

    name: str  # dotted, such as coupling.stiffness
    low: float
    high: float

    @property
    def logarithmic(self) -> bool:
        """Whether it is searched by ratio."""
        return NUMBERS[self.name].log_uniform(self.low) or 0.0 < WIDE * self.low <= self.high

    def parameter(self, start: float) -> Parameter:
        """Return it as the search sees it, from `start` on, or from the middle where that is outside of the range."""
        scale = np.log if self.logarithmic else float
        low, high = float(scale(self.low)), float(scale(self.high))
        begin = float(scale(start)) if self.low <= start <= self.high else 0.5 * (low + high)
        return Parameter(self.name, NUMBERS[self.name].unit, low, high, begin)

    def value(self, searched: Floats) -> Floats:
        """Return what the search's numbers stand for, any shape."""
        return np.clip(np.exp(searched) if self.logarithmic else searched, self.low, self.high)


def read(text: str) -> Free:
    """Return what `NAME=LOW:HIGH` says.

    Raises:
        ValueError: it says nothing of the kind, of no number of any design, or LOW is not below HIGH.
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
    one = Free(name, *(number(f"--free {name}", end, NUMBERS[name].unit) for end in pair))
    if not one.low < one.high:
        raise ValueError(f"--free {name} must have LOW below HIGH, got {one.low:g}:{one.high:g}")
    return one


def read_all(texts: Sequence[str], setup: Setup) -> list[Free]:
    """Return the free numbers of a set-up's coupling and tool.

    Raises:
        ValueError: there is none, one is named twice, or the set-up has no such number.
    """
    if not texts:
        raise ValueError("--free must name a number of the design at least, such as coupling.stiffness=10:300")
    free, coupling = [read(text) for text in texts], Task(**setup.environment).coupling
    there = ["tool_mass", *(f"coupling.{item.name}" for item in fields(coupling))]
    of = f"{setup.called} has a {type(coupling).__name__} coupling, whose design is {', '.join(there)}"
    for place, one in enumerate(free):
        if one.name not in there:
            raise ValueError(f"--free {one.name}: {of}")
        if one.name in [other.name for other in free[:place]]:
            raise ValueError(f"--free {one.name} is named twice")
    return free


def designed(environment: Mapping[str, Any], design: Mapping[str, Any]) -> dict[str, Any]:
    """Return an environment's arguments with the numbers of a design, or with their ranges, all at once."""
    inner = {name.removeprefix("coupling."): value for name, value in design.items() if name.startswith("coupling.")}
    made = {**environment, **{name: value for name, value in design.items() if not name.startswith("coupling.")}}
    if inner:
        coupling, given = Task(**environment).coupling, environment.get("coupling")
        of_setup = given if isinstance(given, Mapping) else {}  # what it draws is in there
        made["coupling"] = {"type": type(coupling).__name__, **asdict(coupling), **of_setup, **inner}
    return made


def as_built(design: Mapping[str, float], tolerance: float) -> dict[str, list[float]]:
    """Return the numbers of a design as ranges, which reach by a share `tolerance` to either side."""
    return {name: sorted([value * (1.0 - tolerance), value * (1.0 + tolerance)]) for name, value in design.items()}


def searched_environment(setup: Setup, free: Sequence[Free], deflection: float) -> dict[str, Any]:
    """Return the set-up's arguments with a range for each free number, as episodes would draw it.

    Raises:
        ValueError: an end of a range is no coupling; or no design in them holds the tool, within `deflection` (m).
    """
    with within("--free"):
        environment = designed(setup.environment, {one.name: [one.low, one.high] for one in free})
        task = Task(**environment)
        warnings(task)
        least = task.acceleration_range[0]
        lag = min(least * lag_of(corner) for corner in corners(task))
        if lag > deflection:
            raise ValueError(
                f"no design in these ranges holds the tool within {1e3 * deflection:g} mm: even at {least:g} m/s^2, "
                f"the least that the arm makes, the stiffest lets it lag {1e3 * lag:.3g} mm behind"
            )
    return environment


def lag_of(task: Task) -> float:
    """Return how far the tool stays behind in equilibrium for each m/s^2 of acceleration, s^2; 0 without a spring."""
    return task.tool_mass / task.coupling.stiffness if isinstance(task.coupling, SpringDamper) else 0.0


def own(setup: Setup, free: Sequence[Free]) -> list[float]:
    """Return what the set-up itself has for each free number; the middle of what it draws."""
    task = Task(**setup.environment)
    values = {"tool_mass": task.tool_mass}
    if not isinstance(task.coupling, Rigid):
        values |= {f"coupling.{item.name}": getattr(task.coupling, item.name) for item in fields(task.coupling)}
    return [float(values[one.name]) for one in free]
