"""The style of charts, and a function that saves a chart as SVG."""

import io
import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Text

from experiments.lab import colours
from impact_gym.render import palette
from impact_gym.support.files import write_file

mpl.use("agg")
mpl.rc("figure", facecolor="none")
mpl.rc("figure.constrained_layout", use=True)
mpl.rc("axes", facecolor="none", grid=True, labelcolor=palette.INK, edgecolor=palette.INK)
mpl.rc("axes.spines", top=False, right=False)
mpl.rc("xtick", color=palette.INK)
mpl.rc("ytick", color=palette.INK)
mpl.rc("text", color=palette.INK)
mpl.rc("grid", color=palette.GRID, linewidth=0.6)
mpl.rc("lines", linewidth=1.6)
mpl.rc("font", size=10)
mpl.rc("legend", frameon=False)
mpl.rc("savefig", facecolor="none")
mpl.rc("svg", fonttype="none", hashsalt="impact_gym")

SERIES = (palette.RULE, palette.POLICY, palette.PROFILE, palette.PERSON, palette.WARNING, palette.FORCE)
OTHERS = palette.FLANGE  # colour of each further series, if SERIES has too few colours
SYMBOL = re.compile(r"\b([A-Za-z])_([a-z]{1,2}|[A-Z])\b")
POWER = re.compile(r"\^(?:\(([^()]+)\)|(-?\d+(?:\.\d+)?))")


def mathtext(text: str) -> str:
    """Return text with subscripts and superscripts for matplotlib; text between dollar signs is not changed."""
    pieces = text.split("$")
    pieces[::2] = [POWER.sub(r"$^{\1\2}$", SYMBOL.sub(r"$\1_{\2}$", piece)) for piece in pieces[::2]]
    return "$".join(pieces)


def save(figure: Figure, path: Path) -> Path:
    """Write `figure` as SVG with subscripts and a light and a dark palette; equal figures give equal files."""
    for text in figure.findobj(Text):
        text.set_text(mathtext(text.get_text()))
    file = io.StringIO()
    canvas: Any = FigureCanvasSVG(figure)  # Any: `print_svg` has no types; `savefig` would draw the figure twice
    canvas.print_svg(file, metadata={"Date": None})
    return write_file(path, colours.adaptive(file.getvalue()))
