"""The answer in one line, and the trade-off behind it.

The primary measure was fixed before the test set was played: V_p at the mean approach time of the paper's rule.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import altair as alt
import numpy as np
import polars as pl

from experiments.lab.statistics import Estimate, Floats, Resamples, along, estimate, hypervolume, interquartile_mean
from experiments.report.figures import Figure, Table, contestants, percent, plain, rows, zoomable
from experiments.report.matchups import BOUND, PAPER, POLICY, Matchup
from experiments.report.results import FAMILY, Played, Run

WIDE_REFERENCE = (0.6, 1.0)  # s, m/s: behind every front
MISSED_TOO_OFTEN = 0.01  # of the objects: a missed one has no V_p


@dataclass(frozen=True)
class Answer:
    """What one recipe of training gains over the paper's rule."""

    matchup: str
    reduction: Estimate  # of V_p at the paper's mean approach time, a share
    reached: bool  # its curve comes to that time; if not, it is the end nearest to it
    sooner: Estimate  # of the approach time at the paper's mean V_p, a share
    beyond: (
        str  # "": its curve comes to that V_p; "slower": its fastest approach leaves the object slower still; "faster"
    )
    velocity: Estimate  # m/s, V_p of the policy at that time
    rival: str  # the best tuned baseline, if there is one
    rival_reduction: Estimate | None  # the same of that one
    improvement: Estimate  # share of scenarios in which it leaves the object slower, and touches it
    interquartile: tuple[float, float]  # m/s, of policy and rule
    missed: int  # of all episodes of all seeds at all weights
    episodes: int

    def as_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


def stacked(played: Played, name: str, weights: tuple[float, ...] | None = None) -> Floats:
    """Return a result of all seeds (seeds, weights, scenarios)."""
    chosen = played.policy.weights if weights is None else weights
    return np.array([[run.at(weight)[name] for weight in chosen] for run in played.seeds.values()], np.float64)


def as_late(played: Played, name: str) -> Floats:
    """Return a result of all seeds, as late as the paper's rule (seeds, scenarios)."""
    return np.array([run[name][0] for run in played.as_late.values()], np.float64)


def answer(played: Played) -> Answer:
    """Return what the recipe gains, seeds and scenarios resampled."""
    resamples = Resamples(played.paper["missed"].shape[1])
    paper_time, paper_velocity = (
        resamples.means(played.paper[name])[:] for name in ("approach_time", "object_velocity")
    )

    def front(of: Callable[[str], Floats]) -> tuple[Floats, Floats]:
        return resamples.means(of("approach_time")), resamples.means(of("object_velocity"))

    times, velocities = front(lambda name: stacked(played, name))
    there = along(times, velocities, paper_time)
    then = along(velocities, times, paper_velocity)
    rival = played.matchup.rival.name if len(played.rival.weights) > 1 else ""
    rival_there = along(*front(lambda name: played.rival[name].astype(float)[None]), paper_time) if rival else None
    late = as_late(played, "object_velocity")
    touched = as_late(played, "missed") == 0.0
    rule = played.paper["object_velocity"][0]
    missed = stacked(played, "missed")
    fastest, slowest = velocities[0].max(), velocities[0].min()
    return Answer(
        played.matchup.name,
        reduction=estimate(1.0 - there / paper_velocity),
        reached=bool(times[0].min() <= paper_time[0] <= times[0].max()),
        sooner=estimate(1.0 - then / paper_time),
        beyond="slower" if fastest < paper_velocity[0] else "faster" if slowest > paper_velocity[0] else "",
        velocity=estimate(there),
        rival=rival,
        rival_reduction=None if rival_there is None else estimate(1.0 - rival_there / paper_velocity),
        improvement=estimate(resamples.means(((late < rule) + 0.5 * (late == rule)) * touched)),
        interquartile=(interquartile_mean(late), interquartile_mean(rule)),
        missed=int(missed.sum()),
        episodes=missed.size,
    )


def answers_table(answers: list[Answer], played: list[Played]) -> Table:
    """Return the answers of all recipes."""
    head = (
        "recipe (seeds)", "V_p lower at the paper's approach time", "the same, best tuned baseline",
        "sooner at the paper's V_p", "V_p there (m/s)", "object slower in so many scenarios",
        "interquartile mean of V_p, rule's (m/s)", "missed",
    )  # fmt: skip
    body = []
    for one, play in zip(answers, played, strict=True):
        sooner = {"": "", "slower": "at least ", "faster": "(not reached) "}[one.beyond] + percent(one.sooner)
        reduction = percent(one.reduction) + ("" if one.reached else " (at the nearest time it reaches)")
        rival = f"{percent(one.rival_reduction)}, {one.rival}" if one.rival_reduction else "-"
        middle = f"{one.interquartile[0]:.3f}, {one.interquartile[1]:.3f}"
        body.append((
            f"{one.matchup} ({len(play.seeds)})", reduction, rival, sooner, plain(one.velocity),
            percent(one.improvement), middle, f"{one.missed} of {one.episodes:,}",
        ))  # fmt: skip
    return Table("Each recipe against the paper's rule in its own environment, 95 % intervals; a miss is no win", head,
                 tuple(body))  # fmt: skip


