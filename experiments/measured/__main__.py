"""`impact-gym measured FILE...`: predict half of somebody's measured hits or blows from the other half, on a page."""

import tomllib
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from matplotlib.figure import Figure

from agents.command_line import command_line
from experiments.lab import experiment
from experiments.lab.charts import OBJECT, TOOL
from experiments.lab.experiment import Shown, Tables
from experiments.lab.tables import Gather
from experiments.measured import blows as logs_of
from experiments.measured import hits as tables_of
from experiments.measured import tosses
from experiments.measured.blows import MEASURES, Blows
from experiments.measured.hits import BLOW, EQUAL, MODELS, Hits
from impact_gym.files import parsed
from impact_gym.identify import FREE

LINE = "straight line, two"


@dataclass(frozen=True)
class Measured:
    """Predict half of the measured hits of a free object, or of blows that were recorded, from the other half.

    A table of hits says how far the object slid, a row for each hit. With --scene the files are logs of blows instead,
    of force or velocities over time, as `impact-gym identify` reads them. Files .pt are tosses of ContactNets' cube.
    """

    files: tyro.conf.Positional[tuple[Path, ...]]
    """CSV files: tables of hits, or logs of a blow each; or HDF5 files, a group for each blow."""
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
    scene: Path | None = None
    """TOML file of what is known of the blows, see `impact-gym identify --help`; motion.speed may be a list."""
    free: tuple[str, ...] = FREE
    """Numbers of the scene that are fitted."""
    out: Path | None = None
    """Folder of the page; default: reports/measured."""


def hits_computed(sets: list[Hits], gather: Gather) -> Tables:
    """Return a row for each set, and one for each pair of sets."""
    rows, carried = [], []
    for hits in sets:
        row: dict[str, Any] = {"set": hits.name, "hits": len(hits.flux), "left_out": hits.left_out}
        row["number"] = tables_of.number_of(hits)
        for name in MODELS:
            row[name], row[f"{name}, 95 %"], row[f"{name}, held"] = tables_of.errors(hits, name)
        row["over_repeats"] = tables_of.errors(hits, BLOW, beside=EQUAL)[0] / row[EQUAL]
        rows.append(row)
        for other in sets:
            if other is not hits:
                middle, most, _ = tables_of.errors(hits, BLOW, other)
                carried.append({"from": hits.name, "to": other.name, "error": middle, "error, 95 %": most})
    return {"sets": rows, "carried": carried}


def hits_shown(sets: list[Hits], tables: Tables) -> Shown:
    """Return the figure and what the page says."""
    return {"hits": hits_chart(sets)}, {
        "kind": "hits", "rows": tables["sets"], "carried": tables["carried"], "models": list(MODELS), "blow": BLOW,
        "names": [each.name for each in sets],
    }  # fmt: skip


