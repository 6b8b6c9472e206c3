"""`impact-gym teleop`: play every assistance behind every operator, write reports/teleop/index.html."""

from functools import partial
from pathlib import Path

import tyro
from matplotlib.figure import Figure

from experiments.lab import experiment, player
from experiments.lab.charts import FLANGE, OBJECT, TOOL
from experiments.lab.experiment import Shown, Tables
from experiments.lab.tables import Gather
from experiments.teleop import cells

COLOURS = {cells.ALONE: FLANGE, cells.GAIN: "#767676", cells.BRAKE: TOOL, "speed limit": "#009E73",
           cells.POLICY: OBJECT}  # fmt: skip


def tables(quick: bool, gather: Gather) -> Tables:
    """Return all rows, after playing what is missing of them."""
    if quick:
        return {"cells": cells.rows(gather, 40, cells.DELAYS[3:4], [cells.TRAINED])}
    return {"cells": cells.rows(gather, 500, cells.DELAYS, list(cells.OPERATORS))}


def shown(tables: Tables) -> Shown:
    """Return the figure and what the page says."""
    found = tables["cells"]
    plain = [row for row in found if row["operator"] == cells.TRAINED and not row["channel"]]
    return {"slide": chart(found)}, {
        "player": player, "films": player.fragment(cells.watched("rigid", 500)),
        "rows": found, "worse": cells.worse(found), "couplings": cells.COUPLINGS, "trained": cells.TRAINED,
        "known": [row for row in plain if row["delay"] == 0.2],
    }  # fmt: skip


def chart(found: list[dict[str, object]]) -> Figure:
    """Return how far objects slide over the delay, for each coupling, mean over the operators."""
    figure = Figure(figsize=(9.0, 3.4))
    panels = figure.subplots(1, len(cells.COUPLINGS), sharey=True)
    for axes, coupling in zip(panels, cells.COUPLINGS, strict=True):
        for who, colour in COLOURS.items():
            mine = [row for row in found if (row["coupling"], row["contestant"], row["channel"]) == (coupling, who, "")]
            delays = sorted({float(str(row["delay"])) for row in mine})
            slides = [[float(str(row["slide"])) for row in mine if row["delay"] == delay] for delay in delays]
            means = [100.0 * sum(each) / len(each) for each in slides]
            axes.plot([1e3 * delay for delay in delays], means, "o-", color=colour, label=who)
        axes.set(title=coupling, xlabel="delay there and back (ms)")
    panels[0].set(ylabel="slide (cm), mean over operators", ylim=(0.0, None))
    panels[-1].legend(fontsize=8)
    return figure


def main(out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Say what each assistance gives an operator who acts late, on a page; what is on disk is not played again.

    Args:
        out: folder for tables, figure and page: reports/teleop, or teleop_quick beside it.
        quick: one delay, one operator, few scenarios.
        force: play everything again.
    """
    experiment.command("teleop", partial(tables, quick), shown, out, quick, again=force)


if __name__ == "__main__":
    tyro.cli(main, prog="impact-gym teleop")
