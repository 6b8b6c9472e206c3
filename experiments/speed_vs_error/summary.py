"""What follows from the tables: who is cheapest at an error, and medians over the population."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import polars as pl

from experiments.lab.tables import Row
from experiments.speed_vs_error.by_hand import METHODS as BY_HAND
from experiments.speed_vs_error.contenders import HEYOKA, MUJOCO, NAMES, OURS, SCIPY
from experiments.speed_vs_error.quantities import ERRORS

FINEST, FINE, COARSE = 1e-10, 1e-6, 1e-3  # m/s in V_p
RIVALS = {  # and the error at which each is compared
    "scipy": ([name for name in NAMES if name.startswith(SCIPY)], FINE),
    "by_hand": ([*BY_HAND], FINE),
    "heyoka": ([HEYOKA], FINE),
    "heyoka_finest": ([HEYOKA], FINEST),
    "mujoco": ([MUJOCO], COARSE),
}


def cheapest(rows: pl.DataFrame, names: Sequence[str], error: float) -> Row | None:
    """Return the row with the least time that keeps `error` (m/s in V_p), at it and at every finer setting there is.

    An error that is small at one setting by the chance of its sign does not count.
    """
    keeps = (pl.col("velocity_error") <= error).cast(pl.Int8).cum_min().over("contender") == 1
    kept = rows.filter(pl.col("contender").is_in(names)).sort("setting").filter(keeps).sort("microseconds")
    return kept.row(0, named=True) if kept.height else None


class Comparison(NamedTuple):
    """One contender beside ours at the same error; `row` is None if it does not get there."""

    error: float  # m/s
    row: Row | None
    ratio: float  # its time over ours


def compared(rows: pl.DataFrame, names: Sequence[str], error: float) -> Comparison | None:
    """Return the cheapest of `names` beside ours; None where they took no part, or ours does not get there."""
    mine, theirs = cheapest(rows, [OURS], error), cheapest(rows, names, error)
    if mine is None or rows.filter(pl.col("contender").is_in(names)).is_empty():
        return None
    return Comparison(error, theirs, theirs["microseconds"] / mine["microseconds"] if theirs else math.nan)


def lines(named: pl.DataFrame, truths: pl.DataFrame) -> list[dict[str, Any]]:
    """Return one line for each named scene: its name, its description and a comparison with each of `RIVALS`."""
    return [
        row | {kind: compared(named.filter(scene=row["scene"]), *rival) for kind, rival in RIVALS.items()}
        for row in truths.select("scene", "description").to_dicts()
    ]


def over_population(rows: pl.DataFrame) -> pl.DataFrame:
    """Return, for each contender and setting, quartiles of time and errors, and the share of failures.

    An answer that is missing has an infinite error; without an alarm there is no detection time to be wrong.
    """
    answered = pl.col("failure") == ""
    quartiles = [
        pl.when(pl.col(column).is_finite() | answered).then(column).otherwise(math.inf)
        .fill_nan(None).quantile(percent / 100, "lower").fill_null(math.nan).alias(f"{column}_{percent}")
        for column in ("microseconds", *ERRORS)
        for percent in (25, 50, 75)
    ]  # fmt: skip
    found = rows.group_by("contender", "setting").agg(pl.len().alias("scenes"), *quartiles, failures=(~answered).mean())
    return found.sort(pl.col("contender").cast(pl.Enum(NAMES)), "setting", descending=[False, True])