def hits_chart(sets: list[Hits]) -> Figure:
    """Return all hits, and what a blow and a straight line make of each set."""
    figure = Figure(figsize=(4.2 * min(len(sets), 3), 3.2 * -(-len(sets) // 3)), layout="constrained")
    panels = figure.subplots(-(-len(sets) // 3), min(len(sets), 3), squeeze=False).flat
    for axes, hits in zip(panels, sets, strict=False):
        axes.plot(hits.flux, hits.distance, ".", color="#767676", markersize=3)
        grid = np.linspace(hits.flux.min(), hits.flux.max())
        for name, colour in ((BLOW, OBJECT), (LINE, TOOL)):
            along = Hits("", grid, grid, np.full(len(grid), ""))
            axes.plot(grid, MODELS[name](hits)(along), color=colour, label=name)
        axes.set(title=hits.name, xlabel="flux (m/s)", ylabel="slides (m)", ylim=(0.0, None))
    figure.axes[0].legend(fontsize=8)
    return figure


def blows_computed(blows: Blows, gather: Gather) -> Tables:
    """Return a row for each model and measure, one for each blow under each model, one for each fit, and who cannot."""
    rows, each, fits, unfit = [], [], [], []
    for model, changed in logs_of.models(blows).items():
        try:
            table, fitted = logs_of.predicted(changed)
        except (RuntimeError, ValueError) as problem:
            unfit.append({"model": model, "reason": str(problem)})
            continue
        for measure, (middle, most, held) in logs_of.errors(table).items():
            rows.append({"model": model, "measure": measure, "error": middle, "error, 95 %": most, "held": held})
        for k, log in enumerate(blows.logs):
            for measure, values in table.items():
                made = dict(zip(("measured", "predicted", "low", "high"), values[k].tolist(), strict=True))
                each.append({"model": model, "log": log.name, "measure": measure, **made})
        for half, fit in enumerate(fitted):
            for name, value in fit.estimate.items():
                low, high = fit.interval[name]
                fits.append({"model": model, "half": half, "number": name, "value": value, "low": low, "high": high})
    if not rows:
        raise ValueError(f"no model of the blows can be fitted: {unfit[-1]['reason']}")
    return {"models": rows, "blows": each, "fits": fits, "unfit": unfit}


def blows_shown(tables: Tables) -> Shown:
    """Return the figure and what the page says."""
    found: dict[str, dict[str, Any]] = {}
    for row in tables["models"]:
        found.setdefault(row["model"], {})[row["measure"]] = row["error"], row["error, 95 %"], row["held"]
    best = logs_of.sufficient(found)
    measures = {name: words for name, words in MEASURES.items() if name in found[best]}
    return {"blows": blows_chart(tables, best, measures)}, {
        "kind": "blows", "found": found, "measures": measures, "best": best, "fits": tables["fits"],
        "unfit": tables["unfit"],
        "count": len({row["log"] for row in tables["blows"]}), "suffices": logs_of.SUFFICES,
    }  # fmt: skip


def blows_chart(tables: Tables, model: str, measures: dict[str, str]) -> Figure:
    """Return what was measured over what was predicted, with the intervals, for each measure."""
    figure = Figure(figsize=(3.4 * len(measures), 3.2), layout="constrained")
    for axes, (name, words) in zip(
        figure.subplots(1, len(measures), squeeze=False).flat, measures.items(), strict=True
    ):
        mine = [row for row in tables["blows"] if (row["model"], row["measure"]) == (model, name)]
        made, measured, low, high = (
            np.array([row[key] for row in mine]) for key in ("predicted", "measured", "low", "high")
        )
        axes.vlines(made, low, high, color=TOOL, label="95 %")
        axes.plot(made, measured, ".", color=OBJECT, label="measured")
        axes.set(title=words, xlabel="predicted", ylabel="measured")
    figure.axes[0].legend(fontsize=8)
    return figure


def tosses_shown(tables: Tables) -> Shown:
    """Return no figure, and what the page says."""
    return {}, {"kind": "tosses", "rows": tables["restitution"]}


def main(options: Measured) -> None:
    """Read, fit, predict, write the page."""
    with command_line("measured", "nothing is kept"):
        if not options.files:
            raise ValueError("files must be one file or more, got none")
        compute: experiment.Compute
        show: experiment.Show
        if options.scene:
            blows = logs_of.read_blows(options.files, parsed(options.scene, "TOML", tomllib.loads), options.free)
            compute, show = partial(blows_computed, blows), blows_shown
        elif all(path.suffix == ".pt" for path in options.files):
            rows = tosses.restitutions(options.files)
            compute, show = (lambda gather: {"restitution": rows}), tosses_shown
        else:
            columns = options.distance, options.flux, options.by, options.repeat, tables_of.least(options.at_least)
            sets = [hits for path in options.files for hits in tables_of.read(path, *columns)]
            compute, show = partial(hits_computed, sets), partial(hits_shown, sets)
        experiment.command("measured", compute, show, options.out, quick=False)


if __name__ == "__main__":
    main(tyro.cli(Measured, prog="impact-gym measured"))
