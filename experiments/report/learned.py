"""What it learned: how it approaches, how it reacts, and what urgency changes."""

import altair as alt
import numpy as np
import polars as pl

from experiments.lab.statistics import quantile_groups
from experiments.report.figures import Figure, chart_of, looks_of, zoomable
from experiments.report.played import Played
from experiments.report.results import watched_at
from impact_gym.task import Task

BANDS = 5  # groups of episodes by the force sensed


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
    where = (
        f"Nothing stands in the way here; in the scenarios objects are {ahead.min():.2f} to {ahead.max():.2f} m ahead."
        if matchup.environment.get("range_noise") is None
        else f"The object stands at {watched_at(matchup):.3g} m and the estimate is right."
    )
    subject = "velocity over position before the contact"
    return Figure(matchup.name, "approach", subject, where, where, zoomable(chart), data, 340)


def reaction(played: Played) -> Figure:
    """Return the velocity commanded after the alarm, by what was sensed one control period after it."""
    period = Task(**played.matchup.environment).control_period
    steps = pl.DataFrame(dict(played.reactions)).with_columns(step=(pl.col("since") / period).round().cast(pl.Int64))
    first = steps.filter(pl.col("step") == 1)
    rows = []
    for number, (inside, low, high) in enumerate(quantile_groups(first["sensed"].to_numpy(), BANDS)):
        band = steps.filter(pl.col("scenario").is_in(first.filter(inside)["scenario"].implode()))
        for (step,), part in band.sort("step", maintain_order=True).group_by("step", maintain_order=True):
            velocity = part["velocity"].to_numpy()
            rows.append({
                "largest force sensed": f"{low:.3g} to {high:.3g} N", "number": number, "step": step,
                "ms": 1e3 * step * period, "velocity": velocity.mean(),
                "low": np.quantile(velocity, 0.1), "high": np.quantile(velocity, 0.9),
                "acceleration": part["acceleration"].to_numpy().mean(), "episodes": len(part),
            })  # fmt: skip
    data = pl.DataFrame(rows)
    order = data["largest force sensed"].unique(maintain_order=True).to_list()
    colours = alt.Scale(scheme=alt.SchemeParams("viridis", extent=[0.2, 0.8]))
    base = chart_of(data).encode(
        alt.X("ms:Q", title="time since the alarm (ms)"), alt.Color("largest force sensed:N", sort=order, scale=colours)
    )
    spread = base.mark_area(opacity=0.12).encode(alt.Y("low:Q", title="velocity commanded (m/s)"), y2="high:Q")
    line = base.mark_line(point=True).encode(
        y="velocity:Q",
        tooltip=["largest force sensed:N", alt.Tooltip("ms:Q", format=".0f"), alt.Tooltip("velocity:Q", format=".3f"),
                 alt.Tooltip("acceleration:Q", format=".1f"), "episodes:Q"],
    )  # fmt: skip
    said = []
    for (ms,), at in data.filter(pl.col("step").is_in([0, 1, 4])).group_by("ms", maintain_order=True):
        ends = f"{at['velocity'][0]:.2f} m/s where least, {at['velocity'][-1]:.2f} where most was sensed"
        said.append(f"{ms:.0f} ms after the alarm {ends}")
    text = "Mean velocity commanded: " + "; ".join(said) + "."
    caption = (
        f"Commands at w = {played.matchup.typical:g}, episodes in fifths by the largest force sensed one control "
        "period after the alarm (at the alarm itself it is the threshold for all); bands hold 80 % of the commands. "
        "Below zero the flange is told to retreat. " + text
    )
    return Figure(played.matchup.name, "reaction", "reaction after the alarm", caption, text, spread + line, data)
