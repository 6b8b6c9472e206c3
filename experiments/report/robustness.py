"""Does it hold, and is it the simulator? Figures and tables of the changed environments and of the other solvers."""

from collections.abc import Mapping
from typing import Any

import altair as alt
import numpy as np
import polars as pl

from experiments.report.figures import Figure, Table, contestants, rows
from experiments.report.matchups import PAPER, POLICY
from experiments.report.results import EXACT, Played, Run
from experiments.report.variants import (
    CONTINUOUS,
    DELAY,
    ESTIMATE,
    MASS,
    MECHANISM,
    NOISE,
    ROBOT,
    SCENARIOS,
    STIFFNESS,
    THRESHOLD,
    VARIANTS,
)
from impact_gym.envs.task import MISSED_COST


def robustness(played: Played) -> list[Figure]:
    """Return a figure for each factor: V_p + w T over it."""
    return [_factor(played, factor) for factor in CONTINUOUS if _runs(played, factor)]


AS_TRAINED = {(DELAY, "16"), (THRESHOLD, "1"), (NOISE, "0"), (ESTIMATE, "10"), (MASS, "100"), (STIFFNESS, "100"),
              (MECHANISM, "1"), (ROBOT, "rigid"), (SCENARIOS, "as trained")}  # fmt: skip
"""Where a variant is no change, for the shipped recipes."""


def _runs(played: Played, factor: str) -> list[tuple[str, float, str, Run]]:
    """Label, value, contestant and run of each variant of a factor."""
    found = []
    for variant in VARIANTS:
        for (name, label, contestant), run in played.variants.items():
            if (name, label) == (variant.factor, variant.label) and name == factor:
                shown = POLICY if contestant == played.matchup.chosen else contestant
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
    weight = played.matchup.typical
    found = _runs(played, factor)
    data = pl.DataFrame([{"contestant": name, "value": value, **_row(run, weight)} for _, value, name, run in found])
    names = sorted(data["contestant"].unique(maintain_order=True), key=lambda name: (name != PAPER, name != POLICY))
    look = contestants(names)
    scale = alt.Scale(type="log", nice=False, padding=10) if "threshold" in factor or "stop" in factor else alt.Scale(
        zero=False, nice=False, padding=10
    )  # fmt: skip
    ticks = alt.Axis(values=data["value"].unique().sort().to_list(), format="~r")
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
    return Figure(f"{played.matchup.name}_{slug}", f"{played.matchup.name}: {factor}", "From left to right, "
                  + "; ".join(said) + "." + missed, "; ".join(said), chart + marks, data, 220)  # fmt: skip


def kinds(played: Played) -> Table:
    """Return what a compliant robot and the hard scenarios do."""
    weight = played.matchup.typical
    body = []
    for factor in (ROBOT, SCENARIOS):
        for label, _, name, run in _runs(played, factor):
            row = _row(run, weight)
            body.append((factor, label, name, f"{row['loss']:.4f}", f"{row['V']:.4f}", f"{row['T']:.4f}",
                         f"{row['missed']} of {run['missed'].shape[1]}"))  # fmt: skip
    head = ("changed", "to", "contestant", f"V_p + {weight:g} T (m/s)", "V_p (m/s)", "T (s)", "missed")
    return Table("A compliant robot (the paper's, 5.225 kg on 150 kN/m) instead of a rigid one, and the scenarios "
                 "beyond the training ranges: lighter, stiffer, less elastic, nearer", head, tuple(body))  # fmt: skip


