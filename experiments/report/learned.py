"""The learned approach."""

import altair as alt
import polars as pl

from experiments.report.figures import Figure, chart_of, looks_of, zoomable
from experiments.report.played import Played
from experiments.report.results import watched_at


def approach(played: Played) -> Figure:
    """Return velocity over position before the contact, of the policy, its rival and the paper's rule."""
    matchup, ahead = played.matchup, played.paper.scenario["distance"]
    data = pl.concat(
        pl.DataFrame({"contestant": matchup.labels[name], "w": weight, "x": run["position"], "velocity": velocity})
        for name, run in played.profiles.items()
        for weight, velocity in zip(run.weights, run["velocity"], strict=True)
    ).drop_nans("velocity")
    looks = looks_of(data)
    chart = chart_of(data, 4).mark_line().encode(
        alt.X("x:Q", title="flange position (m)"),
        alt.Y("velocity:Q", title="flange velocity (m/s)"),
        alt.Opacity("w:O", title="time weight (m/s per s)", scale=alt.Scale(range=[1.0, 0.7, 0.45])),
        looks.colour, looks.dash, detail="w:N", order="x:Q",
        tooltip=["contestant:N", alt.Tooltip("w:N", title="time weight"), alt.Tooltip("x:Q", format=".3f"),
                 alt.Tooltip("velocity:Q", format=".3f")],
    )  # fmt: skip
    caption = (
        f"Nothing stands in the way here; in the scenarios objects are {ahead.min():.2f} to {ahead.max():.2f} m ahead."
        if matchup.environment.get("range_noise") is None
        else f"The object stands at {watched_at(matchup):.3g} m and the estimate is right."
    )
    subject = "velocity over position before the contact"
    return Figure(matchup.name, "approach", subject, caption, caption, zoomable(chart), data, 340)
