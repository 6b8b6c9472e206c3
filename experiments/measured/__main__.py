"""`impact-gym measured FILE...`: predict half of somebody's measured hits from the other half, on a page."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import tyro
from matplotlib.figure import Figure

from agents.command_line import command_line
from experiments.lab import experiment
from experiments.lab.charts import OBJECT, TOOL
from experiments.lab.experiment import Shown, Tables
from experiments.lab.tables import Gather
from experiments.measured import hits as tables_of
from experiments.measured.hits import BLOW, MODELS, Hits


@dataclass(frozen=True)
class Measured:
    """Predict half of the measured hits of a free object from the other half."""

    files: tyro.conf.Positional[tuple[Path, ...]]
    """CSV files with a row for each hit."""
    distance: str = "distance"
    """Column of the way that the object slides, m."""
    flux: str = "flux"
    """Column of m v / (m + m_p), m/s: m the arm's effective mass along the hit, v its velocity, m_p the object's."""
    by: tuple[str, ...] = ()
    """Columns that part the hits into sets, such as the arm."""
    repeat: tuple[str, ...] = ()
    """Columns in which hits agree that were meant to be equal."""
    at_least: tuple[str, ...] = ()
    """COLUMN=NUMBER: a row below is no hit."""
    out: Path | None = None
    """Folder of the page; default: reports/measured."""


def shown(sets: list[Hits], tables: Tables) -> Shown:
    """Return the figure and what the page says."""
    return {"hits": chart(sets)}, {
        "rows": tables["sets"], "carried": tables["carried"], "models": list(MODELS), "blow": BLOW,
        "names": [each.name for each in sets],
    }  # fmt: skip


def computed(sets: list[Hits], gather: Gather) -> Tables:
    """Return a row for each set, and one for each pair of sets."""
    rows, carried = [], []
    for hits in sets:
        row = {"set": hits.name, "hits": len(hits.flux), "left_out": hits.left_out}
        row["number"] = tables_of.number_of(hits.flux, hits.distance)
        for name, fit in MODELS.items():
            middle, most, held = tables_of.errors(hits, fit)
            row |= {name: middle, f"{name}, 95 %": most, f"{name}, held": held}
        middle, most, count = tables_of.spread(hits)
        rows.append(row | {"repeats": middle, "repeats, 95 %": most, "repeated": count})
        for other in sets:
            if other is not hits:
                middle, most, _ = tables_of.errors(hits, MODELS[BLOW], other)
                carried.append({"from": hits.name, "to": other.name, "error": middle, "error, 95 %": most})
    return {"sets": rows, "carried": carried}


def chart(sets: list[Hits]) -> Figure:
    """Return all hits, and what a blow and a straight line make of each set."""
    figure = Figure(figsize=(4.2 * min(len(sets), 3), 3.2 * -(-len(sets) // 3)), layout="constrained")
    panels = figure.subplots(-(-len(sets) // 3), min(len(sets), 3), squeeze=False).flat
    for axes, hits in zip(panels, sets, strict=False):
        axes.plot(hits.flux, hits.distance, ".", color="#767676", markersize=3)
        grid = np.linspace(hits.flux.min(), hits.flux.max())
        for name, colour in ((BLOW, OBJECT), ("straight line, two", TOOL)):
            axes.plot(grid, MODELS[name](hits.flux, hits.distance)(grid), color=colour, label=name)
        axes.set(title=hits.name, xlabel="flux (m/s)", ylabel="slides (m)", ylim=(0.0, None))
    figure.axes[0].legend(fontsize=8)
    return figure


def main(options: Measured) -> None:
    """Read, fit, predict, write the page."""
    with command_line("measured", "nothing is kept"):
        if not options.files:
            raise ValueError("files must be one CSV file or more, got none")
        least = tables_of.least(options.at_least)
        read = partial(
            tables_of.read,
            distance=options.distance,
            flux=options.flux,
            by=options.by,
            repeat=options.repeat,
            at_least=least,
        )
        sets = [hits for path in options.files for hits in read(path)]
    experiment.command("measured", partial(computed, sets), partial(shown, sets), options.out, quick=False)


if __name__ == "__main__":
    main(tyro.cli(Measured, prog="impact-gym measured"))