def weak_points(played: Played) -> list[str]:
    """Return sentences on where the policy loses to its rival or to the paper's rule, or misses objects."""
    weight = played.matchup.typical
    against = dict.fromkeys((played.matchup.rival.name, PAPER))
    said, asked = [], 0
    for name in against:
        lost = []
        for factor in dict.fromkeys(variant.factor for variant in VARIANTS):
            found = {(label, who): run for label, _, who, run in _runs(played, factor)}
            labels = [
                label for label in dict.fromkeys(label for label, _ in found) if (factor, label) not in AS_TRAINED
            ]
            asked += len(labels)
            worse = []
            for label in labels:
                difference = found[label, POLICY].loss(weight) - found[label, name].loss(weight)
                if difference.mean() > 2.0 * difference.std(ddof=1) / np.sqrt(difference.size):
                    worse.append(f"{label} (by {difference.mean():.3f} m/s)")
            if worse:
                lost.append(f"{factor} {', '.join(worse)}")
        said.append(f"worse than {name} at {'; '.join(lost)}" if lost else f"nowhere worse than {name}")
    missing = [
        f"{count} of {run['missed'].shape[1]} at {factor} {label}"
        for factor in dict.fromkeys(variant.factor for variant in VARIANTS)
        for label, _, who, run in _runs(played, factor)
        if who == POLICY and (count := int(run.at(weight)["missed"].sum()))
    ]
    rule = f"{played.matchup.name}, {asked} comparisons of the median seed, worse by more than two standard errors: "
    return [rule + "; ".join(said) + ".", *([f"{played.matchup.name} misses {'; '.join(missing)}."] if missing else [])]


def simulator(played: Played) -> Table:
    """Return what other solvers and laws change, beside the gain."""
    weight, chosen, rival = played.matchup.typical, played.matchup.chosen, played.matchup.rival.name
    losses = {name: run.loss(weight) for name, run in ((PAPER, played.paper), (rival, played.rival))}
    gains = {name: float((loss - played.policy.loss(weight)).mean()) for name, loss in losses.items()}
    body = []
    seeds = [name for name in played.seeds if ("as it is", name) in played.exactly]
    for change in EXACT:
        if change == "as it is":
            continue
        pairs = {
            name: (played.exactly["as it is", name], played.exactly[change, name]) for name in {*seeds, rival, PAPER}
        }
        velocity = [
            after["object_velocity"][0] - before["object_velocity"][0] for before, after in map(pairs.get, seeds)
        ]
        shift = {
            name: float((after.loss(weight) - before.loss(weight)).mean()) for name, (before, after) in pairs.items()
        }
        body.append(_changed(change, f"{len(seeds)} seeds, {velocity[0].size}", velocity, shift, chosen, rival))
    for label in dict.fromkeys(label for label, _ in played.scipy):
        found = {name: arrays for (kind, name), arrays in played.scipy.items() if kind == label}
        velocity = [found[chosen]["object_velocity"] - found[chosen]["ours"]]
        shift = {name: float(_scipy_loss(one, weight).mean()) for name, one in found.items()}
        body.append(
            _changed(f"SciPy's solver, {label}", f"{chosen}, {velocity[0].size}", velocity, shift, chosen, rival)
        )
    if not played.scipy:
        body.append(("SciPy's solver", "not played: it takes neither drawn ranges nor noise", "", "", "", ""))
    head = ("changed", "played", "largest mean change of V_p (m/s)", "in any scenario (m/s)",
            "change of the gain over the rule (m/s)", f"over {rival} (m/s)")  # fmt: skip
    caption = (
        f"The gain in V_p + w T at w = {weight:g} is {gains[PAPER]:.4f} m/s over the paper's rule and "
        f"{gains[rival]:.4f} m/s over {rival}; what follows is by how much that changes."
    )
    return Table(caption, head, tuple(body))


def _changed(
    what: str, whom: str, velocity: list[Any], shift: Mapping[str, float], chosen: str, rival: str
) -> tuple[str, ...]:
    mean = max(abs(float(one.mean())) for one in velocity)
    most = max(float(np.abs(one).max()) for one in velocity)
    gains = (f"{shift[name] - shift[chosen]:+.2g}" if name in shift else "-" for name in (PAPER, rival))
    return (what, whom, f"{mean:.2g}", f"{most:.2g}", *gains)


def _scipy_loss(arrays: Mapping[str, Any], weight: float) -> Any:
    """Change of V_p + w T and of what misses cost (scenarios,), m/s."""
    return sum(
        scale * (arrays[name].astype(float) - arrays[ours])
        for name, ours, scale in (
            ("object_velocity", "ours", 1.0),
            ("approach_time", "our_time", weight),
            ("missed", "our_missed", MISSED_COST),
        )
    )
