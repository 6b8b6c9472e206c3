"""What it learned: how it approaches, how it reacts, and what urgency changes."""

import altair as alt
import numpy as np
import polars as pl

from agents.baselines.profile import constant_deceleration_of
from experiments.lab.statistics import Floats, quantile_groups
from experiments.report.figures import Figure, chart_of, looks_of, zoomable
from experiments.report.matchups import POLICY
from experiments.report.played import Played
from experiments.report.results import FAR, watched_at
from impact_gym.task import Task

THEORY = "theory: even braking at w / 2c"
BANDS = 5  # groups of episodes by the force sensed


def approach(played: Played) -> Figure:
    """Return velocity over position before the contact, beside the rival's and a constant deceleration."""
    frames, matchup = [], played.matchup
    ranged = matchup.environment.get("range_noise") is not None
    slope = impact_ratio(played)
    ahead = played.paper.scenario["distance"]
    near, far = round(float(ahead.min()), 3), round(float(ahead.max()), 3)
    linear = matchup.environment.get("coupling", {}).get("type") != "Bistable"  # which shields above its threshold
    uniform = linear and not ranged and far - near > 0.05 and far <= FAR  # what theory needs, about
    for contestant, run in played.profiles.items():
        name = matchup.labels[contestant]
        for weight, velocity in zip(run.weights, run["velocity"], strict=True):
            frames.append(_line(name, weight, run["position"], velocity))
            if name == POLICY and uniform:
                frames.append(_theory(weight, slope, run["position"], velocity, near, far))
    data = pl.concat(frames).drop_nans("velocity")
    looks = looks_of(data)
    chart = chart_of(data.select("contestant", "w", "x", "velocity"), 4).mark_line().encode(
        alt.X("x:Q", title="flange position (m)"),
        alt.Y("velocity:Q", title="flange velocity (m/s)"),
        alt.Opacity("w:O", title="time weight (m/s per s)", scale=alt.Scale(range=[1.0, 0.7, 0.45])),
        looks.colour, looks.dash, detail="w:N", order="x:Q",
        tooltip=["contestant:N", alt.Tooltip("w:N", title="time weight"), alt.Tooltip("x:Q", format=".3f"),
                 alt.Tooltip("velocity:Q", format=".3f")],
    )  # fmt: skip
    fits = data.filter(pl.col("contestant") == THEORY).unique(["w"], maintain_order=True)
    said = "; ".join(
        f"{a:.1f} m/s² at w = {w:g}, where theory has {w / (2 * slope):.1f} (R² = {r:.2f})"
        for w, r, a in fits["w", "r_squared", "deceleration"].rows()
    )
    where = (
        f"The object stands at {watched_at(matchup):.3g} m and the estimate is right."
        if ranged
        else f"Nothing stands in the way here; in the scenarios objects stand {near:.2f} to {far:.2f} m ahead."
    )
    theory = "" if not uniform else (
        f" Theory: if V_p were c v, here c = {slope:.2f}, and the object as likely in any place ahead, the best blind "
        "approach would brake evenly, v² = w / c times the distance left to the last place. A straight line fitted to "
        f"the policy's v² there brakes at {said}. It enters the range faster than theory has it, as "
        "nothing can stand before, and then swings with the tool on its coupling."
    )  # fmt: skip
    subject = "velocity over position before the contact"
    return Figure(matchup.name, "approach", subject, where + theory, f"{where} {said}", zoomable(chart), data, 340)


def impact_ratio(played: Played) -> float:
    """Return c of V_p = c v, fitted to the constant speeds up to 1 m/s by least squares."""
    points = [(float(name.split()[0]), float(run["object_velocity"].mean())) for name, run in played.family.items()]
    speeds, velocities = np.array([point for point in points if point[0] <= 1.0]).T
    return float(speeds @ velocities / (speeds @ speeds))


def _theory(
    weight: float, slope: float, position: Floats, velocity: Floats, near: float = 0.15, far: float = 0.35
) -> pl.DataFrame:
    """Return the profile of least mean c v + w T: with p the density and S what is still ahead, c p = w S / v^2.

    For a uniform prior S / p is the distance left, so v^2 = (w / c) (end - x). Beside it, the fit to `velocity`.
    """
    fit = constant_deceleration_of(position, velocity, (near, far))
    inside = (position >= near) & (position <= far)
    even = np.where(inside, np.sqrt(weight / slope * np.maximum(far - position, 0.0)), np.nan)
    return _line(THEORY, weight, position, even, fit.r_squared, fit.deceleration)


def _line(name: str, weight: float, x: Floats, v: Floats, r: float = np.nan, a: float = np.nan) -> pl.DataFrame:
    return pl.DataFrame({"contestant": name, "w": weight, "x": x, "velocity": v, "r_squared": r, "deceleration": a})


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
