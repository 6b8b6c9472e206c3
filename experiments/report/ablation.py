"""Ablation: contestants from the paper's rule to the policy, each with more abilities than the contestant before.

The contestants are the paper's rule, the tuned baselines, each with an ability of ABILITIES more, and the policy. A
gain is the difference in V_p or cost from the contestant before; another order could give other gains.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from agents.baselines import PaperTrapezoid
from experiments.lab.parts import Table, percent
from experiments.lab.statistics import Comparison, Estimate, Floats, Front, Resamples, estimate
from experiments.report.answer import front_of
from experiments.report.episodes import MISSED_TOO_OFTEN, Played, Results
from experiments.report.matchups import BOUND, PAPER, POLICY
from impact_gym.task import Task

ABILITIES = {  # what the rule of a tuned baseline adds to the rules above it
    "ConstantSpeed": "the arm's limits",
    "ConstantDeceleration": "knowing where objects can stand",
    "BlindProfile": "the profile's shape",
    "DetectorProfile": "a contact detector",
    "Ranged": "the estimate",
    "RangedProfile": "a profile over the estimate",
    "DetectorRanged": "a contact detector and a profile over the estimate",
    "FirstReadingProfile": "the first reading of the range sensor",
    "FilteredProfile": "a filter over all readings",
    "SelfCalibratingProfile": "a filter that also estimates the sensor's bias and scale",
}


class Link(NamedTuple):
    """A contestant, and the abilities that it adds to those of the contestant before it."""

    added: str
    contestant: str
    runs: Sequence[Results]  # one for each seed


@dataclass(frozen=True)
class Gain:
    """V_p or cost of a contestant, and the gain over the contestant before."""

    value: Estimate  # m/s
    less: Estimate | None  # m/s, the gain; None for the first contestant, or if no gain can be claimed
    share: Estimate | None  # ratio of the gain to the policy's gain over the rule; None: first contestant, or no claim


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


def links(played: Played) -> list[Link]:
    """Return the links: the paper's rule, all tuned baselines in the order of ABILITIES, and the policy.

    An ability without its own baseline is added together with the next ability. The tuned baseline with the lowest cost
    comes last, so that learning is compared with the best controller that is not learned.
    """
    task, weight = Task(**played.matchup.environment), played.matchup.typical
    given = {"ConstantSpeed", "ConstantDeceleration", "BlindProfile"}  # abilities without sensors
    given |= {"Ranged"} if task.range_noise is not None else {"FirstReadingProfile"} if task.range_sensor else set()
    tuned = {each.name: each.controller["tuned"]["rule"] for each in played.matchup.baselines
             if "tuned" in each.controller}  # fmt: skip
    sequence, added = list[Link](), list[str]()
    stronger = task.acceleration_range[1] > PaperTrapezoid()["deceleration"]
    abilities = ABILITIES | ({} if stronger else {"ConstantSpeed": "the choice of speed"})
    for rule, words in abilities.items():
        added += [words] * (rule in given or rule in tuned.values())
        for name in (name for name, kind in tuned.items() if kind == rule):
            sequence.append(Link(" and ".join(added) or name, name, [played.baselines[name]]))
            added = []
    if sequence and not added:
        best = min(reversed(sequence), key=lambda link: float(link.runs[0].loss(weight).mean()))
        sequence = [link for link in sequence if link is not best] + [best]
    policy = Link(" and ".join([*added, "learning"]), POLICY, list(played.seeds.values()))
    return [Link("", PAPER, [played.paper]), *sequence, policy]


def steps_of(played: Played) -> list[Step]:
    """Return the steps. If a clairvoyant search used the typical weight, it is the last step, on its scenarios."""
    sequence, weight = links(played), played.matchup.typical
    steps = _steps(sequence, played.resamples, weight, policy=len(sequence) - 1)
    if played.searched is None or weight not in played.searched.weights:
        return steps
    clairvoyant = Link("knowing the object", BOUND, [played.searched])
    searched = Resamples(played.searched["missed"].shape[1])
    return [*steps, _steps([sequence[0], sequence[-1], clairvoyant], searched, weight, policy=1)[-1]]


def _steps(sequence: Sequence[Link], resamples: Resamples, weight: float, policy: int) -> list[Step]:
    """Return the steps on the first `resamples.scenarios` scenarios; `policy` is the policy's index in `sequence`."""
    fronts: list[Front] = [front_of(link.runs, resamples) for link in sequence]
    time = fronts[0][0][0, 0]  # mean approach time of the paper's rule, s
    later = [float(np.clip(time, times[0].min(), times[0].max()) - time) for times, _ in fronts]
    missed = max(np.mean([run["missed"] for run in link.runs]) for link in sequence)
    claimed = not any(later) and missed <= MISSED_TOO_OFTEN
    velocities = gains([Comparison.of_fronts(each, fronts[0]).ours for each in fronts], policy, claimed)
    losses = [np.array([run.loss(weight)[: resamples.scenarios] for run in link.runs]) for link in sequence]
    of_losses = gains([resamples.means(loss) for loss in losses], policy)
    return [
        Step(link.added, link.contestant, resamples.scenarios, delay, velocity, weight, loss)
        for link, delay, velocity, loss in zip(sequence, later, velocities, of_losses, strict=True)
    ]


