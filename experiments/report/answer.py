"""The answer in one sentence, and the trade-off of time and velocity.

The primary measure was fixed before the test set was played: V_p at the mean approach time of the paper's rule.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import altair as alt
import numpy as np
import polars as pl

from experiments.lab.parts import Table, percent
from experiments.lab.statistics import Comparison, Estimate, Floats, Front, Resamples, along, estimate, tolerated
from experiments.report.figures import Figure, chart_of, looks_of, zoomable
from experiments.report.matchups import BOUND, POLICY, Matchup
from experiments.report.played import MISSED_TOO_OFTEN, Played, Run

FRONT = ("approach_time", "object_velocity")


@dataclass(frozen=True)
class Answer:
    """Gain of the policies of one set-up over the paper's rule."""

    matchup: str
    reduction: Estimate  # of V_p at the paper's mean approach time, a share
    each: tuple[float, ...]  # the same for each seed; empty if one does not reach that time
    reached: bool  # whether the front reaches that time; if not, `reduction` is at its nearest end
    later: float  # difference of that end from that time, a share of it; below 0 sooner
    needed: float  # time weight at which the front would reach it, on the line through its last two, m/s per s
    sooner: Estimate  # of the approach time at the paper's mean V_p, a share
    beyond: str  # "": the front reaches that V_p; "slower", "faster": the object is so at every weight
    velocity: Estimate  # m/s, V_p of the policy at that time
    rival: str  # the best tuned baseline, if there is one
    rival_reduction: Estimate | None  # its reduction of V_p; None if it is later at every weight
    improvement: Estimate  # share of scenarios in which the policy touches the object and V_p is lower
    missed: int  # of all episodes of all seeds at all weights
    episodes: int


def answer(played: Played) -> Answer:
    """Return the gain of a set-up's policies, with seeds and scenarios resampled."""
    resamples = played.resamples
    contestants = [played.paper], list(played.seeds.values()), [played.rival]
    paper, policy, rival = (front(resamples, runs) for runs in contestants)
    (times, velocities), time, velocity = policy, paper[0][0, 0], paper[1][0, 0]
    at_time, at_speed = Comparison.of_fronts(policy, paper), Comparison.of_fronts(policy[::-1], paper[::-1])
    tuned = len(played.rival.weights) > 1
    comparable = tuned and rival[0][0].min() <= time
    nearest = np.clip(time, times[0].min(), times[0].max())
    as_late, missed_then = (
        np.array([run[name][0] for run in played.as_late.values()]) for name in (FRONT[1], "missed")
    )
    rule = played.paper["object_velocity"][0]
    missed = np.array([run["missed"] for run in played.seeds.values()])
    fastest, slowest = velocities[0].max(), velocities[0].min()
    return Answer(
        played.matchup.name,
        reduction=at_time.reduction,
        each=tuple(reductions(played).tolist()),
        reached=bool(nearest == time),
        later=float(nearest / time - 1.0),
        needed=_needed(played.policy.weights, times[0], time),
        sooner=at_speed.reduction,
        beyond="slower" if fastest < velocity else "faster" if slowest > velocity else "",
        velocity=estimate(at_time.ours),
        rival=played.matchup.rival.name if tuned else "",
        rival_reduction=Comparison.of_fronts(rival, paper).reduction if comparable else None,
        improvement=estimate(resamples.means(((as_late < rule) + 0.5 * (as_late == rule)) * ~missed_then)),
        missed=int(missed.sum()),
        episodes=missed.size,
    )


def _needed(weights: Sequence[float], times: Floats, time: float) -> float:
    """Return the weight at which approach times (k,) would reach `time` (s): linear in its logarithm; nan if far."""
    order = np.argsort(weights)[-2:] if times.min() > time else np.argsort(weights)[:2]
    (first, last), ends = np.log(np.asarray(weights)[order]), times[order]
    slope = (ends[1] - ends[0]) / (last - first)
    log = first + (time - ends[0]) / slope if slope < 0.0 else np.inf
    return float(np.exp(log)) if abs(log) < np.log(100.0) else np.nan


def front(resamples: Resamples, runs: Sequence[Run]) -> Front:
    """Return mean approach time (s) and V_p (m/s) of runs, one for each seed, on the first scenarios."""
    times, velocities = (np.array([run[name][:, : resamples.scenarios] for run in runs]) for name in FRONT)
    return resamples.means(times), resamples.means(velocities)


