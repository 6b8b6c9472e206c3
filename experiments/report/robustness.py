"""Does it hold, and is it the simulator? Figures and tables of the changed environments and of the other solvers."""

from collections.abc import Mapping
from itertools import chain, groupby
from operator import attrgetter
from typing import Any

import altair as alt
import numpy as np
import polars as pl

from agents.setups.evaluation import Change
from experiments.report.figures import Figure, Table, contestants, rows
from experiments.report.matchups import PAPER, POLICY
from experiments.report.results import EXACT, Played, Run
from impact_gym.envs.setting import NUMBERS
from impact_gym.envs.task import MISSED_COST

SHOWN = {"s": ("ms", 1e3), "m": ("mm", 1e3)}  # units and scales of an axis, where they are others than a set-up's


def figures(played: Played) -> list[Figure]:
    """Return a figure for each argument that is varied over numbers: V_p + w T over it."""
    return [_figure(played, found) for found in _varied(played) if _numeric(found)]


def _varied(played: Played) -> list[list[tuple[Change, dict[str, Run]]]]:
    """Return each change with the runs of all contestants, in a list for each argument."""
    runs: dict[tuple[str, str], dict[str, Run]] = {}
    for (argument, label, contestant), run in played.varied.items():
        shown = POLICY if contestant == played.matchup.chosen else contestant
        runs.setdefault((argument, label), {})[shown] = run
    by_argument = groupby(played.matchup.changes, attrgetter("argument"))
    return [[(change, runs[change.argument, change.label]) for change in found] for _, found in by_argument]


def _numeric(found: list[tuple[Change, dict[str, Run]]]) -> bool:
    return all(np.isfinite(change.value) for change, _ in found)


def _axis(change: Change) -> tuple[str, float]:
    """Return the title of an axis, and what values are multiplied by."""
    words = change.argument.replace(".", ", ").replace("_", " ")
    if change.multiple:
        return f"{words} (%)", 100.0
    unit = "s" if change.argument in ("reaction_delay", "control_period") else NUMBERS[change.argument].unit
    shown, scale = SHOWN.get(unit, (unit, 1.0))
    return f"{words} ({shown})", scale


def _row(run: Run, weight: float) -> dict[str, Any]:
    one = run.at(weight)
    return {
        "loss": float(run.loss(weight).mean()),
        "V": float(one["object_velocity"].mean()),
        "T": float(one["approach_time"].mean()),
        "missed": int(one["missed"].sum()),
    }


def _place(change: Change) -> str:
    """Return what a change is, in words."""
    if not np.isfinite(change.value):
        return f"{change.argument} {change.label}"
    title, factor = _axis(change)
    return f"{title} {factor * change.value:g}"


def _figure(played: Played, found: list[tuple[Change, dict[str, Run]]]) -> Figure:
    weight, argument = played.matchup.typical, found[0][0].argument
    title, factor = _axis(found[0][0])
    data = pl.DataFrame([
        {"contestant": name, "value": factor * change.value, **_row(run, weight)}
        for change, runs in found
        for name, run in runs.items()
    ])  # fmt: skip
    names = sorted(data["contestant"].unique(maintain_order=True), key=lambda name: (name != PAPER, name != POLICY))
    look = contestants(names)
    least, most = data["value"].min(), data["value"].max()
    wide = least > 0.0 and most > 5.0 * least
    scale = alt.Scale(padding=10, nice=False, **({"type": "log"} if wide else {"zero": False}))
    ticks = alt.Axis(values=data["value"].unique().sort().to_list(), labelExpr="format(datum.value, '~g')")
    chart = alt.Chart(rows(data)).mark_line().encode(
        x=alt.X("value:Q", title=title, scale=scale, axis=ticks),
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
    missed = f" The policy misses at most {worst} of {found[0][1][POLICY]['missed'].shape[1]} objects." if worst else ""
    name, text = played.matchup.name, "; ".join(said)
    caption = f"From left to right, {text}.{missed}"
    return Figure(f"{name}_{argument}", f"{name}: {title}", caption, text, chart + marks, data, 220)


def categories(played: Played) -> Table:
    """Return the table of changes that are not numbers, such as a compliant robot or other scenarios."""
    weight = played.matchup.typical
    body = []
    for change, runs in chain.from_iterable(found for found in _varied(played) if not _numeric(found)):
        for name, run in runs.items():
            row = _row(run, weight)
            body.append((change.argument, change.label, name, f"{row['loss']:.4f}", f"{row['V']:.4f}",
                         f"{row['T']:.4f}", f"{row['missed']} of {run['missed'].shape[1]}"))  # fmt: skip
    head = ("changed", "to", "contestant", f"V_p + {weight:g} T (m/s)", "V_p (m/s)", "T (s)", "missed")
    return Table("Another robot, other scenarios: hard ones lie beyond the training ranges, lighter, stiffer, less "
                 "elastic, nearer", head, tuple(body))  # fmt: skip


def weak_points(played: Played) -> list[str]:
    """Return sentences on where the policy loses to its rival or to the paper's rule, or misses objects."""
    weight, name = played.matchup.typical, played.matchup.name
    varied = {_place(change): (change, runs) for change, runs in chain.from_iterable(_varied(played))}
    asked = {what: runs for what, (change, runs) in varied.items() if not change.same}
    said = []
    for rival in dict.fromkeys((played.matchup.rival.name, PAPER)):
        lost = []
        for what, runs in asked.items():
            difference = runs[POLICY].loss(weight) - runs[rival].loss(weight)
            if difference.mean() > 2.0 * difference.std(ddof=1) / np.sqrt(difference.size):
                lost.append(f"{what} (by {difference.mean():.3f} m/s)")
        said.append(f"worse than {rival} at {', '.join(lost)}" if lost else f"nowhere worse than {rival}")
    missing = [
        f"{count} of {runs[POLICY]['missed'].shape[1]} at {what}"
        for what, (_, runs) in varied.items()
        if (count := int(runs[POLICY].at(weight)["missed"].sum()))
    ]
    comparisons = len(asked) * len(said)
    rule = f"{name}, {comparisons} comparisons of the median seed, worse by more than two standard errors: "
    return [rule + "; ".join(said) + ".", *([f"{name} misses {'; '.join(missing)}."] if missing else [])]


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
