"""Figures and tables of the page, and the look that all charts share.

A figure is a Vega-Lite chart: in the page it can be hovered and zoomed, on disk it stands as SVG with its data beside
it. Colours are those of Okabe and Ito (2008), and every series has a dash or a shape of its own as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import altair as alt
import polars as pl
import vl_convert

from experiments.report.matchups import PAPER, POLICY
from impact_gym.files import whole_file

COLOURS = ("#D55E00", "#0072B2", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#8A8A8A")
DASHES = ([1, 0], [1, 0], [6, 3], [2, 2], [8, 3, 2, 3], [4, 4], [1, 3])
SHAPES = ("cross", "circle", "square", "diamond", "triangle-up", "triangle-down", "triangle-right")
CONFIG: dict[str, Any] = {
    "font": "system-ui, sans-serif",
    "background": "transparent",
    "view": {"stroke": None},
    "axis": {"labelFontSize": 12, "titleFontSize": 12, "titleFontWeight": "normal", "gridOpacity": 0.6,
             "labelOverlap": "greedy", "labelSeparation": 6},
    "legend": {"labelFontSize": 12, "titleFontSize": 12, "titleFontWeight": "normal", "orient": "top", "columns": 2,
               "labelLimit": 0, "symbolStrokeWidth": 2.5, "symbolOpacity": 1},
    "line": {"strokeWidth": 2.2},
    "point": {"filled": True, "size": 55, "opacity": 1},
    "range": {"category": list(COLOURS)},
}  # fmt: skip


@dataclass(frozen=True)
class Figure:
    """A chart, what it shows, and its data."""

    name: str  # of its files
    title: str
    caption: str
    alternative: str  # what it says, for one who does not see it
    chart: Any
    data: pl.DataFrame
    height: int = 320  # pixels

    @cached_property
    def spec(self) -> dict[str, Any]:
        """The chart as Vega-Lite, as wide as what holds it."""
        chart = self.chart.properties(width="container", height=self.height, description=self.alternative)
        return chart.configure(**CONFIG).to_dict(validate=False)  # a wrong one would not become the SVG

    def save(self, folder: Path) -> None:
        """Write the chart as SVG and its data as CSV."""
        spec = self.spec | {"width": 640, "background": "white"}
        with whole_file(folder / f"{self.name}.svg") as file:
            file.write(vl_convert.vegalite_to_svg(spec).encode())
        with whole_file(folder / f"{self.name}.csv") as file:
            file.write(self.data.write_csv().encode())


@dataclass(frozen=True)
class Table:
    """Rows of words; the first column names the row."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def zoomable(chart: Any) -> Any:
    """Return a chart that is dragged, zoomed with the wheel while Ctrl is held, and put back with a double click."""
    return chart.add_params(alt.selection_interval(bind="scales", zoom="wheel![event.ctrlKey]"))


def rows(data: pl.DataFrame, fields: Sequence[str] | None = None, digits: int = 5) -> Any:
    """Return what a chart is given: only `fields`, floats to so many digits: the page must stay small."""
    chosen = data.select(fields) if fields else data
    floats = [name for name, kind in chosen.schema.items() if kind in (pl.Float64, pl.Float32)]
    return alt.Data(values=chosen.with_columns(pl.col(floats).round_sig_figs(digits)).to_dicts())


def contestants(names: Sequence[str]) -> dict[str, Any]:
    """Return colour, dash and shape scales for contestants: the paper's rule and the policy look alike everywhere."""
    fixed = {PAPER: 0, POLICY: 1}
    free = iter(range(2, len(COLOURS)))
    places = [fixed[name] if name in fixed else next(free, len(COLOURS) - 1) for name in names]
    return {
        "color": alt.Scale(domain=list(names), range=[COLOURS[place] for place in places]),
        "dash": alt.Scale(domain=list(names), range=[DASHES[place] for place in places]),
        "shape": alt.Scale(domain=list(names), range=[SHAPES[place] for place in places]),
    }


def percent(estimate: Any, digits: int = 1) -> str:
    """Return a share with its interval in percent."""
    value, low, high = (100.0 * one for one in (estimate.value, estimate.low, estimate.high))
    return f"{value:.{digits}f} % [{low:.{digits}f}, {high:.{digits}f}]"


def plain(estimate: Any, digits: int = 3) -> str:
    """Return a number with its interval."""
    return f"{estimate.value:.{digits}f} [{estimate.low:.{digits}f}, {estimate.high:.{digits}f}]"