def trade_off(played: Played) -> Figure:
    """Return the figure of approach time against V_p."""
    frames = []

    def add(name: str, group: str, run: Run, weights: tuple[float, ...]) -> None:
        for weight in weights:
            one = run.at(weight)
            frames.append({
                "contestant": name, "line": group, "w": weight,
                "T": float(one["approach_time"].mean()), "V": float(one["object_velocity"].mean()),
                "missed": int(one["missed"].sum()),
            })  # fmt: skip

    for name, run in played.baselines.items():
        add(name, name, run, run.weights)
    for seed, run in played.seeds.items():
        add(POLICY, seed, run, run.weights)
    for speed, run in played.family.items():
        add(FAMILY, FAMILY, run, run.weights)
        frames[-1]["line"], frames[-1]["speed"] = FAMILY, speed
    if played.bound is not None:
        add(BOUND, BOUND, played.bound, played.bound.weights)
    data = pl.DataFrame(frames, infer_schema_length=None)
    names = [POLICY, *played.baselines, FAMILY, *([BOUND] if played.bound is not None else [])]
    names = sorted(dict.fromkeys(names), key=lambda name: (name != PAPER, name != POLICY))
    look = contestants(names)
    data = data.with_columns(chosen=pl.col("line") == played.matchup.chosen)
    base = alt.Chart(rows(data)).encode(
        x=alt.X("T:Q", title="mean approach time (s)", scale=alt.Scale(zero=False, nice=True)),
        y=alt.Y("V:Q", title="mean V_p (m/s)", scale=alt.Scale(zero=True)),
        color=alt.Color("contestant:N", title=None, scale=look["color"]),
    )
    lines = (
        base.transform_filter("datum.chosen || datum.contestant != 'learned policy'")
        .mark_line()
        .encode(detail="line:N", order="w:Q", strokeDash=alt.StrokeDash("contestant:N", title=None, scale=look["dash"]))
    )
    faint = base.transform_filter("!datum.chosen && datum.contestant == 'learned policy'").mark_line(
        strokeWidth=0.8, opacity=0.45
    ).encode(detail="line:N", order="w:Q")  # fmt: skip
    marks = base.transform_filter("datum.chosen || datum.contestant != 'learned policy'").mark_point(size=70).encode(
        shape=alt.Shape("contestant:N", title=None, scale=look["shape"]),
        tooltip=[alt.Tooltip("contestant:N"), alt.Tooltip("line:N", title="seed or line"),
                 alt.Tooltip("w:Q", title="time weight (m/s per s)"), alt.Tooltip("T:Q", title="T (s)", format=".4f"),
                 alt.Tooltip("V:Q", title="V_p (m/s)", format=".4f"), alt.Tooltip("missed:Q")],
    )  # fmt: skip
    layers = faint + lines + marks if len(played.seeds) > 1 else lines + marks
    paper = data.filter(pl.col("contestant") == PAPER)
    at = data.filter(pl.col("chosen")).sort("T")
    text = (
        f"Paper's rule: {paper['T'][0]:.3f} s, {paper['V'][0]:.3f} m/s. The policy's curve goes from "
        f"{at['T'][0]:.3f} s and {at['V'][0]:.3f} m/s to {at['T'][-1]:.3f} s and {at['V'][-1]:.3f} m/s."
    )
    bound = "" if played.bound is None else (
        f" {BOUND.capitalize()}, is the best that a search found for each of the first "
        f"{played.bound['missed'].shape[1]} scenarios by itself: what one could do who knew the object."
    )  # fmt: skip
    caption = (
        "Down and left is better. A line per contestant over its time weights, the policy's faint lines are the other "
        f"seeds; {FAMILY} is sped up to and braked at 16 m/s² or as hard as the arm can." + bound
    )
    name = played.matchup.name
    return Figure(f"{name}_trade_off", f"{name}: approach time against V_p", caption, text, zoomable(layers), data, 380)


