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
from experiments.report.matchups import BOUND, PAPER, POLICY
from experiments.report.played import Played
from impact_gym.files import write_file
from impact_gym.task.task import VELOCITY_RANGE

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


def trade_off(played: Played, first_screen: bool = False) -> Figure:
    """Return the figure of approach time against V_p: all seeds and baselines, or the three of the first screen."""
    matchup = played.matchup
    labels = {each.name: each.plain if first_screen else each.label for each in matchup.baselines}
    names = (PAPER, matchup.rival.name) if first_screen else labels
    runs = [(labels[name], name, played.baselines[name]) for name in dict.fromkeys(names)]
    seeds = {matchup.chosen: played.policy} if first_screen else played.seeds
    runs += [(POLICY, seed, run) for seed, run in seeds.items()]
    bound = None if first_screen else played.bound
    runs += [(BOUND, BOUND, bound)] if bound else []
    data = pl.DataFrame([
        {"contestant": name, "line": line, "w": weight, **run.means(weight)}
        for name, line, run in runs
        for weight in run.weights
    ])  # fmt: skip
    data = data.with_columns(chosen=pl.col("line") == matchup.chosen)
    contestants = data["contestant"].unique(maintain_order=True).to_list()
    ordered = list(dict.fromkeys([PAPER, POLICY, *contestants]))  # these two look the same in all charts
    place = {name: min(k, len(COLOURS) - 1) for k, name in enumerate(ordered) if name in contestants}
    channels: Mapping[Any, Sequence[Any]] = {alt.Color: COLOURS, alt.StrokeDash: DASHES, alt.Shape: SHAPES}
    colour, dash, shape = (
        channel(
            "contestant:N", title=None, scale=alt.Scale(domain=list(place), range=[looks[k] for k in place.values()])
        )
        for channel, looks in channels.items()
    )
    rows = data.with_columns(pl.selectors.float().round_sig_figs(5)).to_dicts()  # to keep the page small
    base = alt.Chart(alt.Data(values=rows)).encode(  # type: ignore[no-untyped-call]  # altair leaves it untyped
        alt.X("T:Q", title=f"mean time until {matchup.until} (s)", scale=alt.Scale(zero=False, nice=True)),
        alt.Y("V:Q", title="mean V_p (m/s)", scale=alt.Scale(zero=True)),
        colour,
    )
    prominent = base.transform_filter("datum.chosen || datum.contestant != 'learned policy'")
    curves = prominent.mark_line().encode(dash, detail="line:N", order="w:Q")
    faint = base.transform_filter("!datum.chosen && datum.contestant == 'learned policy'").mark_line(
        strokeWidth=0.8, opacity=0.45
    ).encode(detail="line:N", order="w:Q")  # fmt: skip
    marks = prominent.mark_point(size=70).encode(shape, tooltip=[
        "contestant:N", alt.Tooltip("line:N", title="seed or line"),
        alt.Tooltip("w:Q", title="time weight (m/s per s)"), alt.Tooltip("T:Q", title="T (s)", format=".4f"),
        alt.Tooltip("V:Q", title="V_p (m/s)", format=".4f"), "missed:Q",
    ])  # fmt: skip
    chart = (faint + curves + marks if len(seeds) > 1 else curves + marks).add_params(ZOOM)
    places = [f"{time:.3f} s and {velocity:.3f} m/s" for time, velocity in (*played.paper.front, *played.policy.front)]
    alternative = f"Paper's rule: {places[0]}. The learned policy: from {places[1]} to {places[-1]}."
    if first_screen:
        speed = min(1.0, matchup.environment.get("velocity_range", VELOCITY_RANGE)[1])
        tuning = "" if matchup.rival.name == PAPER else f", and for which the {matchup.rival.plain} is tuned"
        caption = (
            "Down and left is better: gentler and sooner. Along each line the time weight falls from left to right. "
            f"Each mark is one time weight, which the policy observes{tuning}. The rule of the paper, Tommasino et al. "
            f"2020, moves at {speed:g} m/s and brakes at the alarm."
        )
        title = "Final speed of the object, V_p"
        return Figure(matchup.name, "answer", title, caption, alternative, chart, data, height=270, width=400)
    caption = (
        "Down and left is better. Each line joins the time weights of one contestant; faint lines are the other seeds."
    )
    if bound:
        caption += (
            f" The {BOUND} knows the object: it is the best approach that a search found for each of the first "
            f"{bound['missed'].shape[1]} scenarios."
        )
    title = f"Time until {matchup.until} against V_p, all contestants and seeds"
    return Figure(matchup.name, "trade_off", title, caption, alternative, chart, data, height=380)
