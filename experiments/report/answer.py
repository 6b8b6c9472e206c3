"""The answer in sentences and tables, and the trade-off of approach time and V_p.

The primary measure is V_p at the mean approach time of the paper's rule. It was fixed before the test set was played.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import altair as alt
import numpy as np
import polars as pl

from experiments.lab.parts import Table, percent
from experiments.lab.statistics import Comparison, Estimate, Floats, Front, Resamples, along, estimate, tolerated
from experiments.report.figures import ZOOM, Figure, chart_of, looks_of
from experiments.report.matchups import BOUND, IMITATES, PAPER, POLICY, Matchup
from experiments.report.played import MISSED_TOO_OFTEN, Played, Run
from impact_gym.task.task import VELOCITY_RANGE

FRONT = ("approach_time", "object_velocity")


@dataclass(frozen=True)
class Answer:
    """Gain of the policies of one set-up over the paper's rule."""

    reduction: Estimate  # of V_p at the paper's mean approach time, as a fraction
    each: tuple[float, ...]  # reduction of each seed; empty if a seed's front does not reach the paper's time
    reached: bool  # whether the policy's front reaches that time; if not, `reduction` is at the front's nearest end
    later: float  # (time at that end - the paper's time) / the paper's time; below 0: less time
    needed: float  # time weight, m/s per s, at which the extrapolated front would reach that time; or nan
    sooner: Estimate  # reduction of the approach time at the paper's mean V_p, as a fraction
    beyond: str  # "": the front reaches that V_p; "slower", "faster": V_p is below, above it at every weight
    velocity: Estimate  # m/s, V_p of the policy at the paper's mean approach time
    rival: str  # name of the best tuned baseline, or ""
    rival_reduction: Estimate | None  # the rival's reduction of V_p; None if no weight is as fast as the rule
    improvement: Estimate  # share of scenarios in which the policy touches the object and lowers V_p
    missed: int  # objects, of all episodes of all seeds at all weights
    episodes: int


def answer(played: Played) -> Answer:
    """Return the gain of a set-up's policies; its intervals come from resampled seeds and scenarios."""
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
    """Return the time weight at which the mean approach times (k,) would reach `time` (s).

    The time is extrapolated linearly in the logarithm of the weight. nan: the weight is not within 0.01 and 100.
    """
    order = np.argsort(weights)[-2:] if times.min() > time else np.argsort(weights)[:2]
    (first, last), ends = np.log(np.asarray(weights)[order]), times[order]
    slope = (ends[1] - ends[0]) / (last - first)
    log = first + (time - ends[0]) / slope if slope < 0.0 else np.inf
    return float(np.exp(log)) if abs(log) < np.log(100.0) else np.nan


def front(resamples: Resamples, runs: Sequence[Run]) -> Front:
    """Return mean approach time (s) and V_p (m/s) of runs, a run for each seed, in the scenarios of `resamples`."""
    times, velocities = (np.array([run[name][:, : resamples.scenarios] for run in runs]) for name in FRONT)
    return resamples.means(times), resamples.means(velocities)


