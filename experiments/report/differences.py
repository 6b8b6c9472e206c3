"""Where the policy wins and where it does not: differences on the same scenarios, one by one and in groups."""

from typing import Any

import altair as alt
import numpy as np
import polars as pl
from numpy.typing import NDArray

from agents.evaluate import RESULTS
from experiments.lab.statistics import Floats, Resamples, estimate, interquartile_mean
from experiments.report.figures import Figure, Table, contestants, plain, rows, zoomable
from experiments.report.matchups import PAPER, POLICY
from experiments.report.results import Played, Run
from impact_gym.envs.scenario import FIELDS, LOGARITHMIC
from impact_gym.envs.task import MISSED_COST

GROUPS = 5  # of each field of the scenario, as many scenarios in each; fewer where there would be less than SMALLEST
SMALLEST = 10
TITLES = {
    "object_mass": "object mass (kg)",
    "contact_stiffness": "contact stiffness (N/m^1.5)",
    "restitution": "restitution",
    "distance": "distance (m)",
}
POINTS = 201  # of a distribution's curve


def measures(played: Played) -> Table:
    """Return what each contestant does to the objects and to itself, over the same scenarios."""
    weight = played.matchup.typical
    runs: dict[str, tuple[Run, float]] = {PAPER: (played.paper, weight)}
    if played.matchup.rival.name != PAPER:
        runs[f"{played.matchup.rival.name}, w = {weight:g}"] = (played.rival, weight)
    runs[f"{POLICY}, w = {weight:g}"] = (played.policy, weight)
    late = played.policy_as_late
    runs[f"{POLICY}, as late as the paper's rule (w = {late.weights[0]:.3g})"] = (late, late.weights[0])
    resamples = Resamples(late["missed"].shape[1])
    body = []
    for name, (run, at) in runs.items():
        one = run.at(at)
        velocity, peak = one["object_velocity"], one["peak_force"]
        worst = np.sort(velocity)[-max(1, round(0.05 * velocity.size)) :].mean()
        impulse = velocity * run.scenario["object_mass"]
        again = one["contact_count"] > 1
        body.append((
            name, f"{one['approach_time'].mean():.4f}", plain(estimate(resamples.means(velocity[None]))),
            f"{interquartile_mean(velocity):.4f}",
            f"{worst:.3f}", f"{peak.mean():.1f}, {np.quantile(peak, 0.95):.0f}", f"{impulse.mean():.4f}",
            f"{100 * again.mean():.1f} %", f"{one['contact_count'].mean():.2f}", f"{int(one['missed'].sum())}",
        ))  # fmt: skip
    head = ("contestant", "T (s)", "V_p (m/s)", "V_p, interquartile mean", "V_p, mean of the worst 5 %",
            "peak force (N): mean, 95 %", "impulse (N s)", "touched again", "contacts", "missed")  # fmt: skip
    count = played.paper["missed"].shape[1]
    return Table(f"Means over the same {count:,} scenarios; the impulse is all that the object was given, m V_p", head,
                 tuple(body))  # fmt: skip


def distribution(played: Played) -> Figure:
    """Return the distributions of the paired differences."""
    weight = played.matchup.typical
    late = played.policy_as_late
    against_rule = late["object_velocity"][0] - played.paper["object_velocity"][0]
    against_rule = np.where(late["missed"][0], MISSED_COST, against_rule)  # a miss is no win
    against_rival = played.policy.loss(weight) - played.rival.loss(weight)
    rival = f"V_p + {weight:g} T, against {played.matchup.rival.name}"
    rule = "V_p as late as the paper's rule, against it"
    share = np.linspace(0.0, 1.0, POINTS)
    frames = [
        pl.DataFrame({"pair": [name] * POINTS, "share": 100 * share, "difference": np.quantile(values, share)})
        for name, values in ((rule, against_rule), (rival, against_rival))
    ]
    data = pl.concat(frames)
    won = [100 * float((values < 0).mean()) for values in (against_rule, against_rival)]
    look = contestants([rule, rival])
    curve = alt.Chart(rows(data)).mark_line().encode(
        x=alt.X("difference:Q", title="policy minus the other, same scenario (m/s)"),
        y=alt.Y("share:Q", title="share of scenarios below (%)"),
        order="share:Q",
        color=alt.Color("pair:N", title=None, scale=look["color"]),
        strokeDash=alt.StrokeDash("pair:N", title=None, scale=look["dash"]),
        tooltip=[alt.Tooltip("pair:N"), alt.Tooltip("share:Q", format=".1f"),
                 alt.Tooltip("difference:Q", format=".3f")],
    )  # fmt: skip
    zero = alt.Chart(alt.Data(values=[{"zero": 0}])).mark_rule(strokeDash=[2, 3]).encode(x="zero:Q")
    text = (
        f"The policy leaves the object slower than the paper's rule in {won[0]:.0f} % of the scenarios and costs less "
        f"than {played.matchup.rival.name} in {won[1]:.0f} %."
    )
    caption = text + " Left of zero the policy is better."
    return Figure(f"{played.matchup.name}_differences", f"{played.matchup.name}: paired differences", caption,
                  text, zoomable(curve + zero), data)  # fmt: skip


def breakdown(played: Played) -> list[Figure]:
    """Return for each field of the scenario V_p of rule and policy, and the paired difference to the rival."""
    return [figure(played, name) for name in FIELDS for figure in (_levels, _paired)]


