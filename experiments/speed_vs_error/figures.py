"""The figures, drawn from the tables."""

from collections.abc import Sequence
from textwrap import wrap
from typing import Any

import polars as pl
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.lab.charts import SERIES
from experiments.speed_vs_error.contenders import NAMES, OURS
from experiments.speed_vs_error.quantities import ERRORS
from experiments.speed_vs_error.summary import over_population

RANGE = (1e-16, 1e1)  # of errors; what is outside is drawn at the edge
COLOURS = (*SERIES, "#000000", "#8a8a8a", "#7F3C8D")
LINES = ("-", *4 * ("--",), *2 * (":",), "-.", "-")
STYLES: dict[str, dict[str, Any]] = {
    name: {"color": colour, "marker": mark, "linestyle": line, "linewidth": 1.2, "markersize": 4}
    for name, colour, mark, line in zip(NAMES, COLOURS, "os^Dv<>PX", LINES, strict=True)
}
STYLES[OURS]["linewidth"] = 2.4
OPEN = {"marker": "o", "linestyle": "", "color": "#555555", "markerfacecolor": "white"}


def _legend(figure: Figure, rows: pl.DataFrame, failures: bool) -> list[str]:
    """Put the legend below all panels; return who is in it."""
    names = [name for name in NAMES if name in rows["contender"]]
    handles = [Line2D([], [], label=name, **STYLES[name]) for name in names]
    if failures:
        handles.append(Line2D([], [], label="failure: wrong contacts, snap-throughs, alarm, V_p", **OPEN))
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=9)
    return names


def named_scenes(rows: pl.DataFrame, truths: pl.DataFrame, column: str) -> Figure:
    """Draw one error against time, a panel for each named scene; grey below what the truth itself is known to."""
    figure = Figure(figsize=(10.8, 7.4))
    panels: Any = figure.subplots(2, 3, sharex=True, sharey=True)
    names = _legend(figure, rows, failures=True)
    timed = rows.filter(pl.col("microseconds").is_finite()).sort("setting", descending=True)
    error = pl.col(column).fill_nan(RANGE[1]).clip(*RANGE)  # a missing answer is as wrong as can be
    for axes, truth in zip(panels.flat, truths.iter_rows(named=True), strict=False):
        for name in reversed(names):  # ours on top
            curve = timed.filter(scene=truth["scene"], contender=name).with_columns(error)
            wrong = curve.filter(pl.col("failure") != "")
            axes.plot(curve["microseconds"], curve[column], **STYLES[name])
            axes.plot(wrong["microseconds"], wrong[column], **STYLES[name] | {"linestyle": ""}, mfc="white")
        axes.axhspan(RANGE[0], max(truth[f"{column}_doubt"], RANGE[0]), color="#bbbbbb", alpha=0.4, linewidth=0)
        axes.set(xscale="log", yscale="log", ylim=(RANGE[0] / 3, RANGE[1] * 3))
        axes.set(xlabel="time per approach (µs)", ylabel=ERRORS[column])
        axes.label_outer()
        axes.set_title("\n".join(wrap(f"{truth['scene']}: {truth['description']}", 44)), fontsize=9)
    return figure


def population(rows: pl.DataFrame) -> Figure:
    """Draw median and quartiles of time and of each error over the population, and the share of failures."""
    table = over_population(rows).filter(pl.col("microseconds_50").is_finite())
    figure = Figure(figsize=(10.8, 7.4))
    *panels, unused = figure.subplots(2, 3).flat
    unused.set_visible(False)
    names = _legend(figure, table, failures=False)
    curves = {name: table.filter(contender=name) for name in reversed(names)}
    for column, axes in zip(ERRORS, panels[:-1], strict=True):
        for name, curve in curves.items():
            early, time, late = (curve[f"microseconds_{q}"].to_numpy() for q in (25, 50, 75))
            low, middle, high = (curve[f"{column}_{q}"].clip(*RANGE).to_numpy() for q in (25, 50, 75))
            bars = {"yerr": (middle - low, high - middle), "xerr": (time - early, late - time), "elinewidth": 0.7}
            axes.errorbar(time, middle, **bars, **STYLES[name])
        axes.set(ylabel=ERRORS[column], yscale="log")
    for name, curve in curves.items():
        panels[-1].plot(curve["microseconds_50"], 100 * curve["failures"], **STYLES[name])
    panels[-1].set_ylabel("scenes that fail (%)")
    for axes in panels:
        axes.set(xscale="log", xlabel="time per approach (µs)")
    return figure


def _edges(centres: Sequence[float] | pl.Series) -> list[float]:
    """Edges of cells that are equally wide on a logarithmic axis."""
    half = (centres[1] / centres[0]) ** 0.5
    return [centres[0] / half, *(centre * half for centre in centres)]


def heat_map(rows: pl.DataFrame, rtol: float) -> Figure:
    """Draw error and steps over contact stiffness and damping factor; crosses where the run failed."""
    failed = pl.col("failure") != ""
    figure = Figure(figsize=(10.8, 4.6))
    panels: Any = figure.subplots(1, 2, sharey=True)
    titles = {"velocity_error": f"error of V_p (m/s), rtol {rtol:.0e}", "steps": "integration steps"}
    for axes, (column, title), colours in zip(panels, titles.items(), ("viridis", "cividis"), strict=True):
        shown = rows.with_columns(pl.when(~failed).then(pl.col(column).clip(RANGE[0])))
        cells = shown.sort("stiffness").pivot("stiffness", index="damping_factor", values=column).sort("damping_factor")
        stiffness, damping = _edges([float(name) for name in cells.columns[1:]]), _edges(cells["damping_factor"])
        values = cells[:, 1:].to_numpy()
        mesh = axes.pcolormesh(stiffness, damping, values, norm=LogNorm(), cmap=colours, edgecolors="face")
        unfinished = rows.filter(~failed, ended=0), ".", "contact not over after 1.5 s"
        for some, mark, label in ((rows.filter(failed), "x", "failed"), unfinished):
            if some.height:
                axes.plot(some["stiffness"], some["damping_factor"], mark, color=SERIES[0], markersize=3, label=label)
        axes.grid(visible=False)
        axes.set(xscale="log", yscale="log", xlabel="contact stiffness k_c (N/m^1.5)", title=title)
        figure.colorbar(mesh, ax=axes)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="lower left", fontsize=8, frameon=True)
    panels[0].set_ylabel("damping factor d")
    return figure
