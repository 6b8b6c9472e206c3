"""The style of all charts, and a function that saves a chart as SVG."""

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Text

from experiments.lab import colours
from experiments.lab.page import mathtext
from impact_gym.files import write_file
from impact_gym.render import palette

mpl.use("agg")
mpl.rcParams.update(
    {
        "figure.constrained_layout.use": True,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.color": palette.GRID,
        "grid.linewidth": 0.6,
        "lines.linewidth": 1.6,
        "font.size": 10,
        "legend.frameon": False,
        **dict.fromkeys(("figure.facecolor", "axes.facecolor", "savefig.facecolor"), "none"),
        **dict.fromkeys(("text.color", "axes.labelcolor", "xtick.color", "ytick.color", "axes.edgecolor"), palette.INK),
        "svg.fonttype": "none",
        "svg.hashsalt": "impact_gym",
    }
)

RULE, POLICY, PROFILE, PERSON = palette.RULE, palette.POLICY, palette.PROFILE, palette.PERSON
FLANGE, TOOL, OBJECT, FORCE = palette.FLANGE, palette.TOOL, palette.OBJECT, palette.FORCE
SERIES = (RULE, POLICY, PROFILE, PERSON, palette.WARNING, FORCE)
OTHERS = FLANGE  # colour of each further series, if SERIES has too few colours


def save(figure: Figure, path: Path) -> Path:
    """Write `figure` as SVG with subscripts and a light and a dark palette; equal figures give equal files."""
    for text in figure.findobj(Text):
        text.set_text(mathtext(text.get_text()))
    file = io.StringIO()
    canvas: Any = FigureCanvasSVG(figure)  # `print_svg` has no types; `savefig` would draw twice
    canvas.print_svg(file, metadata={"Date": None})
    return write_file(path, colours.adaptive(file.getvalue()))
