"""Variables of the search: the free numbers of a design, given as `NAME=LOW:HIGH`."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from agents.baselines.rule import Floats, Parameter
from agents.setups import Setup
from agents.setups.feasible import corners, doubts
from agents.setups.keys import prefixed_errors, refuse_unknown
from impact_gym.couplings import SpringDamper
from impact_gym.quantities import QUANTITIES
from impact_gym.support.validation import number

WIDE = 10.0  # smallest HIGH / LOW for a logarithmic scale; a log-uniform quantity needs only LOW > 0 for this scale


class SearchVariable(NamedTuple):
    """A free number of the design."""

    name: str  # name of the number, such as coupling.stiffness
    low: float
    high: float
    start: float = np.nan  # value at which the search starts; nan or a value outside the range: mid-range

    @property
    def logarithmic(self) -> bool:
        """Whether this number is searched on a logarithmic scale."""
        return QUANTITIES[self.name].by_ratio(self.low) or 0.0 < WIDE * self.low <= self.high

    def parameter(self) -> Parameter:
        """Return the parameter for CMA-ES, on the scale of the search."""
        start = self.start if self.low <= self.start <= self.high else np.nan
        ends = np.array([self.low, self.high, start])
        low, high, start = (np.log(ends) if self.logarithmic else ends).tolist()
        start = 0.5 * (low + high) if np.isnan(start) else start
        return Parameter(self.name, QUANTITIES[self.name].unit, low, high, start)

    def value(self, searched: Floats) -> Floats:
        """Convert values on the scale of the search (any shape) to physical values within the range."""
        return np.clip(np.exp(searched) if self.logarithmic else searched, self.low, self.high)


def search_variables(texts: Sequence[str], setup: Setup) -> list[SearchVariable]:
    """Return a variable for each text `NAME=LOW:HIGH`, with the set-up's value as `start`.

    ValueError: there is no text, a text has another form, a NAME is unknown or repeated, or LOW is not below HIGH.
    """
    if not texts:
        raise ValueError("--free must name a number of the design, such as coupling.stiffness=10:300")
    parts = {f"coupling.{name}": value for name, value in asdict(setup.task.coupling).items() if value is not None}
    own = {"tool_mass": setup.task.tool_mass, **parts}
    variables = dict[str, SearchVariable]()
    for text in texts:
        name, _, ends = text.partition("=")
        try:
            low, high = map(float, ends.split(":"))
        except ValueError:
            raise ValueError(f"--free must be NAME=LOW:HIGH, such as coupling.stiffness=10:300, got {text!r}") from None
        refuse_unknown("--free ", [name], own)
        low, high = (number(f"--free {name}", end, QUANTITIES[name].unit) for end in (low, high))
        if not low < high:
            raise ValueError(f"--free {name} must have LOW below HIGH, got {low:g}:{high:g}")
        if name in variables:
            raise ValueError(f"--free {name} is named twice")
        variables[name] = SearchVariable(name, low, high, float(own[name]))
    return list(variables.values())


def as_built(design: Mapping[str, float], tolerance: float) -> dict[str, list[float]]:
    """Return for each number of a design the range from (1 - `tolerance`) to (1 + `tolerance`) times the number."""
    return {name: sorted([value * (1.0 - tolerance), value * (1.0 + tolerance)]) for name, value in design.items()}


def searched_environment(setup: Setup, variables: Sequence[SearchVariable], deflection: float | None) -> dict[str, Any]:
    """Return the set-up's environment with the range of each variable, as if each episode drew these numbers.

    ValueError: the environment is invalid, no front stop holds the tool, or no spring limits the lag to `deflection`.
    """
    with prefixed_errors("--free"):
        task = setup.task.changed({each.name: [each.low, each.high] for each in variables})
        doubts(task)
        springs = [corner for corner in corners(task) if isinstance(corner.coupling, SpringDamper)]
        # at a constant acceleration, the tool lags behind the flange by tool mass * acceleration / stiffness
        lag = task.acceleration_range[0] * min((c.tool_mass / c.coupling.stiffness for c in springs), default=0.0)
        if deflection is not None and lag > deflection:
            raise ValueError(f"no design in these ranges limits the tool's deflection to {1e3 * deflection:g} mm: even "
                             f"at the lowest acceleration, {task.acceleration_range[0]:g} m/s^2, the lightest tool on "
                             f"the stiffest spring lags behind the flange by {1e3 * lag:.3g} mm")  # fmt: skip
    return task.arguments()
