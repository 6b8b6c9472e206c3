"""Tables and lists of arguments, observations and drawn numbers, for docstrings of the environment classes."""

from typing import TypeVar

from impact_gym.quantities import QUANTITIES, SCENARIO, SET_UP, Quantity
from impact_gym.task.scenario import ScenarioRanges
from impact_gym.task.task import ARGUMENTS

Rows = list[tuple[str, ...]]
Kind = TypeVar("Kind", bound=type)


def documented(kind: Kind) -> Kind:
    """Replace the placeholders in the docstring of a class, such as OBSERVATION_TABLE, by Markdown tables and lists."""
    pairs = zip(SCENARIO, ScenarioRanges().by_id().values(), strict=True)
    scenario = [
        (f"`{row.id}`", f"{low:g} - {high:g}", "log-uniform" if row.by_ratio(low) else "uniform", row.unit)
        for row, (low, high) in pairs
    ]
    set_up: dict[str, list[str]] = {}  # names of the numbers with the same range and unit
    for row in SET_UP:
        scale = f"{row.scale.low:g} to {row.scale.high:g} {unit_of(row)}".replace(" -", "")
        set_up.setdefault(scale, []).append(f"`{row.id}`")
    parts = {
        "OBSERVATION_TABLE": table(observation_table()),
        "SCENARIO_TABLE": table([("Scenario field", "Default range", "Distribution", "Unit"), *scenario]),
        "SET_UP_LIST": [f"- {', '.join(names)}: {scale}" for scale, names in set_up.items()],
        "ARGUMENT_LIST": argument_list(),
    }
    for place, lines in parts.items():
        if kind.__doc__:  # None under python -OO
            kind.__doc__ = kind.__doc__.replace(f"    {place}", "\n".join(f"    {line}" for line in lines))
    return kind


def table(rows: Rows) -> list[str]:
    """Return the lines of a Markdown table."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["| " + " | ".join(map(str.ljust, row, widths)) + " |" for row in rows]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return lines


def unit_of(row: Quantity) -> str:
    """Return the unit of a number, and the function that is applied to the number before it is scaled."""
    return row.unit + {"linear": "", "log": ", as log", "log1p": ", as log(1 + F)"}[row.scale.curve]


def observation_table() -> Rows:
    """Return the rows of the observation table; earlier readings share one row."""
    seen = [row for row in QUANTITIES.values() if row.observed and row.observed != "past_readings"]
    seen.sort(key=lambda row: (row.observed != "always", row.observed == "privileged"))
    rows: Rows = [("Num", "Observation", "Unit", "from", "to", "Scaled to", "Argument")]
    for place, row in enumerate(seen):
        low, high, scaled_low, _, ends = row.scale
        always = row.observed == "always"
        shapers = ", ".join(f"`{name}`" for name in (ends, *row.shaped_by) if name)
        argument = shapers if always else f"only with `{row.observed}`" + (f"; {shapers}" if shapers else "")
        words = f"{row.words} minus flange position" if row.from_flange else row.words
        scaled = f"[{scaled_low:g}, 1]"
        rows.append((str(place) if always else "then", words, unit_of(row), f"{low:g}", f"{high:g}", scaled, argument))
    rows.insert(-6, ("then", "earlier readings of force and displacement", "", "", "", "", "only with `past_readings`"))
    return rows


def argument_list() -> list[str]:
    """Return a line for each argument of `Task`."""
    lines = []
    for name, item in ARGUMENTS.items():
        default = f'"{item.default}"' if isinstance(item.default, str) else f"{item.default}"
        quantity, words = QUANTITIES.get(name), item.metadata["words"]
        unit = f" ({quantity.unit})" if quantity and quantity.unit != "-" else ""
        lines.append(f"- `{name}` = {default}{unit}: {words or (quantity.words if quantity else '')}")
    return lines
