"""What follows from the tables: who is cheapest at an error, and medians over the population."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import takewhile

import numpy as np

from experiments.speed_vs_error.by_hand import METHODS as BY_HAND
from experiments.speed_vs_error.contenders import MUJOCO, NAMES, OURS, SCIPY
from experiments.speed_vs_error.quantities import ERRORS
from experiments.speed_vs_error.records import Row

FINE, COARSE = 1e-6, 1e-3  # m/s in V_p
SCIPY_NAMES = tuple(name for name in NAMES if name.startswith(SCIPY))


def of(rows: Iterable[Row], **values: str) -> list[Row]:
    """Return the rows in which each named column has the value given for it."""
    return [row for row in rows if all(row[name] == value for name, value in values.items())]


def cheapest(rows: Sequence[Row], names: Iterable[str], error: float) -> Row | None:
    """Return the row with the least time that keeps `error` (m/s in V_p), at it and at every finer setting there is.

    An error that is small at one setting by the chance of its sign does not count.
    """
    kept: list[Row] = []
    for name in names:
        finest_first = sorted(of(rows, contender=name), key=lambda row: float(row["setting"]))
        kept += takewhile(lambda row: row["velocity_error"] <= error, finest_first)
    return min(kept, key=lambda row: float(row["microseconds"]), default=None)


@dataclass(frozen=True)
class Comparison:
    """One contender beside ours at the same error; `row` is None if it does not get there."""

    error: float  # m/s
    ours: Row
    row: Row | None

    @property
    def ratio(self) -> float:
        """Its time over ours."""
        return math.nan if self.row is None else float(self.row["microseconds"] / self.ours["microseconds"])

    @property
    def one_run(self) -> bool:
        """Whether both were timed in the same run, in turns."""
        return self.row is None or bool(self.row["run"] == self.ours["run"])


@dataclass(frozen=True)
class Line:
    """What is said of one scene; a comparison is None where that kind took no part, or ours does not get there."""

    scene: str
    description: str
    scipy: Comparison | None
    by_hand: Comparison | None
    mujoco: Comparison | None


def compared(rows: Sequence[Row], names: Sequence[str], error: float) -> Comparison | None:
    """Return the cheapest of `names` beside ours."""
    mine = cheapest(rows, [OURS], error)
    if mine is None or not any(row["contender"] in names for row in rows):
        return None
    return Comparison(error, mine, cheapest(rows, names, error))


def lines(named: Sequence[Row], truths: Sequence[Row]) -> list[Line]:
    """Return one line for each named scene."""
    found = []
    for truth in truths:
        rows = of(named, scene=truth["scene"])
        found.append(
            Line(
                truth["scene"],
                truth["description"],
                compared(rows, SCIPY_NAMES, FINE),
                compared(rows, tuple(BY_HAND), FINE),
                compared(rows, (MUJOCO,), COARSE),
            )
        )
    return found


def over_population(rows: Sequence[Row]) -> list[Row]:
    """Return, for each contender and setting, quartiles of time and errors, and the share of failures.

    An answer that is missing has an infinite error.
    """
    found: list[Row] = []
    for name in NAMES:
        for setting in sorted({row["setting"] for row in of(rows, contender=name)}, reverse=True):
            here = [row for row in of(rows, contender=name) if row["setting"] == setting]
            row: Row = {"contender": name, "setting": setting, "scenes": len(here)}
            for column in ("microseconds", *ERRORS):
                # without an alarm in truth and answer there is no detection time to be wrong
                values = [math.inf if not math.isfinite(r[column]) and r["failure"] else float(r[column]) for r in here]
                values = [value for value in values if not math.isnan(value)]
                quartiles = np.quantile(values, (0.25, 0.5, 0.75), method="lower") if values else np.full(3, math.nan)
                row |= {f"{column}_{q}": float(v) for q, v in zip((25, 50, 75), quartiles, strict=True)}
            row["failures"] = sum(bool(r["failure"]) for r in here) / len(here)
            found.append(row)
    return found
