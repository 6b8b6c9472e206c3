"""The figures, drawn from the tables."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.lab.charts import SERIES
from experiments.lab.tables import Row
from experiments.speed_vs_error.contenders import OURS
from experiments.stability import promises, rivals
from experiments.stability.agreement import SHARE

# from good to bad, told apart by lightness as well
SHADES = dict(zip(rivals.CLASSES, ("#009E73", "#9BD8C3", "#E69F00", "#D55E00", "#56B4E9", "#999999"), strict=True))
COUPLINGS = {"rigid": "#0072B2", "spring": "#E69F00", "bistable": "#CC79A7"}
MARKS = "os^Dv<>"
POINTS = 400  # of a curve


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
            (panels[1, 1], errors, 1e-16, SHARE, "error of V_p against the independent solver"),
        ):
            _share_above(axes, np.asarray(values), floor, bar, name, color=colour, label=coupling)
    for axes in panels[:, 0]:
        axes.set_ylabel("scenes above (%)")
    panels[0, 0].legend(title="coupling")
    return figure


def who_stands(table: Sequence[Row]) -> Figure:
    """What became of each rival on the same scenes: bars of shares."""
    figure = Figure(figsize=(10.8, 5.6))
    axes = figure.subplots()
    frame, left = pl.DataFrame(table).reverse(), np.zeros(len(table))
    style = {"edgecolor": "white", "linewidth": 0.5}
    for kind, colour in SHADES.items():
        shares = 100 * frame[kind].to_numpy()
        drawn = axes.barh(frame["contender"], shares, left=left, color=colour, label=kind, **style)
        axes.bar_label(drawn, fmt=lambda x: f"{x:.0f}" if x >= 4 else "", label_type="center", fontsize=8)
        left = left + shares
    axes.set(xlabel=f"share of {table[0]['scenes']} scenes (%)", xlim=(0, 100))
    axes.grid(visible=False, axis="y")
    figure.legend(loc="outside lower center", ncols=3, fontsize=9)
    return figure


PANELS = {
    "onset": ("Across the onset at a fixed step", "steps in the contact", "error of V_p / v"),
    "graze": ("A touch and a parting in one step", "tool passes the face by (m)", "touches found (%)"),
    "slow": ("A slow contact under a push", "approach velocity v_in (m/s)", "attempted steps"),
    "tolerance": ("Tolerances in metres, contact of 3e-7 m", "rtol", "relative error of V_p"),
}


def hard_cases(rows: Sequence[Row]) -> Figure:
    """What fails elsewhere and not here, a panel for each cause."""
    figure = Figure(figsize=(10.8, 8.2))
    grid: Any = figure.subplots(2, 2)
    frame = pl.DataFrame(rows, infer_schema_length=None).sort(pl.col("contender") != OURS, "contender", "x")
    for axes, (panel, (title, x, y)) in zip(grid.flat, PANELS.items(), strict=True):
        curves = frame.filter(pl.col("scene") == panel).group_by("contender", maintain_order=True)
        scale = 100 if panel == "graze" else 1
        for place, ((name,), curve) in enumerate(curves):
            width, colour, order = (2.4, "#000000", 3) if name == OURS else (1.3, SERIES[place % len(SERIES)], 2)
            style = {"linewidth": width, "color": colour, "zorder": order, "marker": MARKS[place % len(MARKS)]}
            axes.plot(curve["x"], scale * curve["y"], markersize=4, label=name, **style)
        axes.set(xscale="log", xlabel=x, ylabel=y, title=title)
        if panel != "graze":
            axes.set_yscale("log")
        if panel != "onset":
            axes.invert_xaxis()
        axes.legend(fontsize=8, frameon=True)
    return figure
