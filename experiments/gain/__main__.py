"""`impact-gym gain`: search and play what is missing, write reports/gain/index.html."""

from functools import partial
from pathlib import Path

import tyro
from matplotlib.figure import Figure

from experiments.gain import blind, priors, worlds
from experiments.lab import experiment
from experiments.lab.charts import FLANGE, OBJECT, TOOL
from experiments.lab.experiment import Shown, Tables
from experiments.lab.tables import Gather

QUICK_BOUND = blind.Effort(scenarios=40, corners=2, generations=10)
QUICK = priors.Effort((0.7, 3.0), scenarios=40, generations=12, tested=100, seeds=1, steps=300_000)


def tables(quick: bool, gather: Gather) -> Tables:
    """Return all rows, after searching and playing what is missing of them."""
    effort = QUICK if quick else priors.Effort()
    chosen = [priors.PRIORS[k] for k in (0, 3, -1)] if quick else priors.PRIORS
    return {
        "priors": priors.rows(gather, effort, chosen),
        "worlds": worlds.rows(gather, effort.tested),
        "blind": blind.rows(gather, QUICK_BOUND if quick else blind.Effort()),
    }


def shown(tables: Tables) -> Shown:
    """Return the figure and what the page says."""
    lines = priors.table(tables["priors"])
    return {"priors": chart(lines)}, {
        "lines": lines, "known": next((line for line in lines if line["prior"].near == 0.15), lines[-1]),
        "worlds": worlds.table(tables["worlds"]), "measures": worlds.MEASURES,
        "blind": blind.table(tables["blind"]),
    }  # fmt: skip


def chart(lines: list[dict[str, object]]) -> Figure:
    """Return V_p at the paper's approach time for each prior."""
    figure = Figure(figsize=(8.0, 3.6))
    axes = figure.subplots()
    names = (("paper's rule", FLANGE), ("steady speed, all of the arm", TOOL), ("profile: knowing where", OBJECT))
    for place, (name, colour) in enumerate(names):
        found = [line["velocity"][place] for line in lines]  # type: ignore[index]
        spread = [[each.value - each.low for each in found], [each.high - each.value for each in found]]
        axes.errorbar(range(len(lines)), [each.value for each in found], spread, fmt="o-", color=colour, label=name)
    axes.set_xticks(range(len(lines)), [line["prior"].words for line in lines], rotation=25, ha="right")  # type: ignore[attr-defined]
    axes.set(xlabel="where objects can stand", ylabel="V_p at the rule's time (m/s)", ylim=(0.0, None))
    axes.legend()
    return figure


def main(out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Say what the gain is made of, on a page; what is on disk is not searched again.

    Args:
        out: folder for tables, figure and page: reports/gain, or gain_quick beside it.
        quick: a first look in two minutes: few priors, short searches.
        force: search and play everything again.
    """
    experiment.command("gain", partial(tables, quick), shown, out, quick, again=force, packages=["cma"])


if __name__ == "__main__":
    tyro.cli(main, prog="impact-gym gain")
