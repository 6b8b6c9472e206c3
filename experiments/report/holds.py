"""Does it hold, and is it the simulator? Figures and tables of the changed environments and of the other solvers."""

from collections.abc import Mapping
from typing import Any

import altair as alt
import numpy as np
import polars as pl

from experiments.report.arenas import PAPER, POLICY
from experiments.report.figures import Figure, Table, contestants, rows
from experiments.report.results import EXACT, Played, Run
from experiments.report.robustness import CONTINUOUS, ROBOT, SCENARIOS, VARIANTS


def robustness(played: Played) -> list[Figure]:
    """Return a figure for each factor: V_p + w T over it."""
    return [_factor(played, factor) for factor in CONTINUOUS if _runs(played, factor)]


def _runs(played: Played, factor: str) -> list[tuple[str, float, str, Run]]:
    """Label, value, contestant and run of each variant of a factor."""
    found = []
    for variant in VARIANTS:
        for (name, label, contestant), run in played.variants.items():
            if (name, label) == (variant.factor, variant.label) and name == factor:
                shown = POLICY if contestant == played.arena.chosen else contestant
                found.append((label, variant.value, shown, run))
    return found


def _row(run: Run, weight: float) -> dict[str, Any]:
    one = run.at(weight)
    return {
        "loss": float(run.loss(weight).mean()),
        "V": float(one["object_velocity"].mean()),
        "T": float(one["approach_time"].mean()),
        "missed": int(one["missed"].sum()),
    }


def _factor(played: Played, factor: str) -> Figure:
    weight = played.arena.typical
    found = _runs(played, factor)
    data = pl.DataFrame([{"contestant": name, "value": value, **_row(run, weight)} for _, value, name, run in found])
    names = sorted(data["contestant"].unique(maintain_order=True), key=lambda name: (name != PAPER, name != POLICY))
    look = contestants(names)
    scale = alt.Scale(type="log", nice=False, padding=10) if "threshold" in factor or "stop" in factor else alt.Scale(
        zero=False, nice=False, padding=10
    )  # fmt: skip
    ticks = alt.Axis(values=data["value"].unique().sort().to_list(), format="~g")
    chart = alt.Chart(rows(data)).mark_line().encode(
        x=alt.X("value:Q", title=factor, scale=scale, axis=ticks),
        y=alt.Y("loss:Q", title=f"mean V_p + {weight:g} T (m/s)", scale=alt.Scale(zero=False)),
        color=alt.Color("contestant:N", title=None, scale=look["color"], legend=alt.Legend(columns=2)),
    )  # fmt: skip
    marks = chart.mark_point(size=60).encode(
        shape=alt.Shape("contestant:N", title=None, scale=look["shape"], legend=alt.Legend(columns=2)),
        tooltip=[alt.Tooltip("contestant:N"), alt.Tooltip("value:Q"), alt.Tooltip("loss:Q", format=".4f"),
                 alt.Tooltip("V:Q", title="V_p (m/s)", format=".4f"), alt.Tooltip("T:Q", title="T (s)", format=".4f"),
                 alt.Tooltip("missed:Q")],
    )  # fmt: skip
    said = []
    for name in names:
        own = data.filter(pl.col("contestant") == name).sort("value")
        said.append(f"{name}: {own['loss'][0]:.3f} to {own['loss'][-1]:.3f} m/s")
    worst = int(data.filter(pl.col("contestant") == POLICY)["missed"].max() or 0)
    missed = f" The policy misses at most {worst} of {found[0][3]['missed'].shape[1]} objects." if worst else ""
    slug = factor.split(" (")[0].replace(" ", "_")
    return Figure(f"{played.arena.name}_{slug}", f"{played.arena.name}: {factor}", "From left to right, "
                  + "; ".join(said) + "." + missed, "; ".join(said), chart + marks, data, 220)  # fmt: skip


