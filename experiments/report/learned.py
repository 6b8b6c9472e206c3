"""What it learned: how it approaches, how it reacts, and what urgency changes."""

import altair as alt
import numpy as np
import polars as pl

from agents.baselines.profile import constant_deceleration_of
from experiments.report.answer import stacked
from experiments.report.figures import Figure, contestants, rows, zoomable
from experiments.report.matchups import PAPER, POLICY
from experiments.report.results import FAR, Played, shown_weights, watched_at
from impact_gym.envs.task import Task

THEORY = "theory: even braking at w / 2c"
BANDS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
"""Edges of the groups of sensed force, as quantiles."""


def approach(played: Played) -> Figure:
    """Return velocity over position before the contact, beside the rival's and a constant deceleration."""
    frames = []
    matchup = played.matchup
    ranged = matchup.environment.get("range_noise") is not None
    slope = impact_ratio(played)
    ahead = played.paper.scenario["distance"]
    span = round(float(ahead.min()), 3), round(float(ahead.max()), 3)
    linear = matchup.environment.get("coupling", {}).get("type") != "Bistable"  # which shields above its threshold
    uniform = linear and not ranged and span[1] - span[0] > 0.05 and span[1] <= FAR  # what theory needs, about
    for contestant, arrays in played.profiles.items():
        known = (
            matchup.policy
            if contestant == matchup.chosen
            else next(c for c in matchup.baselines if c.name == contestant)
        )
        weights = shown_weights(matchup, known)
        name = POLICY if contestant == matchup.chosen else contestant
        for weight, velocity in zip(weights, arrays["velocity"], strict=True):
            frames.append(_line(name, weight, arrays["position"], velocity))
            if contestant == matchup.chosen and uniform:
                frames.append(_theory(weight, slope, arrays["position"], velocity, *span))
    data = pl.concat(frames).drop_nans("velocity")
    names = data["contestant"].unique(maintain_order=True).to_list()
    names = sorted(names, key=lambda name: (name != PAPER, name != POLICY))
    look = contestants(names)
    chart = alt.Chart(rows(data, ["contestant", "w", "x", "velocity"], 4)).mark_line().encode(
        x=alt.X("x:Q", title="flange position (m)"),
        y=alt.Y("velocity:Q", title="flange velocity (m/s)"),
        color=alt.Color("contestant:N", title=None, scale=look["color"]),
        strokeDash=alt.StrokeDash("contestant:N", title=None, scale=look["dash"]),
        detail="w:N",
        order="x:Q",
        opacity=alt.Opacity("w:O", title="time weight (m/s per s)", scale=alt.Scale(range=[1.0, 0.7, 0.45])),
        tooltip=[alt.Tooltip("contestant:N"), alt.Tooltip("w:N", title="time weight"), alt.Tooltip("x:Q", format=".3f"),
                 alt.Tooltip("velocity:Q", format=".3f")],
    )  # fmt: skip
    fits = data.filter(pl.col("contestant") == THEORY).unique(["w"], maintain_order=True)
    said = "; ".join(
        f"{a:.1f} m/s² at w = {w:g}, where theory has {w / (2 * slope):.1f} (R² = {r:.2f})"
        for w, r, a in zip(fits["w"], fits["r_squared"], fits["deceleration"], strict=True)
    )
    where = (
        f"The object stands at {watched_at(matchup):.3g} m and the estimate is right."
        if ranged
        else f"Nothing stands in the way here; in the scenarios objects stand {span[0]:.2f} to {span[1]:.2f} m ahead."
    )
    theory = "" if not uniform else (
        f" Theory: if V_p were c v, here c = {slope:.2f}, and the object as likely in any place ahead, the best blind "
        "approach would brake evenly, v² = w / c times the distance left to the last place. A straight line fitted to "
        f"the policy's v² there brakes at {said}. It enters the range faster than theory has it, as "
        "nothing can stand before, and then swings with the tool on its coupling."
    )  # fmt: skip
    return Figure(f"{matchup.name}_approach", f"{matchup.name}: velocity over position before the contact",
                  where + theory, where + " " + said, zoomable(chart), data, 340)  # fmt: skip


def impact_ratio(played: Played) -> float:
    """Return c of V_p = c v, fitted to the constant speeds up to 1 m/s by least squares."""
    points = [(float(name.split()[0]), float(run["object_velocity"].mean())) for name, run in played.family.items()]
    speeds, velocities = np.array([point for point in points if point[0] <= 1.0]).T
    return float(speeds @ velocities / (speeds @ speeds))


def _theory(
    weight: float, slope: float, position: np.ndarray, velocity: np.ndarray, near: float = 0.15, far: float = 0.35
) -> pl.DataFrame:
    """Return the profile of least mean c v + w T: with p the density and S what is still ahead, c p = w S / v^2.

    For a uniform prior S / p is the distance left, so v^2 = (w / c) (end - x). Beside it, the fit to `velocity`.
    """
    fit = constant_deceleration_of(position, velocity, (near, far))
    inside = (position >= near) & (position <= far)
    even = np.where(inside, np.sqrt(weight / slope * np.maximum(far - position, 0.0)), np.nan)
    return _line(THEORY, weight, position, even, fit.r_squared, fit.deceleration)


def _line(name: str, weight: float, x: np.ndarray, v: np.ndarray, r: float = np.nan, a: float = np.nan) -> pl.DataFrame:
    count = len(x)
    return pl.DataFrame({"contestant": [name] * count, "w": np.full(count, weight), "x": x, "velocity": v,
                         "r_squared": np.full(count, r), "deceleration": np.full(count, a)})  # fmt: skip