def _groups(values: Floats) -> list[tuple[NDArray[np.bool_], dict[str, float]]]:
    """Return equally large groups of scenarios, ordered by a field: a mask for each, and where the group lies."""
    count = max(1, min(GROUPS, values.size // SMALLEST))
    edges = np.quantile(values, np.linspace(0.0, 1.0, count + 1))
    group = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, count - 1)
    found = []
    for number in range(count):
        inside = group == number
        if inside.sum() > 1:
            place = {"from": float(edges[number]), "to": float(edges[number + 1])}
            found.append((inside, {**place, "middle": float(np.median(values[inside]))}))
    return found


def _levels(played: Played, name: str) -> Figure:
    late = f"{POLICY}, as late"
    runs: dict[str, list[Run]] = {PAPER: [played.paper], late: list(played.as_late.values())}
    frames = []
    for inside, place in _groups(played.paper.scenario[name]):
        resamples = Resamples(int(inside.sum()))
        for contestant, seeds in runs.items():
            one = {field: np.array([run[field][0][inside] for run in seeds], float) for field in RESULTS}
            mean = estimate(resamples.means(one["object_velocity"]))
            frames.append({
                "contestant": contestant, **place, "value": mean.value, "low": mean.low, "high": mean.high,
                "peak force": float(one["peak_force"].mean()),
                "touched again": float((one["contact_count"] > 1).mean()), "missed": int(one["missed"].sum()),
            })  # fmt: skip
    data = pl.DataFrame(frames)
    said = "; ".join(
        f"{one}: {group['value'][0]:.2f} m/s at the low end, {group['value'][-1]:.2f} at the high end"
        for (one,), group in data.group_by("contestant", maintain_order=True)
    )
    more = [alt.Tooltip("peak force:Q", title="peak force (N)", format=".1f"),
            alt.Tooltip("touched again:Q", format=".1%"), alt.Tooltip("missed:Q")]  # fmt: skip
    chart = _grouped(data, name, "mean V_p (m/s)", (PAPER, late), (PAPER, POLICY), more)
    caption = f"Groups of as many scenarios each, 95 % intervals. {said}."
    title = f"{played.matchup.name}: V_p by {TITLES[name]}"
    return Figure(f"{played.matchup.name}_by_{name}", title, caption, said, chart, data, 240)


def _paired(played: Played, name: str) -> Figure:
    weight, rival = played.matchup.typical, played.matchup.rival.name
    theirs = played.rival.loss(weight)
    ours = np.array([run.loss(weight) for run in played.seeds.values()]) - theirs
    label = f"{POLICY} minus {rival}"
    frames = []
    for inside, place in _groups(played.paper.scenario[name]):
        mean = estimate(Resamples(int(inside.sum())).means(ours[:, inside]))
        frames.append({"contestant": label, **place, "value": mean.value, "low": mean.low, "high": mean.high})
    data = pl.DataFrame(frames)
    won = data.filter(pl.col("high") < 0)
    lost = data.filter(pl.col("low") > 0)

    def ranges(part: pl.DataFrame) -> str:
        places = ", ".join(f"{a:.3g} to {b:.3g}" for a, b in zip(part["from"], part["to"], strict=True))
        return f"at {places}" if places else "nowhere"

    said = f"The policy is clearly better {ranges(won)}, clearly worse {ranges(lost)}."
    chart = _grouped(data, name, f"difference of V_p + {weight:g} T (m/s)", (label,), (POLICY,), [])
    zero = alt.Chart(alt.Data(values=[{"zero": 0}])).mark_rule(strokeDash=[2, 3]).encode(y="zero:Q")
    title = f"{played.matchup.name}: against {rival}, by {TITLES[name]}"
    caption = (
        f"Paired differences at w = {weight:g}, all seeds, 95 % intervals; below zero the policy is better. {said}"
    )
    return Figure(f"{played.matchup.name}_paired_{name}", title, caption, said, zero + chart, data, 240)


def _grouped(
    data: pl.DataFrame, name: str, title: str, names: tuple[str, ...], looks: tuple[str, ...], more: list[alt.Tooltip]
) -> Any:
    """Return points with intervals over a field; `looks` names the contestants whose colours and shapes are used."""
    look = contestants(looks)
    kind: dict[str, Any] = {"type": "log"} if LOGARITHMIC[FIELDS.index(name)] else {"zero": False}
    axis = alt.Axis(format="~s") if name == "contact_stiffness" else alt.Axis()
    base = alt.Chart(rows(data)).encode(
        x=alt.X("middle:Q", title=TITLES[name], scale=alt.Scale(**kind, nice=False, padding=14), axis=axis),
        color=alt.Color("contestant:N", title=None, scale=alt.Scale(domain=list(names), range=look["color"].range)),
    )
    bars = base.mark_rule(strokeWidth=2).encode(y=alt.Y("low:Q", title=title), y2="high:Q")
    line = base.mark_line(strokeWidth=1.2).encode(y="value:Q")
    numbers = [alt.Tooltip(f"{one}:Q", format=".3g") for one in ("from", "to", "value", "low", "high")]
    marks = base.mark_point(size=60).encode(
        y="value:Q",
        shape=alt.Shape("contestant:N", title=None, scale=alt.Scale(domain=list(names), range=look["shape"].range)),
        tooltip=[alt.Tooltip("contestant:N"), *numbers, *more],
    )
    return bars + line + marks