def gains(values: Sequence[Floats], policy: int, claimed: bool = True) -> list[Gain]:
    """Return a gain for each contestant; `values`: V_p or cost of each (m/s), (1 + n,): sample and n resamples."""
    total = Comparison(values[policy], values[0])
    drops = -np.diff([value[0] for value in values[: policy + 1]])
    shared = claimed and total.less.low > 0.0 and drops.max() <= drops.sum()
    steps = [Gain(estimate(values[0]), None, None)]
    for before, after in pairwise(values):
        share = estimate((before - after) / (total.theirs - total.ours)) if shared else None
        steps.append(Gain(estimate(after), Comparison(after, before).less if claimed else None, share))
    return steps


def table(steps: Sequence[Step], labels: Mapping[str, str]) -> Table:
    """Return the table of the steps; `labels` has the contestants' labels, by name."""
    body = []
    for step in steps:
        subset = "" if step.scenarios == steps[0].scenarios else f", the first {step.scenarios} scenarios"
        gap = f" (at the nearest, {1e3 * abs(step.later):.0f} ms {'later' if step.later > 0 else 'sooner'})"
        cells = [*_cells(step.velocity), *_cells(step.loss)]
        cells[0] += gap if step.later else ""
        added = "+ " * bool(step.added) + (step.added or "the paper")
        body.append((added, labels.get(step.contestant, step.contestant) + subset, *cells))
    head = ("what is added", "contestant", "V_p at the paper's approach time (m/s)", "less by (m/s)", "share",
            f"V_p + {steps[0].weight:g} T (m/s)", "less by (m/s)", "share")  # fmt: skip
    caption = ("Each row adds to the row above. Share: part of the difference between the paper's rule and "
               "the policy (mean of all seeds), left out if one step exceeds it; 95 % intervals. The clairvoyant "
               "search is compared with policy and rule on the scenarios that it searched.")  # fmt: skip
    return Table(caption, head, body)


def _cells(gain: Gain) -> list[str]:
    less = "-" if gain.less is None else f"{gain.less:.3f}"
    return [f"{gain.value.value:.3f}", less, "-" if gain.share is None else percent(gain.share)]


def row(steps: Sequence[Step], played: Played) -> dict[str, str]:
    """Return the row of a set-up in the table of shares, texts by heading."""
    shares = {step.added: percent(step.velocity.share) for step in steps
              if step.velocity.share and step.contestant != BOUND}  # fmt: skip
    return {"set-up": played.matchup.name} | shares
