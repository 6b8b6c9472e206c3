"""Numbers of a set-up that an episode may draw: which may be a range, and how it is drawn."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

from impact_gym.envs.scenario import Range, interval
from impact_gym.kernels import EPISODE


class Number(NamedTuple):
    """One number of a set-up."""

    unit: str
    logarithmic: bool = False  # log-uniform, where the ratio matters, or uniform, as all that begins at 0
    limits: Mapping[str, float] = {}  # read only; those of a coupling and a robot are in `scene`

    def log_uniform(self, low: float) -> bool:
        """Whether it is drawn log-uniform from a range that begins at `low`."""
        return self.logarithmic and low > 0.0


def places(kind: Any, before: int = 0) -> dict[str, int]:
    """Return where each number of a kernel's record stands, counted in numbers, by its dotted name."""
    found: dict[str, int] = {}
    for name, (inner, offset, *_) in kind.fields.items():
        at = before + offset // 8
        found |= {f"{name}.{rest}": place for rest, place in places(inner, at).items()} if inner.names else {name: at}
    return found


NUMBERS = {
    "tool_mass": Number("kg", True, {"above": 0.0}),
    "alarm_threshold": Number("N", True, {"at_least": 1e-6, "at_most": 1e6}),
    "range_noise": Number("m", limits={"at_least": 0.0, "at_most": 1e3}),
    "range_bias": Number("m", limits={"at_least": -1e3, "at_most": 1e3}),
    "force_noise": Number("N", True, limits={"at_least": 0.0, "at_most": 1e6}),
    "force_bias": Number("N", limits={"at_least": 0.0, "at_most": 1e6}),
    "coupling.stiffness": Number("N/m", True),
    "coupling.damping_ratio": Number("(no unit)"),
    "coupling.free_length": Number("m"),
    "coupling.height": Number("m"),
    "coupling.front_stop": Number("m"),
    "coupling.rear_stop": Number("m"),
    "coupling.stop_stiffness": Number("N/m", True),
    "coupling.stop_damping_ratio": Number("(no unit)"),
    "robot.mass": Number("kg", True),
    "robot.stiffness": Number("N/m", True),
    "robot.damping": Number("N s/m"),
}
"""What may be a pair (low, high) beside scenario, time weight and reaction delay, in the order of the kernels."""

SETTING_PLACES = places(EPISODE["drawn"]["setting"])
HOLDER_NUMBERS = tuple(name for name in NUMBERS if name == "tool_mass" or "." in name)
"""Those that say what holds the tool."""


def middle(name: str, pair: Range) -> float:
    """Return the number in the middle of a range, as it is drawn."""
    low, high = pair
    if low == high:
        return low
    return math.sqrt(low) * math.sqrt(high) if NUMBERS[name].log_uniform(low) else 0.5 * (low + high)


def ranged_record(name: str, value: Any, make: Callable[[Any], Any]) -> tuple[Any, dict[str, Range]]:
    """Return the record that `make` makes of `value`, ranges in it at their middle, and these by dotted name.

    Raises:
        TypeError, ValueError: a range that is none, or one of whose ends the record refuses, with those of the others.
    """
    if not isinstance(value, Mapping) or "position" in value:  # a table has lists that are no ranges
        return make(value), {}
    pairs = {
        field: interval(f"{name}.{field}", given, NUMBERS[f"{name}.{field}"].unit)
        for field, given in value.items()
        if f"{name}.{field}" in NUMBERS and (isinstance(given, (tuple, list)) or getattr(given, "ndim", 0) > 0)
    }
    for corner in product(*pairs.values()):
        make({**value, **dict(zip(pairs, corner, strict=True))})
    ranges = {f"{name}.{field}": pair for field, pair in pairs.items()}
    middles = {field: middle(f"{name}.{field}", pair) for field, pair in pairs.items()}
    return make({**value, **middles}), {field: pair for field, pair in ranges.items() if pair[0] < pair[1]}


def setting_table() -> str:
    """Return the table of all that may be a range as Markdown."""
    rows = [("Number of the set-up", "Distribution", "Unit")]
    for name, one in NUMBERS.items():
        zero = one.logarithmic and one.limits.get("at_least") == 0.0
        law = "log-uniform, uniform from 0" if zero else "log-uniform" if one.logarithmic else "uniform"
        rows.append((f"`{name}`", law, one.unit.replace("(no unit)", "-")))
    return markdown(rows)


def markdown(rows: Sequence[Sequence[str]]) -> str:
    """Return a table, the first row its head, for a docstring."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["| " + " | ".join(map(str.ljust, row, widths)) + " |" for row in rows]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join("    " + line for line in lines)
