"""The figures, drawn from the tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.charts import SERIES, save
from experiments.speed_vs_error.contenders import OURS
from experiments.speed_vs_error.records import Row
from experiments.stability import bars
from experiments.stability.agreement import SHARE, relative_error
from experiments.stability.rivals import CLASSES
from impact_gym.files import whole_file

# from good to bad, told apart by lightness as well
SHADES = dict(zip(CLASSES, ("#009E73", "#9BD8C3", "#E69F00", "#D55E00", "#56B4E9", "#999999"), strict=True))
COUPLINGS = {"rigid": "#0072B2", "spring": "#E69F00", "bistable": "#CC79A7"}
MARKS = "os^Dv<>"
POINTS = 400  # of a curve


def both(figure: Figure, path: Path) -> None:
    """Write a figure as SVG, and as PNG beside it."""
    save(figure, path)
    with whole_file(path.with_suffix(".png")) as file:
        figure.savefig(file, format="png", dpi=150, metadata={"Software": None})


def _share_above(axes: Axes, values: Any, floor: float, bar: float, name: str, **style: Any) -> None:
    """Draw which share of the scenes is above a value; what is below `floor` is drawn there."""
    ordered = np.sort(np.maximum(values, floor))
    size = len(ordered)
    # every one of the worst, and no more of the rest than can be told apart
    places = np.unique(size - np.unique(np.geomspace(1, size, POINTS).astype(int)))
    axes.plot(ordered[places], 100 * (1 - places / size), drawstyle="steps-pre", **style)
    axes.axvline(bar, color="black", linewidth=0.9, linestyle=(0, (4, 2)))
    axes.set(xscale="log", yscale="log", xlabel=name)


def storm(columns: Mapping[str, Any], agreement: Sequence[Row]) -> Figure:
    """Which share of the scenes is above a time, number of steps, momentum error, error of V_p."""
    figure = Figure(figsize=(10.8, 6.6))
    panels: Any = figure.subplots(2, 2, sharey=True)
    done = columns["failure"] == ""
    for coupling, colour in COUPLINGS.items():
        of = np.char.startswith(columns["coupling"].astype(str), coupling)
        timed = of & np.isfinite(columns["milliseconds"])
        style = {"color": colour, "label": coupling}
        _share_above(panels[0, 0], columns["milliseconds"][timed], 1e-2, bars.SLOWEST, "time of a run (ms)", **style)
        _share_above(panels[0, 1], columns["steps"][of & done], 1, 1e6, "steps of a run", **style)
        worst = np.fmax(columns["momentum_error"], columns["impulse_error"])
        known = of & done & np.isfinite(worst)
        _share_above(panels[1, 0], worst[known], 1e-16, bars.MOMENTUM, "momentum error over impulse", **style)
        errors = [
            relative_error(row["velocity"], row["true_velocity"], row["speed"])
            for row in agreement
            if row["coupling"].startswith(coupling) and not row["failure"]
        ]
        if errors:
            label = "error of V_p against the independent solver"
            _share_above(panels[1, 1], errors, 1e-16, SHARE, label, **style)
    for axes in panels[:, 0]:
        axes.set_ylabel("scenes above (%)")
    panels[0, 0].legend(title="coupling")
    return figure


def rivals(table: Sequence[Row], size: int) -> Figure:
    """What became of each rival on the same scenes: bars of shares."""
    figure = Figure(figsize=(10.8, 5.6))
    axes = figure.subplots()
    names = [row["contender"] for row in table][::-1]
    left = np.zeros(len(table))
    for kind, colour in SHADES.items():
        shares = 100 * np.array([row[kind] for row in table])[::-1]
        axes.barh(names, shares, left=left, color=colour, label=kind, edgecolor="white", linewidth=0.5)
        for place, (start, share) in enumerate(zip(left, shares, strict=True)):
            if share >= 4:
                axes.text(start + share / 2, place, f"{share:.0f}", ha="center", va="center", fontsize=8)
        left = left + shares
    axes.set(xlabel=f"share of {size} scenes (%)", xlim=(0, 100))
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
    for axes, (panel, (title, x, y)) in zip(grid.flat, PANELS.items(), strict=True):
        here = [row for row in rows if row["scene"] == panel]
        names = sorted({row["contender"] for row in here}, key=lambda name: (name != OURS, name))
        for place, name in enumerate(names):
            curve = sorted((row["x"], row["y"]) for row in here if row["contender"] == name)
            values: Any = np.array(curve).T
            width, colour = (2.4, "#000000") if name == OURS else (1.3, SERIES[place % len(SERIES)])
            scale = 100 if panel == "graze" else 1
            axes.plot(
                values[0], scale * values[1], marker=MARKS[place % len(MARKS)], markersize=4, linewidth=width,
                color=colour, label=name, zorder=3 if name == OURS else 2,
            )  # fmt: skip
        axes.set(xscale="log", xlabel=x, ylabel=y, title=title)
        if panel != "graze":
            axes.set_yscale("log")
        if panel != "onset":
            axes.invert_xaxis()
        axes.legend(fontsize=8, frameon=True)
    return figure
