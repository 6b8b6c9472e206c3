"""The figures, drawn from the tables."""

from collections.abc import Sequence
from textwrap import wrap
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from experiments.charts import SERIES
from experiments.speed_vs_error.contenders import NAMES, OURS
from experiments.speed_vs_error.quantities import ERRORS
from experiments.speed_vs_error.records import Row
from experiments.speed_vs_error.summary import of, over_population

RANGE = (1e-16, 1e1)  # of errors; what is outside is drawn at the edge
STYLES = {
    name: {"color": colour, "marker": mark, "linestyle": line}
    for name, colour, mark, line in zip(
        NAMES,
        (*SERIES, "#000000", "#8a8a8a"),
        "os^Dv<>P",
        ("-", *4 * ("--",), *2 * (":",), "-."),
        strict=True,
    )
}


def _curve(axes: Axes, name: str, time: Any, error: Any, wrong: Any) -> None:
    """Draw one contender; open marks where the answer is a failure."""
    style = STYLES[name]
    width, size = (2.4, 5.5) if name == OURS else (1.2, 4.0)
    y = np.clip(np.nan_to_num(error, nan=RANGE[1], posinf=RANGE[1]), *RANGE)
    axes.plot(time, y, markersize=0, linewidth=width, zorder=3 if name == OURS else 2, **style)
    for open_mark in (False, True):
        here = np.asarray(wrong, dtype=bool) == open_mark
        face = "white" if open_mark else style["color"]
        axes.plot(
            np.asarray(time)[here], y[here], linestyle="", marker=style["marker"], color=style["color"],
            markerfacecolor=face, markersize=size, zorder=4 if name == OURS else 3,
        )  # fmt: skip


def _legend(figure: Figure, names: Sequence[str], failures: bool) -> None:
    """Put the legend below all panels."""
    size = {name: 6.0 if name == OURS else 4.5 for name in names}
    handles = [mpl.lines.Line2D([], [], markersize=size[name], label=name, **STYLES[name]) for name in names]
    if failures:
        open_mark = {"marker": "o", "linestyle": "", "color": "#555555", "markerfacecolor": "white"}
        handles.append(
            mpl.lines.Line2D([], [], label="failure: wrong contacts, snap-throughs, alarm, V_p", **open_mark)
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=9)


def named_scenes(rows: Sequence[Row], truths: Sequence[Row], column: str) -> Figure:
    """Draw one error against time, a panel for each named scene; grey below what the truth itself is known to."""
    figure = Figure(figsize=(10.8, 7.4))
    panels: Any = figure.subplots(2, 3, sharex=True, sharey=True)
    for axes, truth in zip(panels.flat, truths, strict=False):
        here = of(rows, scene=truth["scene"])
        for name in NAMES:
            curve = sorted(of(here, contender=name), key=lambda row: -float(row["setting"]))
            curve = [row for row in curve if np.isfinite(row["microseconds"])]
            if curve:
                wrong = [bool(row["failure"]) for row in curve]
                _curve(axes, name, [row["microseconds"] for row in curve], [row[column] for row in curve], wrong)
        axes.axhspan(RANGE[0], max(truth[f"{column}_doubt"], RANGE[0]), color="#bbbbbb", alpha=0.4, linewidth=0)
        axes.set(xscale="log", yscale="log", ylim=(RANGE[0] / 3, RANGE[1] * 3))
        axes.set_title("\n".join(wrap(f"{truth['scene']}: {truth['description']}", 44)), fontsize=9)
    for axes in panels[:, 0]:
        axes.set_ylabel(ERRORS[column])
    for axes in panels[-1]:
        axes.set_xlabel("time per approach (µs)")
    _legend(figure, [name for name in NAMES if of(rows, contender=name)], failures=True)
    return figure


def population(rows: Sequence[Row]) -> Figure:
    """Draw median and quartiles of time and of each error over the population, and the share of failures."""
    table = over_population(rows)
    figure = Figure(figsize=(10.8, 7.4))
    grid: Any = figure.subplots(2, 3)
    panels = dict(zip((*ERRORS, "failures"), (*grid[0], *grid[1, :2]), strict=True))
    grid[1, 2].set_visible(False)
    names = [name for name in NAMES if of(table, contender=name)]
    for column, axes in panels.items():
        for name in names:
            curve = [row for row in of(table, contender=name) if np.isfinite(row["microseconds_50"])]
            time = np.array([row["microseconds_50"] for row in curve])
            if column == "failures":
                axes.plot(time, [100 * row["failures"] for row in curve], markersize=4, **STYLES[name])
                continue
            low, middle, high = (np.clip([row[f"{column}_{q}"] for row in curve], *RANGE) for q in (25, 50, 75))
            early, late = (np.array([row[f"microseconds_{q}"] for row in curve]) for q in (25, 75))
            axes.errorbar(
                time, middle, yerr=(middle - low, high - middle), xerr=(time - early, late - time),
                markersize=4, elinewidth=0.7, linewidth=2.2 if name == OURS else 1.2, **STYLES[name],
            )  # fmt: skip
        axes.set(xscale="log", xlabel="time per approach (µs)", ylabel=ERRORS.get(column, "scenes that fail (%)"))
        if column != "failures":
            axes.set(yscale="log")
    _legend(figure, names, failures=False)
    return figure


def _edges(centres: Any) -> Any:
    """Edges of cells that are equally wide on a logarithmic axis."""
    logarithms = np.log(centres)
    middles = (logarithms[1:] + logarithms[:-1]) / 2
    first, last = 2 * logarithms[0] - middles[0], 2 * logarithms[-1] - middles[-1]
    return np.exp(np.concatenate(([first], middles, [last])))


def heat_map(rows: Sequence[Row], rtol: float) -> Figure:
    """Draw error and steps over contact stiffness and damping factor; crosses where the run failed."""
    stiffness = np.array(sorted({row["stiffness"] for row in rows}))
    damping = np.array(sorted({row["damping_factor"] for row in rows}))
    shape = (len(damping), len(stiffness))
    ordered = sorted(rows, key=lambda row: (row["damping_factor"], row["stiffness"]))
    columns = {name: np.array([row[name] for row in ordered]).reshape(shape) for name in ("velocity_error", "steps")}
    failed = np.array([bool(row["failure"]) for row in ordered]).reshape(shape)
    endless = np.array([not row["ended"] and not row["failure"] for row in ordered]).reshape(shape)
    figure = Figure(figsize=(10.8, 4.6))
    panels: Any = figure.subplots(1, 2, sharey=True)
    titles = (f"error of V_p (m/s), rtol {rtol:.0e}", "integration steps")
    for axes, values, title, colours in zip(panels, columns.values(), titles, ("viridis", "cividis"), strict=True):
        shown = np.ma.masked_where(failed, np.maximum(values, RANGE[0]))
        mesh = axes.pcolormesh(
            _edges(stiffness), _edges(damping), shown, norm=LogNorm(), cmap=colours, edgecolors="face"
        )
        for mask, mark, label in ((failed, "x", "failed"), (endless, ".", "contact not over after 1.5 s")):
            row, column = np.nonzero(mask)
            if row.size:
                axes.plot(stiffness[column], damping[row], mark, color="#D55E00", markersize=3, label=label)
        axes.grid(visible=False)
        axes.set(xscale="log", yscale="log", xlabel="contact stiffness k_c (N/m^1.5)", title=title)
        figure.colorbar(mesh, ax=axes)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="lower left", fontsize=8, frameon=True)
    panels[0].set_ylabel("damping factor d")
    return figure
