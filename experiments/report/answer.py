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
from experiments.report.matchups import POLICY, Matchup


@dataclass(frozen=True)
class Answer:
    """Gain of the policies of one set-up over the paper's rule."""

    reduction: Estimate  # fraction by which mean V_p of all seeds is below mean V_p of the rule, at the paper's time
    each: tuple[float, ...]  # `reduction` for each seed; empty if the front of a seed does not reach the paper's time
    reached: bool  # whether the policy's front reaches the paper's time; if not, `reduction` is at the nearest end
    later: float  # (t - paper's time) / paper's time, with t the nearest time on the front; 0 if `reached`
    velocity: Estimate  # m/s, V_p of the policy at the paper's time, or at the nearest end of the front, see `reached`
    rival_reduction: Estimate | None  # `reduction` of the main baseline; None: untuned, or never as late as the rule
    rival_apart: str  # "later" or "sooner" than the rule: the main baseline, at every weight; "": neither
    missed: int  # missed objects in all episodes (all seeds, all weights)
    episodes: int  # number of these episodes


def answer(played: Played) -> Answer:
    """Return the answer, with intervals from resampled seeds and scenarios."""
    contestants = [played.paper], [*played.seeds.values()], [played.rival]
    paper, policy, rival = (front_of(runs, played.resamples) for runs in contestants)
    times, time = policy[0][0], paper[0][0, 0]
    tuned = len(played.rival.weights) > 1
    apart = "later" if rival[0][0].min() > time else "sooner" if rival[0][0].max() < time else ""
    nearest = np.clip(time, times.min(), times.max())
    compared = Comparison.of_fronts(policy, paper)
    missed = np.array([run["missed"] for run in played.seeds.values()])
    return Answer(
        reduction=compared.reduction,
        each=tuple(reductions(played).tolist()),
        reached=bool(nearest == time),
        later=float(nearest / time - 1.0),
        velocity=estimate(compared.ours),
        rival_reduction=Comparison.of_fronts(rival, paper).reduction if tuned and not apart else None,
        rival_apart=apart if tuned else "",
        missed=int(missed.sum()),
        episodes=missed.size,
    )


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
    rival, apart = answer.rival_reduction, answer.rival_apart
    rule, policy = played.paper.means(weight), played.policy.means(matchup.typical)
    return {
        "set-up": matchup.name,
        "mean time of the rule (s)": f"{rule['T']:.3f}",
        "V_p of the rule (m/s)": f"{rule['V']:.3f}",
        "V_p of the policy (m/s)": f"{answer.velocity.value:.3f}",
        "V_p lower with the main baseline by": percent(rival) if rival else f"- (always {apart})" if apart else "-",
        "V_p lower with the policy by": percent(answer.reduction) + " (at the nearest time)" * (not answer.reached),
        "missed by the rule": f"{100 * rule['missed'] / played.count:.1f} %",
        "missed by the policy": f"{100 * policy['missed'] / played.count:.1f} %",
    }


def sentence(answer: Answer, matchup: Matchup) -> str:
    """Return the answer of a set-up in words, with intervals."""
    rival = matchup.rival.label
    if answer.missed > MISSED_TOO_OFTEN * answer.episodes:
        return (f"The {POLICY} misses {answer.missed:,} of {answer.episodes:,} objects, so nothing is claimed for it "
                "at the time of the paper's rule.")  # fmt: skip
    text = "At the mean approach time of the paper's rule the object leaves"
    if not answer.reached:
        more, largest = ("more", "largest") if answer.later > 0.0 else ("less", "smallest")
        text = (f"Even at its {largest} time weight the {POLICY} takes {100 * abs(answer.later):.1f} % {more} time "
                "than the paper's rule. The object then leaves")  # fmt: skip
    text += f" {_change(answer.reduction)} with the {POLICY}"
    if len(answer.each) > 1 and answer.reduction.value >= 0.0:
        text += f" (95 % of trainings: at least {100 * tolerated(np.array(answer.each)):.1f} %)"
    if answer.rival_reduction:
        text += f"; with the main baseline, {rival}, it leaves {_change(answer.rival_reduction)}"
    elif answer.rival_apart:
        text += f"; the main baseline, {rival}, is {answer.rival_apart} than the rule at every time weight"
    return f"{text}."


def assisted(played: Played) -> str:
    """Return in words the mean slide of the object and the mean duration of an episode, with each controller."""
    weight, labels, parts = played.matchup.typical, played.matchup.labels, []
    contestants = {POLICY: list(played.seeds.values())}
    contestants |= {labels[name]: [run] for name, run in played.baselines.items()}
    for label, runs in contestants.items():
        slide, done = (np.array([getattr(run.at(weight), what) for run in runs]) for what in ("slide", "done_time"))
        length, time = (estimate(played.resamples.means(values)) for values in (100.0 * slide, done))  # cm, s
        parts.append(f"{label} {length:.2f} cm and {time:.2f} s")
    return (
        f"Slide of the object and time until all is done, at a time weight of {weight:g} m/s per s: {'; '.join(parts)}."
    )


def _change(reduction: Estimate) -> str:
    return f"{percent(reduction)} slower" if reduction.value >= 0.0 else f"{percent(-reduction)} faster"
