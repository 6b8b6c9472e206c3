"""How policy and rival differ in the same scenarios: a table of measures, and charts of paired differences."""

from dataclasses import asdict
from typing import Any

import altair as alt
import numpy as np
import polars as pl

from experiments.lab.parts import Table
from experiments.lab.statistics import Comparison, estimate, quantile_groups
from experiments.report.figures import Figure, chart_of, looks_of
from experiments.report.matchups import PAPER, POLICY
from experiments.report.played import Played
from impact_gym.quantities import QUANTITIES, SCENARIO

GROUPS = 5  # number of equally large groups of scenarios; fewer if a group would be smaller than SMALLEST
SMALLEST = 10  # scenarios
TITLES = {row.id: row.words + (f" ({row.unit})" if row.unit != "-" else "") for row in SCENARIO}


def measures(played: Played) -> Table:
    """Return times, velocities, forces and impulses of each contestant in the same scenarios."""
    matchup, weight, as_late = played.matchup, played.matchup.typical, played.as_late[played.matchup.chosen]
    runs = {PAPER: (PAPER, played.paper.at(weight))}
    if matchup.rival.name != PAPER:
        runs[f"{matchup.rival.label}, w = {weight:g}"] = matchup.rival.name, played.rival.at(weight)
    if matchup.operated:
        fixed = {name: run for name, run in played.baselines.items() if len(run.weights) == 1}
        runs |= {matchup.labels[name]: (name, run.at(weight)) for name, run in fixed.items()}
    runs[f"{POLICY}, w = {weight:g}"] = matchup.chosen, played.policy.at(weight)
    late = f"{POLICY} at the paper's approach time (w = {as_late.weights[0]:.3g})"
    runs[late] = "", as_late.at(as_late.weights[0])
    rows = []
    for label, (name, episodes) in runs.items():
        velocity, peak = episodes.object_velocity, episodes.peak_force
        row: dict[str, Any] = {
            "label": label,
            "T": episodes.approach_time.mean(),
            "V": estimate(played.resamples.means(velocity)),
            "worst": np.sort(velocity)[-max(1, round(0.05 * velocity.size)) :].mean(),
            "peak": peak.mean(),
            "high": np.quantile(peak, 0.95),
            "impulse": (velocity * episodes.scenario["object_mass"]).mean(),
            "again": 100 * (episodes.contact_count > 1).mean(),
            "contacts": episodes.contact_count.mean(),
            "missed": episodes.missed.sum(),
            "way": "-",
        }
        if travelled := played.travelled.get(name):
            before, most = 1e3 * np.quantile(travelled["before"], 0.95), 1e3 * travelled["in_all"].max()
            row["way"] = f"{before:.0f}, {most:.0f}"
        if matchup.operated:
            row |= {what: getattr(episodes, what).mean() for what in ("slide", "touch_time", "taken")}
        rows.append(row)
    columns = {
        "contestant": "{label}", "T (s)": "{T:.4f}",
        "V_p (m/s)": "{V:.3f}", "V_p, mean of the worst 5 %": "{worst:.3f}",
        "peak force (N): mean, 95 %": "{peak:.1f}, {high:.0f}", "impulse (N s)": "{impulse:.4f}",
        "several contacts": "{again:.1f} %", "contacts": "{contacts:.2f}", "missed": "{missed}",
    }  # fmt: skip
    caption = f"Means over the same {played.count:,} scenarios; impulse: object mass times V_p"
    if played.travelled:
        columns["deflection (mm): 95 % before the touch, largest"] = "{way}"
        caption += "; deflection of the tool's spring in the first of these scenarios"
    if matchup.operated:
        columns |= {"slide (m)": "{slide:.3f}", "until the touch (s)": "{touch_time:.3f}", "taken": "{taken:.3f}"}
    return Table.of(caption, rows, columns)


def paired(played: Played, field: str) -> Figure:
    """Return the chart of cost differences between policy and rival, with scenarios grouped by a `field`."""
    weight, rival, values = played.matchup.typical, played.matchup.rival.label, played.paper[field]
    label, ours, theirs = f"{POLICY} minus {rival}", played.losses(weight), played.rival.loss(weight)
    data = pl.DataFrame([
        {"contestant": label, "from": low, "to": high, "middle": float(np.median(values[inside])),
         **asdict(Comparison.of_means(theirs[inside], ours[:, inside]).less)}
        for inside, low, high in quantile_groups(values, max(1, min(GROUPS, values.size // SMALLEST)))
        if inside.sum() > 1
    ])  # fmt: skip

    def ranges(holds: pl.Expr) -> str:
        places = ", ".join(f"{low:.3g} to {high:.3g}" for low, high in data.filter(holds)["from", "to"].rows())
        return f"at {places}" if places else "nowhere"

    better, worse = ranges(pl.col("high") < 0), ranges(pl.col("low") > 0)
    verdict = f"The policy is clearly better {better}, clearly worse {worse}."
    caption = (
        f"Paired differences at w = {weight:g}, all seeds, 95 % intervals; below zero the policy is better. {verdict}"
    )
    kind: dict[str, Any] = {"type": "log"} if QUANTITIES[field].by_ratio(played.paper[field].min()) else {"zero": False}
    axis = alt.Axis(format="~s") if field == "contact_stiffness" else alt.Axis()
    scale, (colour, _, shape) = alt.Scale(**kind, nice=False, padding=14), looks_of(data, policy=label)
    base = chart_of(data).encode(alt.X("middle:Q", title=TITLES[field], scale=scale, axis=axis), colour)
    title = f"difference of V_p + {weight:g} T (m/s)"
    intervals = base.mark_rule(strokeWidth=2).encode(alt.Y("low:Q", title=title), y2="high:Q")
    numbers = [alt.Tooltip(f"{column}:Q", format=".3g") for column in ("from", "to", "value", "low", "high")]
    marks = base.mark_point(size=60).encode(shape, y="value:Q", tooltip=["contestant:N", *numbers])
    zero = chart_of(pl.DataFrame({"zero": [0]})).mark_rule(strokeDash=[2, 3]).encode(y="zero:Q")
    chart = zero + intervals + base.mark_line(strokeWidth=1.2).encode(y="value:Q") + marks
    heading = f"Against {rival}, by {TITLES[field]}"
    return Figure(played.matchup.name, f"paired_{field}", heading, caption, verdict, chart, data, 240)
