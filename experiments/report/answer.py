"""The report's answer for a set-up, in numbers and sentences: by how much the policies lower V_p.

The main measure is V_p at the paper's time, which is the mean approach time of the paper's rule. This measure was fixed
before the test set was played. A front is the mean approach time and the mean V_p at each time weight of a controller.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from experiments.lab.parts import percent
from experiments.lab.statistics import Comparison, Estimate, Floats, Front, Resamples, along, estimate, front, tolerated
from experiments.report.episodes import MISSED_TOO_OFTEN, Played, Results
from experiments.report.matchups import IMITATES, POLICY, Matchup


@dataclass(frozen=True)
class Answer:
    """Gain of the policies of one set-up over the paper's rule."""

    reduction: Estimate  # fraction by which mean V_p of all seeds is below mean V_p of the rule, at the paper's time
    each: tuple[float, ...]  # `reduction` for each seed; empty if the front of a seed does not reach the paper's time
    reached: bool  # whether the policy's front reaches the paper's time; if not, `reduction` is at the nearest end
    later: float  # (t - paper's time) / paper's time, with t the nearest time on the front; 0 if `reached`
    needed: float  # m/s per s, weight at which the front, or its extrapolation, has the paper's time, see `_needed`
    sooner: Estimate  # fraction by which the policy's mean time is below the paper's time, at the rule's mean V_p
    beyond: str  # "slower": all V_p of the front are below V_p of the rule; "faster": all are above; "": neither
    velocity: Estimate  # m/s, V_p of the policy at the paper's time, or at the nearest end of the front, see `reached`
    rival: str  # name of the main baseline if it is tuned, else ""
    rival_reduction: Estimate | None  # `reduction` of the rival; None: it is untuned, or never as late as the rule
    rival_apart: (
        str  # "later" or "sooner": the rival takes more or less time than the rule at every weight; "": neither
    )
    improvement: Estimate  # share of scenarios touched with a lower V_p than by the rule, at about its time; ties: half
    missed: int  # missed objects in all episodes (all seeds, all weights)
    episodes: int  # number of these episodes


def answer(played: Played) -> Answer:
    """Return the answer, with intervals from resampled seeds and scenarios."""
    resamples = played.resamples
    contestants = [played.paper], [*played.seeds.values()], [played.rival]
    paper, policy, rival = (front_of(runs, resamples) for runs in contestants)
    (times, velocities), time, velocity = policy, paper[0][0, 0], paper[1][0, 0]
    at_time, at_speed = Comparison.of_fronts(policy, paper), Comparison.of_fronts(policy[::-1], paper[::-1])
    tuned = len(played.rival.weights) > 1
    apart = "later" if rival[0][0].min() > time else "sooner" if rival[0][0].max() < time else ""
    nearest = np.clip(time, times[0].min(), times[0].max())
    as_late, missed_then = (
        np.array([run[name][0] for run in played.as_late.values()]) for name in ("object_velocity", "missed")
    )
    rule = played.paper["object_velocity"][0]
    missed = np.array([run["missed"] for run in played.seeds.values()])
    fastest, slowest = velocities[0].max(), velocities[0].min()
    return Answer(
        reduction=at_time.reduction,
        each=tuple(reductions(played).tolist()),
        reached=bool(nearest == time),
        later=float(nearest / time - 1.0),
        needed=_needed(played.policy.weights, times[0], time) if len(times[0]) > 1 else np.nan,
        sooner=at_speed.reduction,
        beyond="slower" if fastest < velocity else "faster" if slowest > velocity else "",
        velocity=estimate(at_time.ours),
        rival=played.matchup.rival.name if tuned else "",
        rival_reduction=Comparison.of_fronts(rival, paper).reduction if tuned and not apart else None,
        rival_apart=apart if tuned else "",
        improvement=estimate(resamples.means(((as_late < rule) + 0.5 * (as_late == rule)) * ~missed_then)),
        missed=int(missed.sum()),
        episodes=missed.size,
    )


def _needed(weights: Sequence[float], times: Floats, time: float) -> float:
    """Return the weight at `time`, with times (k,) linear in ln(weight) at the nearest two; nan: not in 0.01 to 100."""
    order = np.argsort(weights)  # times fall as weights rise
    pair = order[np.clip(np.searchsorted(-times[order], -time) - 1, 0, len(order) - 2) :][:2]
    (first, last), ends = np.log(np.asarray(weights)[pair]), times[pair]
    slope = (ends[1] - ends[0]) / (last - first)
    log = first + (time - ends[0]) / slope if slope < 0.0 else np.inf
    return float(np.exp(log)) if abs(log) < np.log(100.0) else np.nan


def front_of(runs: Sequence[Results], resamples: Resamples) -> Front:
    """Return the front of the results of each seed, in the first `resamples.scenarios` scenarios."""
    names = ("approach_time", "object_velocity", "missed")
    return front(resamples, *(np.array([run[name][:, : resamples.scenarios] for run in runs]) for name in names))


