"""The bars as a page of tables."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, NamedTuple

from experiments.lab.statistics import CONFIDENCE, RESAMPLES, Estimate

BOUND = "clairvoyant"
HEAD = (
    *("setup", "controller", "w [m/s per s]", "scenarios", "V_p + w T [m/s]", "V_p [m/s]", "T [s]"),
    *("above the bound [m/s]", "missed"),
)


class Row(NamedTuple):
    """Means of one controller at one time weight."""

    setup: str
    controller: str
    time_weight: float  # m/s per s
    scenarios: int
    loss: float  # m/s, V_p + w T and what misses cost
    object_velocity: float  # m/s, V_p
    approach_time: float  # s, T
    missed: int


@dataclass(frozen=True)
class Bar:
    """What was to be reached, and what each seed reached; less is better."""

    setup: str
    what: str
    limit: float  # at most
    chosen: str  # the median seed by validation score
    interval: Estimate | None  # of that one
    reached: Mapping[str, float]

    @property
    def value(self) -> float:
        """Of the median seed."""
        return self.reached[self.chosen]

    @property
    def verdict(self) -> str:
        """Whether the median seed meets it, and whether its interval leaves that open."""
        met = "met" if self.value <= self.limit else "missed"
        if math.isinf(self.value):
            return "missed: no such approach"
        open_still = self.interval is not None and self.interval.low <= self.limit < self.interval.high
        return f"{met}, within the interval" if open_still else met


def markdown(bars: Sequence[Bar], rows: Sequence[Row], about: Mapping[str, Any]) -> str:
    """Return the page."""
    lines = [
        "# The bars",
        "",
        f"`{about['command']}` on the frozen set {about['set']}; {about['date']}, {about['machine']}.",
        f"No policy is there for {', '.join(about['left out'])}." if about["left out"] else "",
        f"Intervals: {100 * CONFIDENCE:g} % of a paired bootstrap over scenarios, {RESAMPLES:,} resamples.",
        "",
        *_table(
            ("setup", "what", "at most", "median seed", "interval", "seeds: least", "middle", "most", "meet it", ""),
            map(_bar, bars),
        ),
        "",
        "## Means at each weight",
        "",
        "Clairvoyant knows the scenario: a bound, found for the first scenarios of the set alone. The rows with as few "
        "scenarios stand beside it.",
        "",
        *_table(HEAD, (_row(row, rows) for row in _once(rows))),
        "",
    ]
    return "\n".join(lines)


def _bar(bar: Bar) -> tuple[str, ...]:
    values = list(bar.reached.values())
    interval = f"{bar.interval.low:.4f} ... {bar.interval.high:.4f}" if bar.interval else ""
    meet = f"{sum(value <= bar.limit for value in values)} of {len(values)}"
    chosen = f"{bar.value:.4f} ({bar.chosen})"
    spread = (f"{min(values):.4f}", f"{median(values):.4f}", f"{max(values):.4f}")
    return bar.setup, bar.what, f"{bar.limit:.2f}", chosen, interval, *spread, meet, bar.verdict


def _row(row: Row, rows: Sequence[Row]) -> tuple[str, ...]:
    means = (f"{value:.4f}" for value in (row.loss, row.object_velocity, row.approach_time))
    same = [one for one in rows if one.controller == BOUND and one[:1] + one[2:4] == row[:1] + row[2:4]]
    above = f"{row.loss - same[0].loss:.4f}" if same else ""
    return row.setup, row.controller, f"{row.time_weight:.4g}", str(row.scenarios), *means, above, str(row.missed)


def _once(rows: Sequence[Row]) -> list[Row]:
    """Rows without repetition, in an order that puts beside one another what is to be compared."""
    setups = list(dict.fromkeys(row.setup for row in rows))
    return sorted(set(rows), key=lambda row: (setups.index(row.setup), row.scenarios, row.time_weight, row.loss))


def _table(head: Sequence[str], body: Iterable[Sequence[str]]) -> list[str]:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *body]
    return ["| " + " | ".join(line) + " |" for line in lines]
