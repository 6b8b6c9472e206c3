"""Figures of the page, and their common style.

A figure is a Vega-Lite chart. On the page it is interactive; on the first screen it is an SVG, which needs no script.
On disk it is an SVG, with a CSV of its data. Series differ in dash or shape as well as in colour.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import altair as alt
import polars as pl
import vl_convert
from markupsafe import Markup

from experiments.lab.charts import OTHERS, SERIES
from experiments.lab.results import csv_of
from experiments.report.matchups import PAPER, POLICY
from impact_gym.files import write_file

COLOURS = (*SERIES, OTHERS)
DASHES = ([1, 0], [1, 0], [6, 3], [2, 2], [8, 3, 2, 3], [4, 4], [1, 3])
ZOOM: Any = alt.selection_interval(bind="scales", zoom="wheel![event.ctrlKey]")
"""Readers pan a chart by dragging, zoom with Ctrl and wheel, and reset by a double click."""
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
    """A chart of a matchup with its texts and its data."""

    matchup: str
    key: str  # part of the names of the figure's files
    title: str
    caption: str
    alternative: str  # text alternative
    chart: Any
    data: pl.DataFrame
    height: int = 320  # pixels
    width: int = 640  # of the file

    @property
    def name(self) -> str:
        """Name of the figure's files, without suffix."""
        return f"{self.matchup}_{self.key}"

    @cached_property
    def spec(self) -> dict[str, Any]:
        """The chart as Vega-Lite, as wide as its container."""
        chart = self.chart.properties(width="container", height=self.height, description=self.alternative)
        content = chart.configure(**CONFIG).to_dict(validate=False)  # rendering it as SVG validates it
        text = json.dumps(content, ensure_ascii=False)
        return json.loads(text.replace("V_p", "Vₚ").replace("m^1.5", "m¹·⁵"))  # charts take no HTML

    @cached_property
    def still(self) -> Markup:
        """The chart as SVG for the page, as large as its container, in colours of the page."""
        svg = vl_convert.vegalite_to_svg(self.spec | {"width": self.width})
        return Markup(re.sub(r'(<svg [^>]*?) width="[^"]*" height="[^"]*"', r"\1", svg, count=1))

    def save(self, folder: Path) -> list[str]:
        """Write the chart as SVG and its data as CSV; return the names of these files."""
        svg = vl_convert.vegalite_to_svg(self.spec | {"width": self.width, "background": "white"})
        files = {f"{self.name}.svg": svg, f"{self.name}.csv": csv_of(self.data)}
        return [write_file(folder / name, content).name for name, content in files.items()]


def chart_of(data: pl.DataFrame, digits: int = 5) -> alt.Chart:
    """Return an empty chart of `data`, with floats rounded to `digits` significant digits to keep the page small."""
    rows = data.with_columns(pl.selectors.float().round_sig_figs(digits)).to_dicts()
    return alt.Chart(alt.Data(values=rows))  # type: ignore[no-untyped-call]  # altair leaves it untyped


def looks_of(data: pl.DataFrame, policy: str = POLICY) -> list[Any]:
    """Return the channels colour, dash and shape; the paper's rule and the `policy` look the same in all charts."""
    contestants = data["contestant"].unique(maintain_order=True).to_list()
    ordered = list(dict.fromkeys([PAPER, policy, *contestants]))
    place = {name: min(k, len(COLOURS) - 1) for k, name in enumerate(ordered) if name in contestants}
    channels: Mapping[Any, Sequence[Any]] = {alt.Color: COLOURS, alt.StrokeDash: DASHES, alt.Shape: SHAPES}
    scales = [alt.Scale(domain=list(place), range=[looks[k] for k in place.values()]) for looks in channels.values()]
    return [channel("contestant:N", title=None, scale=scale) for channel, scale in zip(channels, scales, strict=True)]