def reductions(played: Played) -> Floats:
    """Return `Answer.each` as an array (seeds,), empty if the front of a seed does not reach the paper's time."""
    ((time, velocity),) = played.paper.front
    times, velocities = np.moveaxis(np.array([run.front for run in played.seeds.values()]), 2, 0)
    if times.min(axis=1).max() > time or times.max(axis=1).min() < time:
        return np.empty(0)
    return 1.0 - along(times, velocities, np.full(len(times), time)) / velocity


def row(answer: Answer, played: Played) -> dict[str, str]:
    """Return the row of a set-up in the table of answers, texts by heading."""
    (weight,), matchup = played.paper.weights, played.matchup
    rule, policy = played.paper.means(weight), played.policy.means(matchup.typical)
    return {
        "set-up": matchup.name,
        "mean time of the rule (s)": f"{rule['T']:.3f}",
        "V_p of the rule (m/s)": f"{rule['V']:.3f}",
        "V_p of the policy (m/s)": f"{answer.velocity.value:.3f}",
        "V_p lower with the main baseline by": rival_words(answer),
        "V_p lower with the policy by": percent(answer.reduction) + " (at the nearest time)" * (not answer.reached),
        "missed by the rule": f"{rule['missed'] / played.count:.1%}",
        "missed by the policy": f"{policy['missed'] / played.count:.1%}",
    }


def rival_words(answer: Answer) -> str:
    """Return `Answer.rival_reduction` in words."""
    return percent(answer.rival_reduction) if answer.rival_reduction else f"- (always {answer.rival_apart})"


def at_least(answer: Answer) -> str:
    """Return the tolerance bound of `Answer.each` in words; "-": there are fewer than two values."""
    return f"{100 * tolerated(np.array(answer.each)):.1f} %" if len(answer.each) > 1 else "-"


def sentence(answer: Answer, matchup: Matchup) -> str:
    """Return the answer of a set-up in words, with intervals."""
    begin = f"{matchup.name} ({matchup.note}): "
    if answer.missed > MISSED_TOO_OFTEN * answer.episodes:
        return begin + f"the policies miss {answer.missed:,} of {answer.episodes:,} objects, so nothing is claimed."
    change = _compared(answer.reduction, "slower", "faster")
    if answer.reached:
        text = f"the object leaves {change} at the paper's mean approach time"
        if len(answer.each) > 1 and answer.reduction.value >= 0.0:
            text += f" (95 % of trainings: at least {at_least(answer)})"
    else:
        length, more = ("short", "more") if answer.later > 0.0 else ("long", "less")
        text = f"at no time weight is the approach as {length} as the paper's; at the nearest weight it takes "
        text += f"{100 * abs(answer.later):.1f} % {more} time, and the object leaves {change}"
        text += f" (a weight of about {answer.needed:.2g} would make it as {length})" if answer.needed > 0.0 else ""
    if answer.beyond == "faster":
        text += "; at every weight the object leaves faster than with the paper's rule."
    else:
        text += f"; at the paper's V_p the approach takes {sooner(answer)} time."
    if answer.rival_reduction:
        change = _compared(answer.rival_reduction, "slower", "faster")
        text += f" With the main baseline, {answer.rival}, the object leaves {change}."
    elif answer.rival_apart:
        text += f" The main baseline, {answer.rival}, {_never(answer)}."
    return begin + text + (f" Missed: {answer.missed} of {answer.episodes:,} objects." if answer.missed else "")


def sooner(answer: Answer) -> str:
    """Return `Answer.sooner` in words; if the front is slower than the rule at every weight, it is only a bound."""
    bound = "at least " if answer.sooner.value >= 0.0 else "at most "
    return bound * (answer.beyond == "slower") + _compared(answer.sooner, "less", "more")


def at_rule_time(answer: Answer, played: Played) -> str:
    """Return in words, without intervals, by how much the policy lowers V_p at the paper's time."""
    if answer.missed > MISSED_TOO_OFTEN * answer.episodes:
        return (f"The learned policy misses {answer.missed:,} of {answer.episodes:,} objects, so nothing is claimed "
                "for it at the time of the paper's rule.")  # fmt: skip
    slower, rival = _less(answer.reduction.value), ""
    if answer.rival_reduction:
        rival = f", with the {played.matchup.rival.plain} {_less(answer.rival_reduction.value)}"
    elif answer.rival_apart:
        rival = f"; the {played.matchup.rival.plain} {_never(answer)}"
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
    """Return in words the mean slide of the object and the mean duration of an episode, with each controller."""
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


def _never(answer: Answer) -> str:
    return f"is {answer.rival_apart} than the rule at every time weight, so it is not compared at the rule's time"


def _less(share: float) -> str:
    return f"{100 * abs(share):.0f} % {'slower' if share >= 0.0 else 'faster'}"


def _compared(share: Estimate, good: str, bad: str) -> str:
    return f"{percent(share)} {good}" if share.value >= 0.0 else f"{percent(-share)} {bad}"
