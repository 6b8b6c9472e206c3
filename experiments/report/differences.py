"""Where the policy wins and where it does not: differences on the same scenarios, one by one and in groups."""

import altair as alt
import numpy as np
import polars as pl

from experiments.report.answer import as_late
from experiments.report.arenas import PAPER, POLICY
from experiments.report.figures import Figure, Table, contestants, rows
from experiments.report.results import Played, Run
from experiments.statistics import Floats, Resamples, estimate, interquartile_mean
from impact_gym.envs.scenario import FIELDS, LOGARITHMIC

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
    weight = played.arena.typical
    runs: dict[str, tuple[Run, float]] = {PAPER: (played.paper, weight)}
    if played.arena.rival.name != PAPER:
        runs[f"{played.arena.rival.name}, w = {weight:g}"] = (played.rival, weight)
    runs[f"{POLICY}, w = {weight:g}"] = (played.policy, weight)
    late = played.policy_as_late
    runs[f"{POLICY}, as late as the paper's rule (w = {late.weights[0]:.3g})"] = (late, late.weights[0])
    body = []
    for name, (run, at) in runs.items():
        one = run.at(at)
        velocity, peak = one["object_velocity"], one["peak_force"]
        worst = np.sort(velocity)[-max(1, round(0.05 * velocity.size)) :].mean()
        impulse = velocity * run.scenario["object_mass"]
        again = one["contact_count"] > 1
        body.append((
            name, f"{one['approach_time'].mean():.4f}", f"{velocity.mean():.4f}", f"{interquartile_mean(velocity):.4f}",
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
    weight = played.arena.typical
    against_rule = played.policy_as_late["object_velocity"][0] - played.paper["object_velocity"][0]
    against_rival = played.policy.loss(weight) - played.rival.loss(weight)
    rival = f"V_p + {weight:g} T, against {played.arena.rival.name}"
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
        f"than {played.arena.rival.name} in {won[1]:.0f} %."
    )
    caption = text + " Left of zero the policy is better."
    return Figure(f"{played.arena.name}_differences", f"{played.arena.name}: paired differences", caption,
                  text, (curve + zero).interactive(bind_y=False), data)  # fmt: skip


def breakdown(played: Played) -> list[Figure]:
    """Return a figure for each field of the scenario: V_p in groups of scenarios, of rule and policy."""
    late = as_late(played, "object_velocity")
    figures = []
    for name in FIELDS:
        values = played.paper.scenario[name]
        groups = max(1, min(GROUPS, values.size // SMALLEST))
        edges = np.quantile(values, np.linspace(0.0, 1.0, groups + 1))
        group = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, groups - 1)
        frames = []
        for number in range(groups):
            inside = group == number
            if inside.sum() < 2:
                continue
            resamples = Resamples(int(inside.sum()))
            rule = played.paper["object_velocity"][:, inside]
            rival = played.rival.at(played.arena.typical)["object_velocity"][None, inside]
            own = np.array([run.at(played.arena.typical)["object_velocity"][inside] for run in played.seeds.values()])
            for contestant, sample in (
                (PAPER, rule),
                (f"{POLICY}, as late", late[:, inside]),
                (f"{POLICY}, w = {played.arena.typical:g}", own),
                (f"{played.arena.rival.name}, w = {played.arena.typical:g}", rival),
            ):
                mean = estimate(resamples.means(sample))
                frames.append({
                    "contestant": contestant, "low": float(edges[number]), "high": float(edges[number + 1]),
                    "middle": float(np.median(values[inside])), "V": mean.value, "V_low": mean.low, "V_high": mean.high,
                })  # fmt: skip
        data = pl.DataFrame(frames).unique(maintain_order=True)
        figures.append(_grouped(played, name, data))
    return figures


def _grouped(played: Played, name: str, data: pl.DataFrame) -> Figure:
    look = contestants(data["contestant"].unique(maintain_order=True).to_list())
    colours = [{PAPER: "#D55E00", f"{POLICY}, as late": "#0072B2"}.get(one, colour) for one, colour in
               zip(look["color"].domain, look["color"].range, strict=True)]  # fmt: skip
    logarithmic = LOGARITHMIC[FIELDS.index(name)]
    kind = {"type": "log"} if logarithmic else {"zero": False}
    axis = alt.Axis(format="~s") if name == "contact_stiffness" else alt.Axis()
    base = alt.Chart(rows(data)).encode(
        x=alt.X("middle:Q", title=TITLES[name], scale=alt.Scale(**kind, nice=False, padding=14),
                axis=axis),
        color=alt.Color("contestant:N", title=None, scale=alt.Scale(domain=look["color"].domain, range=colours),
                        legend=alt.Legend(columns=2)),
    )  # fmt: skip
    bars = base.mark_rule(strokeWidth=2).encode(y=alt.Y("V_low:Q", title="mean V_p (m/s)"), y2="V_high:Q")
    line = base.mark_line(strokeWidth=1.2).encode(y="V:Q")
    marks = base.mark_point(size=60).encode(
        y="V:Q",
        shape=alt.Shape("contestant:N", title=None, scale=look["shape"], legend=alt.Legend(columns=2)),
        tooltip=[alt.Tooltip("contestant:N"), alt.Tooltip("low:Q", format=".3g"), alt.Tooltip("high:Q", format=".3g"),
                 alt.Tooltip("V:Q", format=".3f"), alt.Tooltip("V_low:Q", format=".3f"),
                 alt.Tooltip("V_high:Q", format=".3f")],
    )  # fmt: skip
    first, last = data["middle"].min(), data["middle"].max()
    said = "; ".join(
        f"{one}: {group['V'][0]:.2f} m/s at the low end, {group['V'][-1]:.2f} at the high end"
        for (one,), group in data.group_by("contestant", maintain_order=True)
    )
    title = f"{played.arena.name}: V_p by {TITLES[name]}"
    caption = f"Means of groups of as many scenarios each, 95 % intervals; centred on {first:.3g} to {last:.3g}."
    return Figure(f"{played.arena.name}_by_{name}", title, caption, said, bars + line + marks, data, 260)


def gains(played: Played) -> Floats:
    """Return how much slower (m/s) the object leaves than under the paper's rule, as late (scenarios,)."""
    return played.paper["object_velocity"][0] - played.policy_as_late["object_velocity"][0]
