"""The answer in one line, and the trade-off behind it.

The primary measure was fixed before the test set was played: V_p at the mean approach time of the paper's rule.
"""

from dataclasses import asdict, dataclass
from typing import Any

import altair as alt
import numpy as np
import polars as pl

from agents.validation import WEIGHTS
from experiments.report.arenas import PAPER, POLICY, Arena
from experiments.report.figures import Figure, Table, contestants, percent, plain, rows
from experiments.report.results import BOUND, FAMILY, Played, Run
from experiments.statistics import Estimate, Floats, Resamples, along, estimate, hypervolume, interquartile_mean

WIDE_REFERENCE = (0.6, 1.0)  # s, m/s: behind every front


@dataclass(frozen=True)
class Answer:
    """What one recipe of training gains over the paper's rule."""

    arena: str
    reduction: Estimate  # of V_p at the paper's mean approach time, a share
    sooner: Estimate  # of the approach time at the paper's mean V_p, a share
    at_the_end: bool  # its fastest approach still leaves the object slower: `sooner` is a lower bound
    reached: bool  # it can be as late as the paper's rule
    velocity: Estimate  # m/s, V_p of the policy there
    improvement: Estimate  # probability that it leaves the object slower in a scenario
    interquartile: tuple[float, float]  # m/s, of policy and rule
    missed: int  # of all episodes of all seeds
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
    times = resamples.means(stacked(played, "approach_time"))
    velocities = resamples.means(stacked(played, "object_velocity"))
    paper_time, paper_velocity = (
        resamples.means(played.paper[name])[:] for name in ("approach_time", "object_velocity")
    )
    there = along(times, velocities, paper_time)
    then = along(velocities, times, paper_velocity)
    late = as_late(played, "object_velocity")
    rule = played.paper["object_velocity"][0]
    missed = stacked(played, "missed")
    return Answer(
        played.arena.name,
        reduction=estimate(1.0 - there / paper_velocity),
        sooner=estimate(1.0 - then / paper_time),
        at_the_end=bool(velocities[0].max() < paper_velocity[0]),
        reached=bool(times[0].min() <= paper_time[0] <= times[0].max()),
        velocity=estimate(there),
        improvement=estimate(resamples.means((late < rule) + 0.5 * (late == rule))),
        interquartile=(interquartile_mean(late), interquartile_mean(rule)),
        missed=int(missed.sum()),
        episodes=missed.size,
    )


def answers_table(answers: list[Answer], played: list[Played]) -> Table:
    """Return the answers of all recipes."""
    head = (
        "recipe (seeds)", "V_p lower at the paper's approach time", "sooner at the paper's V_p", "V_p there (m/s)",
        "slower object in a scenario", "interquartile mean of V_p, rule's (m/s)", "missed",
    )  # fmt: skip
    body = []
    for one, play in zip(answers, played, strict=True):
        sooner = ("at least " if one.at_the_end else "") + percent(one.sooner)
        reduction = percent(one.reduction) + ("" if one.reached else " (at the nearest time it reaches)")
        middle = f"{one.interquartile[0]:.3f}, {one.interquartile[1]:.3f}"
        body.append((
            f"{one.arena} ({len(play.seeds)})", reduction, sooner, plain(one.velocity), percent(one.improvement),
            middle, f"{one.missed} of {one.episodes:,}",
        ))  # fmt: skip
    return Table("Each recipe against the paper's rule in its own environment, 95 % intervals", head, tuple(body))


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
    data = data.with_columns(chosen=pl.col("line") == played.arena.chosen)
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
        f" The {BOUND} is for the first {played.bound['missed'].shape[1]} scenarios, each of which it knows: "
        "no blind controller gets there."
    )  # fmt: skip
    caption = (
        "Down and left is better. A line per contestant over its time weights, the policy's faint lines are the other "
        f"seeds; {FAMILY} speed up and brake at 20 m/s² (first scenarios alone)." + bound
    )
    return Figure(f"{played.arena.name}_trade_off", f"{played.arena.name}: approach time against V_p", caption, text,
                  layers.interactive(), data, 380)  # fmt: skip


def fronts_table(played: Played) -> Table:
    """Return the hypervolume of each front at both reference points, at the weights of the bars alone."""
    resamples = Resamples(played.paper["missed"].shape[1])
    near = (float(played.paper["approach_time"].mean()), float(played.paper["object_velocity"].mean()))
    body = []
    groups: dict[str, tuple[Floats, Floats]] = {}
    weights = tuple(weight for weight in WEIGHTS if weight in played.policy.weights) or played.policy.weights
    groups[f"{POLICY}, {len(played.seeds)} seeds"] = (
        stacked(played, "approach_time", weights), stacked(played, "object_velocity", weights)
    )  # fmt: skip
    for name, run in played.baselines.items():
        groups[name] = run["approach_time"][None], run["object_velocity"][None]
    for name, (times, velocities) in groups.items():
        t, v = resamples.means(times.astype(float)), resamples.means(velocities.astype(float))
        volumes = [estimate(hypervolume(t, v, reference)) for reference in (near, WIDE_REFERENCE)]
        body.append((name, *(plain(volume, 4) for volume in volumes)))
    head = ("front", f"against ({near[0]:.3f} s, {near[1]:.3f} m/s), the paper's point (m)",
            f"against ({WIDE_REFERENCE[0]:g} s, {WIDE_REFERENCE[1]:g} m/s) (m)")  # fmt: skip
    return Table("Hypervolume: the area between front and reference point, more is better; fronts of the time weights "
                 + ", ".join(f"{weight:g}" for weight in weights), head, tuple(body))  # fmt: skip


def weights_table(played: Played) -> Table:
    """Return V_p + w T of policy, rival and bound at each weight, and the ratio with its interval."""
    count = played.paper["missed"].shape[1]
    resamples = Resamples(count)
    body = []
    for weight in (weight for weight in WEIGHTS if weight in played.policy.weights):
        ours = np.array([run.loss(weight) for run in played.seeds.values()])
        theirs = played.rival.loss(weight)
        chosen = played.policy.loss(weight)
        means = resamples.means(theirs[None])
        recipe = estimate(resamples.means(ours) / means)
        median = estimate(resamples.means(chosen[None]) / means)
        gap = "-"
        if played.bound is not None:
            first = played.bound["missed"].shape[1]
            bound = played.bound.loss(weight).mean()
            gap = f"{ours[:, :first].mean() - bound:.3f}, {theirs[:first].mean() - bound:.3f}"
        body.append((f"{weight:g}", f"{chosen.mean():.4f}", f"{theirs.mean():.4f}", plain(median, 4), plain(recipe, 4),
                     gap))  # fmt: skip
    head = ("time weight (m/s per s)", "median seed (m/s)", f"{played.arena.rival.name} (m/s)", "ratio, median seed",
            "ratio, all seeds", "above the bound: policy, baseline (m/s)")  # fmt: skip
    return Table("V_p + w T against the best baseline, tuned for each weight; below 1 the policy is better", head,
                 tuple(body))  # fmt: skip


def sentence(one: Answer, arena: Arena) -> str:
    """Return the answer of a recipe in a sentence."""
    sooner = "at least " if one.at_the_end else ""
    return (
        f"{arena.name}: the object leaves {percent(one.reduction)} slower at the paper's mean approach time; at the "
        f"paper's V_p the approach is {sooner}{percent(one.sooner)} sooner."
    )