def kinds(played: Played) -> Table:
    """Return what a compliant robot and the hard scenarios do."""
    weight = played.arena.typical
    body = []
    for factor in (ROBOT, SCENARIOS):
        for label, _, name, run in _runs(played, factor):
            row = _row(run, weight)
            body.append((factor, label, name, f"{row['loss']:.4f}", f"{row['V']:.4f}", f"{row['T']:.4f}",
                         f"{row['missed']} of {run['missed'].shape[1]}"))  # fmt: skip
    head = ("changed", "to", "contestant", f"V_p + {weight:g} T (m/s)", "V_p (m/s)", "T (s)", "missed")
    return Table("A compliant robot (the paper's, 5.225 kg on 150 kN/m) instead of a rigid one, and the scenarios "
                 "beyond the training ranges: lighter, stiffer, less elastic, nearer", head, tuple(body))  # fmt: skip


def weak_points(played: Played) -> str:
    """Return in a sentence where the policy loses to its rival, or misses objects."""
    weight, rival = played.arena.typical, played.arena.rival.name
    lost, missing = [], []
    for factor in dict.fromkeys(variant.factor for variant in VARIANTS):
        found = {(label, name): run for label, _, name, run in _runs(played, factor)}
        for label in dict.fromkeys(label for label, _ in found):
            ours, theirs = found[label, POLICY], found[label, rival]
            difference = ours.loss(weight) - theirs.loss(weight)
            if difference.mean() > 2.0 * difference.std(ddof=1) / np.sqrt(difference.size):
                lost.append(f"{factor} {label} (by {difference.mean():.3f} m/s)")
            if count := int(ours.at(weight)["missed"].sum()):
                missing.append(f"{count} of {difference.size} at {factor} {label}")
    clearly = f"worse than {rival} by more than two standard errors"
    said = (
        f"{played.arena.name}: {clearly} at {'; '.join(lost)}." if lost else f"{played.arena.name}: nowhere {clearly}."
    )
    return said + (f" Misses: {'; '.join(missing)}." if missing else " No object is missed.")


def simulator(played: Played) -> Table:
    """Return what other solvers and laws change, beside the gain."""
    weight = played.arena.typical
    gain = float((played.rival.loss(weight) - played.policy.loss(weight)).mean())
    over_rule = float((played.paper.loss(weight) - played.policy.loss(weight)).mean())
    body = []
    seeds = [name for name in played.seeds if ("as it is", name) in played.exactly]
    for change in EXACT:
        if change == "as it is":
            continue
        shifts = [_shift(played, change, name) for name in seeds]
        moved = [float(np.abs(shift["object_velocity"]).max()) for shift in shifts]
        mean = [float(np.abs(shift["object_velocity"].mean())) for shift in shifts]
        loss = {name: _loss_shift(played, change, name, weight) for name in (played.arena.chosen, PAPER)}
        count = len(shifts[0]["object_velocity"])
        body.append((change, f"{len(seeds)} seeds, {count}", f"{max(mean):.2g}", f"{max(moved):.2g}",
                     f"{loss[PAPER] - loss[played.arena.chosen]:+.2g}"))  # fmt: skip
    for label in dict.fromkeys(label for label, _ in played.scipy):
        shifts = {
            name: arrays["object_velocity"] - arrays["ours"]
            for (kind, name), arrays in played.scipy.items()
            if kind == label
        }
        ours, rule = shifts[played.arena.chosen], shifts[PAPER]
        body.append((f"SciPy's solver, {label}", f"{played.arena.chosen}, {len(ours)}", f"{abs(ours.mean()):.2g}",
                     f"{np.abs(ours).max():.2g}", f"{rule.mean() - ours.mean():+.2g}"))  # fmt: skip
    head = ("changed", "played", "mean change of V_p (m/s)", "largest (m/s)", "change of the gain over the rule (m/s)")
    caption = (
        f"The gain at w = {weight:g} is {over_rule:.3f} m/s over the paper's rule and {gain:.4f} m/s over "
        f"{played.arena.rival.name}."
    )
    return Table(caption, head, tuple(body))


def _shift(played: Played, change: str, name: str) -> Mapping[str, Any]:
    before, after = (played.exactly[kind, name] for kind in ("as it is", change))
    return {field: (after[field] - before[field])[0] for field in ("object_velocity", "approach_time")}


def _loss_shift(played: Played, change: str, name: str, weight: float) -> float:
    before, after = (played.exactly[kind, name].loss(weight).mean() for kind in ("as it is", change))
    return float(after - before)