def reaction(played: Played) -> Figure:
    """Return the velocity commanded after the alarm, by what was sensed one control period after it."""
    seen, period = played.reactions, Task(**played.matchup.environment).control_period
    step = np.rint(seen["since"] / period).astype(int)
    felt = dict(zip(seen["scenario"][step == 1].tolist(), seen["sensed"][step == 1].tolist(), strict=True))
    force = np.array([felt.get(number, np.nan) for number in seen["scenario"].tolist()])
    edges = np.unique(np.quantile(list(felt.values()), BANDS))
    band = np.clip(np.searchsorted(edges, force, side="right") - 1, 0, max(len(edges) - 2, 0))
    frames = []
    for number in range(max(len(edges) - 1, 1)):
        label = f"{edges[number]:.3g} to {edges[min(number + 1, len(edges) - 1)]:.3g} N"
        for place in range(int(step.max()) + 1):
            chosen = np.isfinite(force) & (band == number) & (step == place)
            if not chosen.any():
                continue
            velocity = seen["velocity"][chosen]
            frames.append({
                "largest force sensed": label, "number": number, "step": place,
                "ms": 1e3 * place * period, "velocity": float(velocity.mean()),
                "low": float(np.quantile(velocity, 0.1)), "high": float(np.quantile(velocity, 0.9)),
                "acceleration": float(seen["acceleration"][chosen].mean()), "episodes": int(chosen.sum()),
            })  # fmt: skip
    data = pl.DataFrame(frames)
    order = data.sort("number")["largest force sensed"].unique(maintain_order=True).to_list()
    colours = alt.Scale(scheme=alt.SchemeParams("viridis", extent=[0.2, 0.8]))
    base = alt.Chart(rows(data)).encode(
        x=alt.X("ms:Q", title="time since the alarm (ms)"),
        color=alt.Color("largest force sensed:N", sort=order, scale=colours),
    )
    band_mark = base.mark_area(opacity=0.12).encode(y=alt.Y("low:Q", title="velocity commanded (m/s)"), y2="high:Q")
    line = base.mark_line(point=True).encode(
        y="velocity:Q",
        tooltip=[alt.Tooltip("largest force sensed:N"), alt.Tooltip("ms:Q", format=".0f"),
                 alt.Tooltip("velocity:Q", format=".3f"), alt.Tooltip("acceleration:Q", format=".1f"),
                 alt.Tooltip("episodes:Q")],
    )  # fmt: skip
    said = []
    for place in (0, 1, 4):
        at = data.filter(pl.col("step") == place).sort("number")
        if len(at):
            ends = f"{at['velocity'][0]:.2f} m/s where least, {at['velocity'][-1]:.2f} where most was sensed"
            said.append(f"{1e3 * place * period:.0f} ms after the alarm {ends}")
    text = "Mean velocity commanded: " + "; ".join(said) + "."
    caption = (
        f"Commands at w = {played.matchup.typical:g}, episodes in fifths by the largest force sensed one control "
        "period after the alarm (at the alarm itself it is the threshold for all); bands hold 80 % of the commands. "
        "Below zero the flange is told to retreat. " + text
    )
    return Figure(f"{played.matchup.name}_reaction", f"{played.matchup.name}: reaction after the alarm", caption, text,
                  band_mark + line, data, 320)  # fmt: skip


def urgency(played: Played) -> list[Figure]:
    """Return approach time and V_p over the time weight, all seeds."""
    figures = []
    for name, title in (("approach_time", "mean approach time (s)"), ("object_velocity", "mean V_p (m/s)")):
        means = stacked(played, name).mean(axis=2)
        frames = [
            {"contestant": POLICY, "seed": seed, "w": weight, "value": float(value)}
            for seed, line in zip(played.seeds, means, strict=True)
            for weight, value in zip(played.policy.weights, line, strict=True)
        ]
        rival = played.rival
        frames += [
            {
                "contestant": played.matchup.rival.name,
                "seed": "-",
                "w": weight,
                "value": float(rival.at(weight)[name].mean()),
            }
            for weight in rival.weights
        ]
        data = pl.DataFrame(frames)
        names = [played.matchup.rival.name, POLICY]
        look = contestants(names)
        chart = alt.Chart(rows(data)).mark_line(point={"filled": True, "size": 40}).encode(
            x=alt.X("w:Q", title="time weight (m/s per s)", scale=alt.Scale(type="log", nice=False)),
            y=alt.Y("value:Q", title=title, scale=alt.Scale(zero=False)),
            detail="seed:N",
            color=alt.Color("contestant:N", title=None, scale=look["color"]),
            strokeDash=alt.StrokeDash("contestant:N", title=None, scale=look["dash"]),
            tooltip=[alt.Tooltip("contestant:N"), alt.Tooltip("seed:N"), alt.Tooltip("w:Q"),
                     alt.Tooltip("value:Q", format=".4f")],
        )  # fmt: skip
        ends = f"{means[:, 0].mean():.3f} at w = {played.policy.weights[0]:g}, {means[:, -1].mean():.3f} at "
        text = f"Mean over seeds: {ends}{played.policy.weights[-1]:g}."
        figures.append(Figure(f"{played.matchup.name}_urgency_{name}", f"{played.matchup.name}: {title} over urgency",
                              "A line per training seed. " + text, text, chart, data, 260))  # fmt: skip
    return figures
