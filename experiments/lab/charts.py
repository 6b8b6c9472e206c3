"""Style of all charts: colours for colour-blind readers, units on every axis, vector graphics."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Text

from experiments.lab.page import mathtext
from impact_gym.files import whole_file
from impact_gym.outcome import Trace

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
SERIES = (OBJECT, TOOL, FORCE, COUPLING, "#E69F00", "#56B4E9")
OTHERS = "#8A8A8A"  # when no colour is left


def save(figure: Figure, path: Path) -> Path:
    """Write `figure` as SVG, with subscripts and without a date, so that equal data give equal files."""
    for text in figure.findobj(Text):
        text.set_text(mathtext(text.get_text()))
    with whole_file(path) as file:
        canvas: Any = FigureCanvasSVG(figure)  # `print_svg` has no types; `savefig` would draw twice
        canvas.print_svg(file, metadata={"Date": None})
    return path


def velocities(axes: Axes, trace: Trace) -> None:
    """Velocities of flange, tool and object against time, as in the paper's Fig. 13 to 25."""
    axes.plot(trace.time, trace.flange_velocity, color=FLANGE, linestyle=(0, (4, 2)), label="flange")
    axes.plot(trace.time, trace.tool_velocity, color=TOOL, label="tool")
    axes.plot(trace.time, trace.object_velocity, color=OBJECT, label="object")
    axes.set(xlabel="time (s)", ylabel="velocity (m/s)")
    axes.legend()
