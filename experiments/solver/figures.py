"""The figures of both pages, drawn from the tables."""

from collections.abc import Sequence
from math import ceil
from textwrap import wrap
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.lab.charts import SERIES
from experiments.lab.tables import Row
from experiments.solver import promises
from experiments.solver.solutions import CLASSES, ERRORS, OURS
from experiments.solver.timing import NAMES

RANGE = (1e-16, 1e1)  # of errors; what is outside is drawn at the edge
MARKS = "os^Dv<>PX"
LINES = ("-", *4 * ("--",), *2 * (":",), "-.")
COLOURS = (*SERIES, "#000000", "#8a8a8a")
STYLES: dict[str, dict[str, Any]] = {
    name: {"color": colour, "marker": mark, "linestyle": line, "linewidth": 1.2, "markersize": 4}
    for name, colour, mark, line in zip(NAMES, COLOURS, MARKS, LINES, strict=False)
}
STYLES[OURS]["linewidth"] = 2.4
OPEN: dict[str, Any] = {"marker": "o", "linestyle": "", "color": "#555555", "markerfacecolor": "white"}
# from good to bad, told apart by lightness as well
SHADES = dict(zip(CLASSES, ("#009E73", "#9BD8C3", "#E69F00", "#D55E00", "#56B4E9", "#999999"), strict=True))
COUPLINGS = {"rigid": "#0072B2", "spring": "#E69F00", "bistable": "#CC79A7"}
POINTS = 400  # of a curve


def named_scenes(rows: pl.DataFrame, truths: pl.DataFrame, column: str) -> Figure:
    """Draw one error against time, a panel for each named scene; grey below what the truth itself is known to."""
    lines, columns = ceil(truths.height / 3), min(truths.height, 3)
    figure = Figure(figsize=(3.6 * columns, 3.7 * lines))
    panels: Any = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)
    names = [name for name in NAMES if name in rows["contender"]]
    handles = [Line2D([], [], label=name, **STYLES[name]) for name in names]
    handles.append(Line2D([], [], label="failure: wrong contacts, snap-throughs, alarm, V_p", **OPEN))
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=9)
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


def _share_above(axes: Axes, values: Any, floor: float, bar: float, name: str, **style: Any) -> None:
    """Draw which share of the scenes is above a value; what is below `floor` is drawn there."""
    ordered = np.sort(np.maximum(values[np.isfinite(values)], floor))
    size = len(ordered)
    if not size:
        return
    # every one of the worst, and no more of the rest than can be told apart
    places = np.unique(size - np.unique(np.geomspace(1, size, POINTS).astype(int)))
    axes.plot(ordered[places], 100 * (1 - places / size), drawstyle="steps-pre", **style)
    axes.axvline(bar, color="black", linewidth=0.9, linestyle=(0, (4, 2)))
    axes.set(xscale="log", yscale="log", xlabel=name)


def storm(rows: Sequence[Row], agreement: Sequence[Row]) -> Figure:
    """Which share of the scenes is above a time, number of steps, momentum error, error of V_p."""
    figure = Figure(figsize=(10.8, 6.6))
    panels: Any = figure.subplots(2, 2, sharey=True)
    frame = pl.DataFrame(rows, infer_schema_length=None)
    for coupling, colour in COUPLINGS.items():
        of = frame.filter(pl.col("coupling").str.starts_with(coupling))
        done = of.filter(pl.col("failure") == "")
        judged = [row for row in agreement if row["coupling"].startswith(coupling) and not row["failure"]]
        errors = [row["velocity_error"] for row in judged]
        momentum = np.fmax(done["momentum_error"], done["impulse_error"])
        for axes, values, floor, bar, name in (
            (panels[0, 0], of["milliseconds"], 1e-2, promises.SLOWEST, "time of a run (ms)"),
            (panels[0, 1], done["steps"], 1, 1e6, "steps of a run"),
            (panels[1, 0], momentum, 1e-16, promises.MOMENTUM, "momentum error over impulse"),
            (panels[1, 1], errors, 1e-16, promises.AGREEMENT, "error of V_p against the independent solver"),
        ):
            _share_above(axes, np.asarray(values), floor, bar, name, color=colour, label=coupling)
    for axes in panels[:, 0]:
        axes.set_ylabel("scenes above (%)")
    panels[0, 0].legend(title="coupling")
    return figure


def who_stands(shares: Sequence[Row]) -> Figure:
    """What became of each rival on the same scenes: bars of shares."""
    figure = Figure(figsize=(10.8, 5.6))
    axes = figure.subplots()
    frame, left = pl.DataFrame(shares).reverse(), np.zeros(len(shares))
    for kind, colour in SHADES.items():
        widths = 100 * frame[kind].to_numpy()
        bars = axes.barh(
            frame["contender"], widths, left=left, color=colour, label=kind, edgecolor="white", linewidth=0.5
        )
        axes.bar_label(bars, fmt=lambda x: f"{x:.0f}" if x >= 4 else "", label_type="center", fontsize=8)
        left = left + widths
    axes.set(xlabel=f"share of {shares[0]['scenes']} scenes (%)", xlim=(0, 100))
    axes.grid(visible=False, axis="y")
    figure.legend(loc="outside lower center", ncols=3, fontsize=9)
    return figure