def reductions(played: Played) -> Floats:
    """Return the reduction of V_p by each seed at the paper's mean approach time, a share (seeds,).

    It is empty if the front of one seed does not reach that time: they would be compared at different times.
    """
    ((time, velocity),) = played.paper.front
    times, velocities = np.moveaxis(np.array([run.front for run in played.seeds.values()]), 2, 0)
    if times.min(axis=1).max() > time or times.max(axis=1).min() < time:
        return np.empty(0)
    return 1.0 - along(times, velocities, np.full(len(times), time)) / velocity


def table(answer: Answer, played: Played) -> Table:
    """Return the answer with its intervals."""
    rival = "-" if answer.rival_reduction is None else percent(answer.rival_reduction)
    sooner = {"": "", "slower": "at least ", "faster": "(not reached) "}[answer.beyond] + percent(answer.sooner)
    reduction = percent(answer.reduction) + ("" if answer.reached else " (at the nearest time it reaches)")
    body = [
        ("V_p lower at the paper's approach time", reduction),
        ("95 % of trainings: at least", _at_least(answer)),
        (f"V_p lower there, {played.matchup.rival.plain}", rival),
        ("sooner at the paper's V_p", sooner),
        ("V_p at the paper's approach time (m/s)", f"{answer.velocity:.3f}"),
        ("share of scenarios with a lower V_p", percent(answer.improvement)),
        ("objects missed, at all weights", f"{answer.missed} of {answer.episodes:,}"),
    ]
    policies = f"{len(played.seeds)} trainings" if len(played.seeds) > 1 else "one policy"
    caption = f"{policies} against the paper's rule on {played.count:,} scenarios, 95 % intervals; a miss is not lower"
    return Table(caption[0].upper() + caption[1:], ("what", POLICY), body)


def at_one_time(played: Played) -> Table:
    """Return mean and 95th percentile of T, V_p and peak force of each, at the weight nearest to the rule's mean time.

    With friction also the time at which object and tool rest. The mean alone hides the worst approaches.
    """
    goal, labels = played.paper.front[0][0], played.matchup.labels
    contestants = {labels[name]: run for name, run in played.baselines.items()} | {POLICY: played.policy_as_late}
    columns = {"T (s)": "approach_time", "V_p (m/s)": "object_velocity", "peak force (N)": "peak_force"}
    columns |= {} if played.paper.at(played.paper.weights[0]).rest_time is None else {"at rest (s)": "rest_time"}
    body = []
    for label, run in contestants.items():
        weight = min(run.weights, key=lambda each: abs(run.means(each)["T"] - goal))
        values = [getattr(run.at(weight), field) for field in columns.values()]
        numbers = [f"{each.mean():.3g}, {np.percentile(each, 95.0):.3g}" for each in values]
        body.append((label, f"{weight:.3g}", *numbers, str(int(run.at(weight).missed.sum()))))
    caption = f"Mean, 95th percentile, of {played.count:,} scenarios; a missed object counts with V_p = 0"
    return Table(caption, ("contestant", "w (m/s per s)", *columns, "missed"), body)


def _at_least(answer: Answer) -> str:
    return f"{100 * tolerated(np.array(answer.each)):.1f} %" if len(answer.each) > 1 else "-"


def trade_off(played: Played) -> Figure:
    """Return the figure of approach time against V_p."""
    labels = played.matchup.labels
    runs = [(labels[name], name, run) for name, run in played.baselines.items()]
    runs += [(POLICY, seed, run) for seed, run in played.seeds.items()]
    runs += [(BOUND, BOUND, played.bound)] if played.bound else []
    data = pl.DataFrame([
        {"contestant": name, "line": line, "w": weight, **run.means(weight)}
        for name, line, run in runs
        for weight in run.weights
    ])  # fmt: skip
    data = data.with_columns(chosen=pl.col("line") == played.matchup.chosen)
    looks = looks_of(data)
    base = chart_of(data).encode(
        alt.X("T:Q", title=f"mean time until {played.matchup.until} (s)", scale=alt.Scale(zero=False, nice=True)),
        alt.Y("V:Q", title="mean V_p (m/s)", scale=alt.Scale(zero=True)),
        looks.colour,
    )
    prominent = base.transform_filter("datum.chosen || datum.contestant != 'learned policy'")
    curves = prominent.mark_line().encode(looks.dash, detail="line:N", order="w:Q")
    faint = base.transform_filter("!datum.chosen && datum.contestant == 'learned policy'").mark_line(
        strokeWidth=0.8, opacity=0.45
    ).encode(detail="line:N", order="w:Q")  # fmt: skip
    marks = prominent.mark_point(size=70).encode(looks.shape, tooltip=[
        "contestant:N", alt.Tooltip("line:N", title="seed or line"),
        alt.Tooltip("w:Q", title="time weight (m/s per s)"), alt.Tooltip("T:Q", title="T (s)", format=".4f"),
        alt.Tooltip("V:Q", title="V_p (m/s)", format=".4f"), "missed:Q",
    ])  # fmt: skip
    layers = faint + curves + marks if len(played.seeds) > 1 else curves + marks
    bound = "" if played.bound is None else (
        f" The {BOUND} is the best approach that a search found for each of the first "
        f"{played.bound['missed'].shape[1]} scenarios with the object known."
    )  # fmt: skip
    caption = (
        "Down and left is better. One line per contestant over its time weights; faint lines are the other seeds."
        + bound
    )
    subject = f"time until {played.matchup.until} against V_p, all contestants and seeds"
    return Figure(played.matchup.name, "trade_off", subject, caption, in_words(played), zoomable(layers), data, 380)


