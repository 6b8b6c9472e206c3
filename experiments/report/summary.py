"""The summary of a set-up, in numbers, sentences and a chart: by how much the policies lower V_p.

The main measure is V_p at the paper's time, which is the mean approach time of the paper's rule. This measure was fixed
before the test set was played. A front is the mean approach time and the mean V_p at each time weight of a controller.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.lab.charts import SERIES
from experiments.lab.parts import Picture, percent
from experiments.lab.statistics import Estimate, along, estimate, reduction, tolerated, velocity_at_time_of
from experiments.report.comparisons import BOUND, PAPER, POLICY, Comparison
from experiments.report.episodes import MISSED_TOO_OFTEN, ComparisonResults, front_of
from impact_gym.task.task import VELOCITY_RANGE

LOOKS = (("-", "X"), ("-", "o"), ("--", "s"), (":", "D"))  # line and marker of rule, policy, main baseline and search


@dataclass(frozen=True)
class Summary:
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


def summary(results: ComparisonResults) -> Summary:
    """Return the summary, with intervals from resampled seeds and scenarios."""
    main = results.baselines[results.comparison.rival.name]
    contestants = [results.paper], [*results.seeds.values()], [main]
    paper, policy, rival = (front_of(runs, results.resamples) for runs in contestants)
    times, time = policy[0][0], paper[0][0, 0]
    apart = "later" if rival[0][0].min() > time else "sooner" if rival[0][0].max() < time else ""
    tuned = len(main) > 1
    nearest = np.clip(time, times.min(), times.max())
    velocity, of_rule = velocity_at_time_of(paper, policy), paper[1][:, 0]
    ((at, of_paper),) = results.paper.front
    curve_times, curves = np.moveaxis(np.array([run.front for run in results.seeds.values()]), 2, 0)  # (seeds, weights)
    all_reach = curve_times.min(axis=1).max() <= at <= curve_times.max(axis=1).min()
    each = 1.0 - along(curve_times, curves, np.full(len(curves), at)) / of_paper if all_reach else np.empty(0)
    missed = np.array([run.stacked("missed") for run in results.seeds.values()])
    return Summary(
        reduction=reduction(velocity, of_rule),
        each=tuple(each.tolist()),
        reached=bool(nearest == time),
        later=float(nearest / time - 1.0),
        velocity=estimate(velocity),
        rival_reduction=reduction(velocity_at_time_of(paper, rival), of_rule) if tuned and not apart else None,
        rival_apart=apart if tuned else "",
        missed=int(missed.sum()),
        episodes=missed.size,
    )


def row(found: Summary, results: ComparisonResults) -> dict[str, str]:
    """Return the row of a set-up in the table of summaries, texts by heading."""
    (weight,), comparison = results.paper, results.comparison
    rival, apart, count = found.rival_reduction, found.rival_apart, results.resamples.scenarios
    rule, policy = results.paper.means(weight), results.policy.means(comparison.typical)
    return {
        "set-up": comparison.name,
        "mean time of the rule (s)": f"{rule['T']:.3f}",
        "V_p of the rule (m/s)": f"{rule['V']:.3f}",
        "V_p of the policy (m/s)": f"{found.velocity.value:.3f}",
        "V_p lower with the main baseline by": percent(rival) if rival else f"- (always {apart})" if apart else "-",
        "V_p lower with the policy by": percent(found.reduction) + " (at the nearest time)" * (not found.reached),
        "missed by the rule": f"{100 * rule['missed'] / count:.1f} %",
        "missed by the policy": f"{100 * policy['missed'] / count:.1f} %",
    }


def sentence(found: Summary, comparison: Comparison) -> str:
    """Return the summary of a set-up in words, with intervals."""
    rival = comparison.rival.label
    if found.missed > MISSED_TOO_OFTEN * found.episodes:
        return (f"The {POLICY} misses {found.missed:,} of {found.episodes:,} objects, so nothing is claimed for it "
                "at the time of the paper's rule.")  # fmt: skip
    text = "At the mean approach time of the paper's rule the object leaves"
    if not found.reached:
        more, largest = ("more", "largest") if found.later > 0.0 else ("less", "smallest")
        text = (f"Even at its {largest} time weight the {POLICY} takes {100 * abs(found.later):.1f} % {more} time "
                "than the paper's rule. The object then leaves")  # fmt: skip
    text += f" {_change(found.reduction)} with the {POLICY}"
    if len(found.each) > 1 and found.reduction.value >= 0.0:
        text += f" (95 % of trainings: at least {100 * tolerated(np.array(found.each)):.1f} %)"
    if found.rival_reduction:
        text += f"; with the main baseline, {rival}, it leaves {_change(found.rival_reduction)}"
    elif found.rival_apart:
        text += f"; the main baseline, {rival}, is {found.rival_apart} than the rule at every time weight"
    return f"{text}."


def _change(change: Estimate) -> str:
    return f"{percent(change)} slower" if change.value >= 0.0 else f"{percent(-change)} faster"


def assisted(results: ComparisonResults) -> str:
    """Return in words the mean slide of the object and the mean duration of an episode, with each controller."""
    weight, labels, parts = results.comparison.typical, results.comparison.labels, []
    contestants = {labels[name]: [run] for name, run in results.baselines.items()}
    for label, runs in ({POLICY: [*results.seeds.values()]} | contestants).items():
        slide, done = (np.array([getattr(run[weight], what) for run in runs]) for what in ("slide", "done_time"))
        length, time = (estimate(results.resamples.means(values)) for values in (100.0 * slide, done))  # cm, s
        parts.append(f"{label} {length:.2f} cm and {time:.2f} s")
    about = f"Slide of the object and time until all is done, at a time weight of {weight:g} m/s per s"
    return f"{about}: {'; '.join(parts)}."


def trade_off(results: ComparisonResults, recommended: str = POLICY) -> Picture:
    """Return the chart of V_p against time: rule, policy, search, `recommended` (no baseline: the main baseline)."""
    comparison, searched = results.comparison, results.bound.get(BOUND)
    rival = next((each for each in comparison.baselines[1:] if each.name == recommended), comparison.rival)
    others = [run for run in results.seeds.values() if run is not results.policy]
    runs = {PAPER: [results.paper], POLICY: [results.policy, *others]}
    runs |= {rival.label: [results.baselines[rival.name]]} if rival.name != PAPER else {}
    runs |= {BOUND: [searched]} if searched else {}
    figure = Figure(figsize=(4.4, 3.4))
    axes = figure.subplots()
    for (name, each), (line, marker), colour in zip(runs.items(), LOOKS, SERIES, strict=False):
        for run in each:
            points = np.array([[mean["T"], mean["V"]] for mean in map(run.means, sorted(run))])
            faint: dict[str, Any] = {"linewidth": 0.8, "alpha": 0.45}
            look = {"linestyle": line, "marker": marker, "label": name} if run is each[0] else faint
            axes.plot(*points.T, color=colour, **look)
    until = "all is done" if comparison.operated else "the touch"
    axes.set(xlabel=f"mean time until {until} (s)", ylabel="mean V_p (m/s)", ylim=(0.0, None))
    axes.legend(fontsize=9)
    places = [f"{time:.3f} s and {speed:.3f} m/s" for time, speed in (*results.paper.front, *results.policy.front)]
    alternative = f"Paper's rule: {places[0]}. The learned policy: from {places[1]} to {places[-1]}."
    speed = min(1.0, comparison.environment.get("velocity_range", VELOCITY_RANGE)[1])
    tuning = f", and for which {rival.label} is tuned" if "tuned" in rival.controller else ""
    caption = (
        "Down and left is better: gentler and sooner. Along each line the time weight falls from left to right. "
        f"Each mark is one time weight, which the policy observes{tuning}. Faint lines are other seeds. The rule of "
        f"the paper, Tommasino et al. 2020, moves at {speed:g} m/s and brakes at the alarm."
    )
    if searched:
        caption += f" The {BOUND} knows the object; it has the first {searched.stacked('missed').shape[1]} scenarios."
    name = f"figures/{comparison.name}_answer"
    return Picture(name, figure, alternative, caption, "Final speed of the object, V_p")
