"""`impact-gym teleop`: play every assistance behind every operator, write reports/teleop/index.html."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import tyro
from matplotlib.figure import Figure

from experiments.lab import experiment, player
from experiments.lab.charts import FLANGE, OBJECT, TOOL
from experiments.lab.experiment import Shown, Tables
from experiments.lab.statistics import Estimate
from experiments.lab.tables import Gather, Row
from experiments.teleop import cells

COLOURS = {cells.ALONE: FLANGE, cells.BRAKE: TOOL, cells.LIMIT: "#009E73", cells.POLICY: OBJECT}
SHOWN = {"slide": (100.0, "slide (cm)"), "done_time": (1.0, "done (s)")}
"""Rows of the figure: columns of the table, their factor and words."""
TYPICAL = 0.2  # s, there and back
WORSE = {f"{rival}_{name}": words.format(who) for rival, who in cells.RIVALS.items() if rival != "limit"
         for name, words in {"slide": "slides further than with {}", "cost": "costs more than {}"}.items()}  # fmt: skip


def tables(quick: bool, gather: Gather) -> Tables:
    """Return all rows, after playing what is missing of them."""
    if quick:
        return {"cells": cells.rows(gather, 40, [TYPICAL], [cells.REACH, "steady"])}
    return {"cells": cells.rows(gather, 500, cells.DELAYS, cells.OPERATORS)}


def shown(tables: Tables) -> Shown:
    """Return the figures and what the page says."""
    found = tables["cells"]
    plain = [row for row in found if not row["channel"] and cells.SHUFFLED not in row["contestant"]]
    typical = [row for row in plain if row["delay"] == TYPICAL]
    groups = {"trained with": [row for row in typical if row["operator"] not in cells.HELD_OUT],
              "held out": [row for row in typical if row["operator"] in cells.HELD_OUT]}  # fmt: skip
    held_out = [row for row in plain if row["operator"] in cells.HELD_OUT]
    return {"held_out": chart(held_out), "trained": chart([row for row in plain if row not in held_out])}, {
        "player": player, "films": player.fragment(cells.watched("rigid", found[0]["scenarios"])),
        "rows": found, "groups": groups, "hurts": list(hurts(plain)),
        "duels": [duel(plain, rival) for rival in ("brake", "limit")], "first": found[0],
        "policy": [row for row in plain if row["contestant"] == cells.POLICY],
    }  # fmt: skip


def hurts(found: Sequence[Row]) -> Iterator[dict[str, str]]:
    """Yield, for each assistance and each way in which it may hurt, the cells where it does, beyond their intervals."""
    for who in (cells.POLICY, cells.LIMIT, cells.BRAKE, cells.RULE):
        for column, words in WORSE.items():
            worse = [row for row in found if row["contestant"] == who and row[f"{column}_high"] < 0.0]
            if worse:
                places: dict[str, list[str]] = {}
                for row in worse:
                    places.setdefault(f"{row['coupling']}, {row['operator']}", []).append(f"{1e3 * row['delay']:.0f}")
                last = min(worse, key=lambda row: row[column])
                scale, unit = (-100.0, "cm") if "slide" in column else (-1.0, "m/s")
                most = Estimate(*(scale * last[column + end] for end in ("", "_high", "_low")))
                yield {
                    "who": who, "what": words, "count": f"{len(worse)}",
                    "where": "; ".join(f"{place}: {', '.join(delays)} ms" for place, delays in places.items()),
                    "most": f"{most:.2f} {unit} ({last['coupling']}, {last['operator']}, {1e3 * last['delay']:.0f} ms)",
                }  # fmt: skip


def duel(found: Sequence[Row], rival: str) -> dict[str, object]:
    """Return in how many cells the policy costs clearly less and clearly more than a rival, and the extremes."""
    mine = [row for row in found if row["contestant"] == cells.POLICY]
    column = f"{rival}_cost"
    best, worst = max(mine, key=lambda row: row[column]), min(mine, key=lambda row: row[column])
    return {
        "rival": cells.RIVALS[rival], "column": column, "cells": len(mine), "best": best, "worst": worst,
        "less": sum(row[f"{column}_low"] > 0.0 for row in mine),
        "more": sum(row[f"{column}_high"] < 0.0 for row in mine),
        "share": 100.0 * sum(row[column] for row in mine) / sum(row["cost"] + row[column] for row in mine),
    }  # fmt: skip


def chart(found: Sequence[Row]) -> Figure:
    """Return slide and done time over the delay, for each coupling, means over the operators with intervals."""
    figure = Figure(figsize=(9.0, 5.4))
    panels = figure.subplots(len(SHOWN), len(cells.COUPLINGS), sharey="row", sharex=True)
    for line, (name, (scale, words)) in zip(panels, SHOWN.items(), strict=True):
        for axes, coupling in zip(line, cells.COUPLINGS, strict=True):
            for who, colour in COLOURS.items():
                mine = [row for row in found if (row["coupling"], row["contestant"]) == (coupling, who)]
                delays = sorted({row["delay"] for row in mine})
                value, low, high = ([scale * _mean(mine, delay, column) for delay in delays]
                                    for column in (name, f"{name}_low", f"{name}_high"))  # fmt: skip
                times = [1e3 * delay for delay in delays]
                axes.plot(times, value, "o-", color=colour, label=who, markersize=4)
                axes.fill_between(times, low, high, color=colour, alpha=0.15, linewidth=0.0)
        line[0].set(ylabel=words, ylim=(0.0, None))
    for axes, coupling in zip(panels[0], cells.COUPLINGS, strict=True):
        axes.set(title=coupling)
    for axes in panels[-1]:
        axes.set(xlabel="delay there and back (ms)")
    panels[0, -1].legend(fontsize=8)
    return figure


def _mean(rows: Sequence[Row], delay: float, column: str) -> float:
    """Return the mean of a column over the operators at a delay (s)."""
    values = [float(row[column]) for row in rows if row["delay"] == delay]
    return sum(values) / len(values)


def main(out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Say what each assistance gives an operator who acts late, on a page; what is on disk is not played again.

    Args:
        out: folder for tables, figures and page: reports/teleop, or teleop_quick beside it.
        quick: one delay, two operators, few scenarios.
        force: play everything again.
    """
    experiment.command("teleop", partial(tables, quick), shown, out, quick, again=force)


if __name__ == "__main__":
    tyro.cli(main, prog="impact-gym teleop")
