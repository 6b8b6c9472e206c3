"""Ablation: contestants from the paper's rule to the policy, each with more abilities than the contestant before.

The contestants are the paper's rule, the tuned baselines, each with an ability of RULES more, and the policy. A gain
is the difference in V_p or cost from the contestant before; another order could give other gains.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from agents.baselines import PaperTrapezoid
from experiments.lab.parts import Table, percent
from experiments.lab.statistics import Estimate, Floats, Resamples, estimate, velocity_at_time_of
from experiments.report.comparisons import BOUND, PAPER, POLICY, RULES
from experiments.report.episodes import MISSED_TOO_OFTEN, ComparisonResults, Results, front_of
from impact_gym.task import Task


class Link(NamedTuple):
    """A contestant, and the abilities that it adds to those of the contestant before it."""

    added: str
    contestant: str
    runs: Sequence[Results]  # one for each seed


@dataclass(frozen=True)
class Gain:
    """V_p or cost of a contestant, and the gain over the contestant before."""

    value: Estimate  # m/s
    less: Estimate | None = None  # m/s, the gain; None for the first contestant, or if no gain can be claimed
    share: Estimate | None = None  # ratio of the gain to the policy's gain over the rule; None as for `less`

    @property
    def cells(self) -> list[str]:
        """The texts of the table."""
        less = "-" if self.less is None else f"{self.less:.3f}"
        return [f"{self.value.value:.3f}", less, "-" if self.share is None else percent(self.share)]


@dataclass(frozen=True)
class Step:
    """The contestant of a `Link`, its V_p and its cost, and the gains in both."""

    added: str
    contestant: str
    scenarios: int
    later: float  # s, the contestant's mean approach time nearest to the rule's, minus the rule's
    velocity: Gain  # V_p at the mean approach time of the paper's rule, or at the contestant's nearest time
    weight: float  # typical time weight w, m/s per s
    loss: Gain  # m/s, V_p + w T + cost of misses


def links(results: ComparisonResults) -> list[Link]:
    """Return the links: the paper's rule, all tuned baselines in the order of RULES, and the policy.

    An ability without its own baseline is added together with the next ability. The tuned baseline with the lowest cost
    comes last, so that learning is compared with the best controller that is not learned.
    """
    task, weight = Task(**results.comparison.environment), results.comparison.typical
    given = {"ConstantSpeed", "ConstantDeceleration", "BlindProfile"}  # abilities without sensors
    given |= {"Ranged"} if task.range_noise is not None else {"FirstReadingProfile"} if task.range_sensor else set()
    specs = {each.name: each.controller for each in results.comparison.baselines}
    tuned = {name: spec["tuned"]["rule"] for name, spec in specs.items() if "tuned" in spec}
    sequence, added = list[Link](), list[str]()
    stronger = task.acceleration_range[1] > PaperTrapezoid()["deceleration"]
    for rule, (_, words) in RULES.items():
        if rule in given or rule in tuned.values():
            added.append(words if stronger or rule != "ConstantSpeed" else "the choice of speed")
        for name in (name for name, kind in tuned.items() if kind == rule):
            sequence.append(Link(" and ".join(added) or name, name, [results.baselines[name]]))
            added = []
    if sequence and not added:
        best = min(reversed(sequence), key=lambda link: float(link.runs[0][weight].loss(weight).mean()))
        sequence = [link for link in sequence if link is not best] + [best]
    policy = Link(" and ".join([*added, "learning"]), POLICY, list(results.seeds.values()))
    return [Link("", PAPER, [results.paper]), *sequence, policy]


def steps_of(results: ComparisonResults) -> list[Step]:
    """Return the steps. If a clairvoyant search used the typical weight, it is the last step, on its scenarios."""
    sequence, weight, searched = links(results), results.comparison.typical, results.bound.get(BOUND)
    steps = _steps(sequence, results.resamples, weight, policy=len(sequence) - 1)
    if searched is None or weight not in searched:
        return steps
    compared = [sequence[0], sequence[-1], Link("knowing the object", BOUND, [searched])]
    return [*steps, _steps(compared, Resamples(len(searched[weight].missed)), weight, policy=1)[-1]]


def _steps(sequence: Sequence[Link], resamples: Resamples, weight: float, policy: int) -> list[Step]:
    """Return the steps on the first `resamples.scenarios` scenarios; `policy` is the policy's index in `sequence`."""
    fronts = [front_of(link.runs, resamples) for link in sequence]
    time = fronts[0][0][0, 0]  # mean approach time of the paper's rule, s
    later = [float(np.clip(time, times[0].min(), times[0].max()) - time) for times, _ in fronts]
    missed = max(np.mean([run.stacked("missed") for run in link.runs]) for link in sequence)
    claimed = not any(later) and missed <= MISSED_TOO_OFTEN
    velocities = gains([velocity_at_time_of(fronts[0], each) for each in fronts], policy, claimed)
    costs = [np.array([run[weight].loss(weight)[: resamples.scenarios] for run in link.runs]) for link in sequence]
    of_costs = gains([resamples.means(cost) for cost in costs], policy)
    return [
        Step(link.added, link.contestant, resamples.scenarios, delay, velocity, weight, cost)
        for link, delay, velocity, cost in zip(sequence, later, velocities, of_costs, strict=True)
    ]


def gains(values: Sequence[Floats], policy: int, claimed: bool = True) -> list[Gain]:
    """Return a gain for each contestant; `values`: V_p or cost of each (m/s), (1 + n,): sample and n resamples."""
    total = values[0] - values[policy]
    drops = -np.diff([value[0] for value in values[: policy + 1]])
    shared = claimed and estimate(total).low > 0.0 and drops.max() <= drops.sum()
    steps = [Gain(estimate(values[0]))]
    for before, after in pairwise(values):
        less = estimate(before - after) if claimed else None
        steps.append(Gain(estimate(after), less, estimate((before - after) / total) if shared else None))
    return steps


def table(steps: Sequence[Step], labels: Mapping[str, str]) -> Table:
    """Return the table of the steps; `labels` has the contestants' labels, by name."""
    body = []
    for step in steps:
        subset = "" if step.scenarios == steps[0].scenarios else f", the first {step.scenarios} scenarios"
        gap = f" (at the nearest, {1e3 * abs(step.later):.0f} ms {'later' if step.later > 0 else 'sooner'})"
        velocity, *more = *step.velocity.cells, *step.loss.cells
        added = "+ " * bool(step.added) + (step.added or "the paper")
        named = labels.get(step.contestant, step.contestant) + subset
        body.append((added, named, velocity + gap * bool(step.later), *more))
    head = ("what is added", "contestant", "V_p at the paper's approach time (m/s)", "less by (m/s)", "share",
            f"V_p + {steps[0].weight:g} T (m/s)", "less by (m/s)", "share")  # fmt: skip
    caption = ("Each row adds to the row above. Share: part of the difference between the paper's rule and "
               "the policy (mean of all seeds), left out if one step exceeds it; 95 % intervals. The clairvoyant "
               "search is compared with policy and rule on the scenarios that it searched.")  # fmt: skip
    return Table(caption, head, body)


def row(steps: Sequence[Step], results: ComparisonResults) -> dict[str, str]:
    """Return the row of a set-up in the table of shares, texts by heading."""
    shares = {step.added: percent(step.velocity.share) for step in steps
              if step.velocity.share and step.contestant != BOUND}  # fmt: skip
    return {"set-up": results.comparison.name} | shares
