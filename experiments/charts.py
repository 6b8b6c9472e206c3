"""The look of every chart: colours a colour-blind reader can tell apart, units on every axis, vector graphics."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impact_gym.files import whole_file
from impact_gym.simulation import Trace

mpl.use("agg")
mpl.rcParams.update(
    {
        "figure.constrained_layout.use": True,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.color": "#dddddd",
        "grid.linewidth": 0.6,
        "lines.linewidth": 1.6,
        "font.size": 10,
        "legend.frameon": False,
        "svg.fonttype": "none",
        "svg.hashsalt": "impact_gym",
    }
)

# Okabe and Ito (2008)
FLANGE, TOOL, OBJECT, FORCE, COUPLING = "#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7"
SERIES = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def save(figure: Figure, path: Path) -> Path:
    """Write `figure` as SVG without a date in it, so that the same data give the same file."""
    with whole_file(path) as file:
        figure.savefig(file, format="svg", metadata={"Date": None})
    return path


def velocities(axes: Axes, trace: Trace) -> None:
    """Velocities of flange, tool and object against time, as in the paper's Fig. 13 to 25."""
    axes.plot(trace.time, trace.flange_velocity, color=FLANGE, linestyle=(0, (4, 2)), label="flange")
    axes.plot(trace.time, trace.tool_velocity, color=TOOL, label="tool")
    axes.plot(trace.time, trace.object_velocity, color=OBJECT, label="object")
    axes.set(xlabel="time (s)", ylabel="velocity (m/s)")
    axes.legend()


def time_histories(runs: Mapping[str, tuple[Trace, str]], window: tuple[float, float]) -> Figure:
    """Velocities above, contact force below, a column per run; `runs` maps a title to a trace and a remark."""
    figure = Figure(figsize=(5.2 * len(runs), 6.0))
    grid: Any = figure.subplots(2, len(runs), sharex=True, sharey="row", squeeze=False, height_ratios=(3, 2))
    for column, (title, (trace, remark)) in enumerate(runs.items()):
        velocities(grid[0, column], trace)
        grid[0, column].set(title=f"{title}\n{remark}", xlabel="", xlim=window)
        grid[1, column].plot(trace.time, trace.contact_force, color=FORCE)
        grid[1, column].axhline(1.0, color="#888888", linewidth=0.8, linestyle=":")
        grid[1, column].set(xlabel="time (s)", ylabel="contact force (N)")
        grid[1, column].annotate(
            "alarm threshold, 1 N", (window[0], 1.0), (3, 3), textcoords="offset points", fontsize=8
        )
    return figure


def trade_off(
    points: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]], means_only: Sequence[str]
) -> Figure:
    """Approach time against V_p, a dot per scenario and a large mark for the mean of each controller.

    Those in `means_only` show their mean alone. Down and left is better.
    """
    figure = Figure(figsize=(8.0, 5.6))
    axes = figure.subplots()
    marks = "osD^vP"
    for colour, mark, (name, (times, velocity)) in zip(SERIES, marks, points.items(), strict=False):
        if name not in means_only:
            axes.scatter(times, velocity, s=9, alpha=0.35, color=colour, linewidths=0, rasterized=True)
        axes.scatter(
            times.mean(), velocity.mean(), s=130, color=colour, marker=mark, edgecolors="black", zorder=3,
            label=f"{name}: mean {times.mean():.3f} s, {velocity.mean():.3f} m/s",
        )  # fmt: skip
    axes.set(xlabel="approach time (s)", ylabel="final object velocity V_p (m/s)", ylim=(0, None))
    axes.legend(loc="upper right")
    return figure