def fronts_table(played: Played) -> Table:
    """Return the hypervolume of each front at both reference points, at the weights of the bars alone."""
    resamples = Resamples(played.paper["missed"].shape[1])
    near = (float(played.paper["approach_time"].mean()), float(played.paper["object_velocity"].mean()))
    body = []
    groups: dict[str, tuple[Floats, Floats]] = {}
    weights = played.matchup.weights
    groups[f"{POLICY}, {len(played.seeds)} seeds"] = (
        stacked(played, "approach_time", weights), stacked(played, "object_velocity", weights)
    )  # fmt: skip
    for name, run in played.baselines.items():
        groups[name] = run["approach_time"][None], run["object_velocity"][None]
    first: list[Floats] = []
    for name, (times, velocities) in groups.items():
        t, v = resamples.means(times.astype(float)), resamples.means(velocities.astype(float))
        volumes = [hypervolume(t, v, reference) for reference in (near, WIDE_REFERENCE)]
        first = first or volumes
        cells = [
            f"{plain(estimate(own), 4)}; {plain(estimate(own - policy), 4)}"
            if own is not policy
            else plain(estimate(own), 4)
            for own, policy in zip(volumes, first, strict=True)
        ]
        body.append((name, *cells))
    head = ("front", f"against ({near[0]:.3f} s, {near[1]:.3f} m/s), the paper's point (m)",
            f"against ({WIDE_REFERENCE[0]:g} s, {WIDE_REFERENCE[1]:g} m/s) (m)")  # fmt: skip
    shown = ", ".join(f"{weight:g}" for weight in weights)
    caption = (
        "Hypervolume: the area between front and reference point, more is better; behind it the difference to the "
        f"policy's. Fronts of the time weights {shown}"
    )
    return Table(caption, head, tuple(body))


def weights_table(played: Played) -> Table:
    """Return V_p + w T of policy, rival and bound at each weight, and the ratio with its interval."""
    count = played.paper["missed"].shape[1]
    resamples = Resamples(count)
    body = []
    for weight in played.matchup.weights:
        ours = np.array([run.loss(weight) for run in played.seeds.values()])
        theirs = played.rival.loss(weight)
        chosen = played.policy.loss(weight)
        means = resamples.means(theirs[None])
        recipe = estimate(resamples.means(ours) / means)
        median = estimate(resamples.means(chosen[None]) / means)
        gap = "-"
        if played.bound is not None and weight in played.bound.weights:
            first = played.bound["missed"].shape[1]
            few, bound = Resamples(first), played.bound.loss(weight)
            gaps = [estimate(few.means(one)) for one in (ours[:, :first] - bound, (theirs[:first] - bound)[None])]
            gap = ", ".join(plain(one) for one in gaps)
        body.append((f"{weight:g}", f"{chosen.mean():.4f}", f"{theirs.mean():.4f}", plain(median, 4), plain(recipe, 4),
                     gap))  # fmt: skip
    head = ("time weight (m/s per s)", "median seed (m/s)", f"{played.matchup.rival.name} (m/s)", "ratio, median seed",
            "ratio, all seeds", "above the search that knows: policy, baseline (m/s)")  # fmt: skip
    return Table("V_p + w T against the best baseline, tuned for each weight; below 1 the policy is better", head,
                 tuple(body))  # fmt: skip


def sentence(one: Answer, matchup: Matchup) -> str:
    """Return the answer of a recipe in a sentence or two."""
    begin = f"{matchup.name} ({matchup.note}): "
    if one.missed > MISSED_TOO_OFTEN * one.episodes:
        return begin + f"it misses {one.missed:,} of {one.episodes:,} objects, so nothing is claimed for it."
    if one.reached:
        said = f"the object leaves {_compared(one.reduction, 'slower', 'faster')} at the paper's mean approach time"
    else:
        said = f"no weight makes its approach as long as the paper's; at the nearest the object leaves " \
               f"{_compared(one.reduction, 'slower', 'faster')}"  # fmt: skip
    if one.beyond == "faster":
        said += "; it nowhere leaves the object as slow as the paper's rule."
    else:
        least = "at least " if one.beyond == "slower" else ""
        said += f"; at the paper's V_p the approach is {least}{_compared(one.sooner, 'sooner', 'later')}."
    if one.rival_reduction:
        said += f" The best tuned baseline, {one.rival}: {_compared(one.rival_reduction, 'slower', 'faster')}."
    return begin + said + (f" It misses {one.missed} of {one.episodes:,} objects." if one.missed else "")


def _compared(share: Estimate, good: str, bad: str) -> str:
    if share.value >= 0.0:
        return f"{percent(share)} {good}"
    return f"{percent(Estimate(-share.value, -share.high, -share.low))} {bad}"