def in_words(played: Played) -> str:
    """Return the text alternative of a chart of the trade-off."""
    places = [f"{time:.3f} s and {velocity:.3f} m/s" for time, velocity in (*played.paper.front, *played.policy.front)]
    return f"Paper's rule: {places[0]}. The learned policy: from {places[1]} to {places[-1]}."


def weights_table(played: Played) -> Table:
    """Return V_p + w T of policy, rival and bound at each weight, their ratios, and the bound for the next training."""
    body = []
    for weight in played.matchup.weights:
        ours, theirs, chosen = played.losses(weight), played.rival.loss(weight), played.policy.loss(weight)
        median, recipe = (Comparison.of_means(loss, theirs).ratio for loss in (chosen, ours))
        by_seed, gap = ours.mean(axis=1), "-"
        if played.bound is not None and weight in played.bound.weights:
            bound = played.bound.loss(weight)
            gaps = [Comparison.of_means(bound, loss[..., : bound.size]).less for loss in (ours, theirs)]
            gap = ", ".join(f"{estimate:.3f}" for estimate in gaps)
        next_one = f"{-tolerated(-by_seed):.4f}, {by_seed.max():.4f}" if by_seed.size > 1 else "-"
        body.append((f"{weight:g}", f"{chosen.mean():.4f}", f"{theirs.mean():.4f}", f"{median:.4f}", f"{recipe:.4f}",
                     next_one, gap))  # fmt: skip
    head = ("time weight (m/s per s)", "median seed (m/s)", f"{played.matchup.rival.label} (m/s)", "ratio, median seed",
            "ratio, all seeds", "95 % of trainings at most, worst seed (m/s)",
            "above the clairvoyant search: policy, baseline (m/s)")  # fmt: skip
    return Table("V_p + w T against the best baseline, tuned for each weight; below 1 the policy is better", head, body)


def sentence(answer: Answer, matchup: Matchup) -> str:
    """Return the answer of a set-up in a sentence or two."""
    begin = f"{matchup.name} ({matchup.note}): "
    if answer.missed > MISSED_TOO_OFTEN * answer.episodes:
        return begin + f"it misses {answer.missed:,} of {answer.episodes:,} objects, so nothing is claimed for it."
    change = _compared(answer.reduction, "slower", "faster")
    if answer.reached:
        text = f"the object leaves {change} at the paper's mean approach time"
        if len(answer.each) > 1 and answer.reduction.value >= 0.0:
            text += f" (95 % of trainings: at least {_at_least(answer)})"
    else:
        length, direction = ("short", "later") if answer.later > 0.0 else ("long", "sooner")
        text = f"no weight makes its approach as {length} as the paper's; at the nearest, "
        text += f"{100 * abs(answer.later):.1f} % {direction}, the object leaves {change}"
        text += f" (a time weight of about {answer.needed:.2g} would be as {length})" if answer.needed > 0.0 else ""
    if answer.beyond == "faster":
        text += "; at every weight the object leaves faster than with the paper's rule."
    else:
        limit = "at least" if answer.sooner.value >= 0.0 else "at most"  # at its fastest approach the object is slower
        bound = f"{limit} " if answer.beyond == "slower" else ""
        text += f"; at the paper's V_p the approach is {bound}{_compared(answer.sooner, 'sooner', 'later')}."
    if answer.rival_reduction:
        text += f" The best tuned baseline, {answer.rival}: {_compared(answer.rival_reduction, 'slower', 'faster')}."
    return begin + text + (f" It misses {answer.missed} of {answer.episodes:,} objects." if answer.missed else "")


def _compared(share: Estimate, good: str, bad: str) -> str:
    if share.value >= 0.0:
        return f"{percent(share)} {good}"
    return f"{percent(Estimate(-share.value, -share.high, -share.low))} {bad}"