def reductions(played: Played) -> Floats:
    """Return the reduction of V_p by each seed at the paper's mean approach time, as a fraction (seeds,).

    It is empty if the front of one seed does not reach that time: the seeds would be compared at different times.
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
        ("less approach time at the paper's V_p", sooner),
        ("V_p at the paper's approach time (m/s)", f"{answer.velocity:.3f}"),
        ("share of scenarios with a lower V_p", percent(answer.improvement)),
        ("objects missed, at all weights", f"{answer.missed} of {answer.episodes:,}"),
    ]
    policies = f"{len(played.seeds)} trainings" if len(played.seeds) > 1 else "One policy"
    caption = f"{policies} against the paper's rule in {played.count:,} scenarios, 95 % intervals; a miss is not lower"
    return Table(caption, ("what", POLICY), body)


def at_one_time(played: Played) -> Table:
    """Return mean and 95th percentile of T, V_p and peak force of each contestant.

    Each contestant plays at the weight whose mean approach time is nearest to the rule's. With friction the table also
    has the time at which object and tool rest.
    """
    goal, labels = played.paper.front[0][0], played.matchup.labels
    contestants = {labels[name]: run for name, run in played.baselines.items()} | {
        POLICY: played.as_late[played.matchup.chosen]
    }
    columns = {"T (s)": "approach_time", "V_p (m/s)": "object_velocity", "peak force (N)": "peak_force"}
    columns |= {} if played.paper.at(played.paper.weights[0]).rest_time is None else {"at rest (s)": "rest_time"}
    body = []
    for label, run in contestants.items():
        weight = min(run.weights, key=lambda each: abs(run.means(each)["T"] - goal))
        values = [getattr(run.at(weight), field) for field in columns.values()]
        numbers = [f"{each.mean():.3g}, {np.percentile(each, 95.0):.3g}" for each in values]
        body.append((label, f"{weight:.3g}", *numbers, str(int(run.at(weight).missed.sum()))))
    caption = f"Mean, 95th percentile of {played.count:,} scenarios; a missed object counts as V_p = 0"
    return Table(caption, ("contestant", "w (m/s per s)", *columns, "missed"), body)


def _at_least(answer: Answer) -> str:
    """Return the reduction that 95 % of trainings reach."""
    return f"{100 * tolerated(np.array(answer.each)):.1f} %" if len(answer.each) > 1 else "-"


def trade_off(played: Played, first_screen: bool = False) -> Figure:
    """Return the figure of approach time against V_p: all seeds and baselines, or the three of the first screen."""
    matchup = played.matchup
    labels = {each.name: each.plain if first_screen else each.label for each in matchup.baselines}
    names = (PAPER, matchup.rival.name) if first_screen else labels
    runs = [(labels[name], name, played.baselines[name]) for name in dict.fromkeys(names)]
    seeds = {matchup.chosen: played.policy} if first_screen else played.seeds
    runs += [(POLICY, seed, run) for seed, run in seeds.items()]
    bound = None if first_screen else played.bound
    runs += [(BOUND, BOUND, bound)] if bound else []
    data = pl.DataFrame([
        {"contestant": name, "line": line, "w": weight, **run.means(weight)}
        for name, line, run in runs
        for weight in run.weights
    ])  # fmt: skip
    data = data.with_columns(chosen=pl.col("line") == matchup.chosen)
    colour, dash, shape = looks_of(data)
    base = chart_of(data).encode(
        alt.X("T:Q", title=f"mean time until {matchup.until} (s)", scale=alt.Scale(zero=False, nice=True)),
        alt.Y("V:Q", title="mean V_p (m/s)", scale=alt.Scale(zero=True)),
        colour,
    )
    prominent = base.transform_filter("datum.chosen || datum.contestant != 'learned policy'")
    curves = prominent.mark_line().encode(dash, detail="line:N", order="w:Q")
    faint = base.transform_filter("!datum.chosen && datum.contestant == 'learned policy'").mark_line(
        strokeWidth=0.8, opacity=0.45
    ).encode(detail="line:N", order="w:Q")  # fmt: skip
    marks = prominent.mark_point(size=70).encode(shape, tooltip=[
        "contestant:N", alt.Tooltip("line:N", title="seed or line"),
        alt.Tooltip("w:Q", title="time weight (m/s per s)"), alt.Tooltip("T:Q", title="T (s)", format=".4f"),
        alt.Tooltip("V:Q", title="V_p (m/s)", format=".4f"), "missed:Q",
    ])  # fmt: skip
    chart = (faint + curves + marks if len(seeds) > 1 else curves + marks).add_params(ZOOM)
    places = [f"{time:.3f} s and {velocity:.3f} m/s" for time, velocity in (*played.paper.front, *played.policy.front)]
    alternative = f"Paper's rule: {places[0]}. The learned policy: from {places[1]} to {places[-1]}."
    if first_screen:
        speed = min(1.0, matchup.environment.get("velocity_range", VELOCITY_RANGE)[1])
        tuning = "" if matchup.rival.name == PAPER else f", and for which the {matchup.rival.plain} is tuned"
        caption = (
            "Down and left is better: gentler and sooner. Along each line the time weight falls from left to right. "
            f"Each mark is one time weight, which the policy observes{tuning}. The rule of the paper, Tommasino et al. "
            f"2020, moves at {speed:g} m/s and brakes at the alarm."
        )
        title = "Final speed of the object, V_p"
        return Figure(matchup.name, "answer", title, caption, alternative, chart, data, height=270, width=400)
    caption = (
        "Down and left is better. Each line joins the time weights of one contestant; faint lines are the other seeds."
    )
    if bound:
        caption += (
            f" The {BOUND} knows the object: it is the best approach that a search found for each of the first "
            f"{bound['missed'].shape[1]} scenarios."
        )
    title = f"Time until {matchup.until} against V_p, all contestants and seeds"
    return Figure(matchup.name, "trade_off", title, caption, alternative, chart, data, height=380)


def weights_table(played: Played) -> Table:
    """Return V_p + w T of policy, rival and clairvoyant search at each weight, and the tolerance bound of trainings."""
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
        length, more = ("short", "more") if answer.later > 0.0 else ("long", "less")
        text = f"at no time weight is its approach as {length} as the paper's; at the nearest weight it takes "
        text += f"{100 * abs(answer.later):.1f} % {more} time, and the object leaves {change}"
        text += f" (a weight of about {answer.needed:.2g} would make it as {length})" if answer.needed > 0.0 else ""
    if answer.beyond == "faster":
        text += "; at every weight the object leaves faster than with the paper's rule."
    else:
        limit = "at least" if answer.sooner.value >= 0.0 else "at most"  # even at the fastest approach V_p is lower
        bound = f"{limit} " if answer.beyond == "slower" else ""
        text += f"; at the paper's V_p the approach takes {bound}{_compared(answer.sooner, 'less', 'more')} time."
    if answer.rival_reduction:
        change = _compared(answer.rival_reduction, "slower", "faster")
        text += f" With the best tuned baseline, {answer.rival}, it leaves {change}."
    return begin + text + (f" Missed: {answer.missed} of {answer.episodes:,} objects." if answer.missed else "")


def at_rule_time(answer: Answer, played: Played) -> str:
    """Return the policy's gain at the paper's mean approach time, or the weight at which it would take that time."""
    if answer.missed > MISSED_TOO_OFTEN * answer.episodes:
        return (f"The learned policy misses {answer.missed:,} of {answer.episodes:,} objects, so nothing is claimed "
                "for it at the time of the paper's rule.")  # fmt: skip
    slower, rival = _less(answer.reduction.value), ""
    if answer.rival_reduction:
        rival = f", with the {played.matchup.rival.plain} {_less(answer.rival_reduction.value)}"
    if answer.reached:
        text = (
            f"At the mean approach time of the paper's rule the object leaves {slower} with the learned policy{rival}."
        )
    else:
        more, largest = ("more", "largest") if answer.later > 0.0 else ("less", "smallest")
        needed = f"; a weight of about {answer.needed:.2g} would match the rule's time" if answer.needed > 0.0 else ""
        text = (
            f"Even at its {largest} time weight the learned policy takes {100 * abs(answer.later):.0f} % {more} time "
            f"than the paper's rule{needed}. At that {largest} weight the object leaves {slower}{rival}."
        )
    imitates = " The policy's training began by imitating a tuned profile." if IMITATES in played.matchup.note else ""
    return text + imitates


def assisted(played: Played, intervals: bool = False) -> str:
    """Return the slide of the object and the time until all is done, for each assistance of an operator."""
    weight, plain = played.matchup.typical, {each.name: each.plain for each in played.matchup.baselines}
    contestants = {f"the {POLICY}": list(played.seeds.values())}
    contestants |= {plain[name]: [run] for name, run in played.baselines.items()}
    parts = []
    for name, runs in contestants.items():
        slide, done = (np.array([getattr(run.at(weight), what) for run in runs]) for what in ("slide", "done_time"))
        estimates = (estimate(played.resamples.means(values)) for values in (100.0 * slide, done))  # cm, s
        length, time = (f"{each:.2f}" if intervals else f"{each.value:.1f}" for each in estimates)
        parts.append(f"{length} cm and {time} s with {name}")
    return (
        f"Slide of the object and time until all is done, at a time weight of {weight:g} m/s per s: {'; '.join(parts)}."
    )


def _less(share: float) -> str:
    return f"{100 * abs(share):.0f} % {'slower' if share >= 0.0 else 'faster'}"


def _compared(share: Estimate, good: str, bad: str) -> str:
    return f"{percent(share)} {good}" if share.value >= 0.0 else f"{percent(-share)} {bad}"
