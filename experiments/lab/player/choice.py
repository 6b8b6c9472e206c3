"""Which scenarios are worth watching."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from agents.evaluate.scenario_batch import Episodes


def choose(played_baseline: Episodes, played_policy: Episodes) -> dict[str, int]:
    """Return the scenarios to show: numbers, all different, each under a phrase that says why.

    A scenario that stands out in several ways is there once, with all of them in its phrase. Of equals it is the first.

    Raises:
        ValueError: the two did not play the same scenarios.
    """
    ours, theirs = played_policy.scenario, played_baseline.scenario
    if any(not np.array_equal(ours[name], theirs[name]) for name in ours):
        raise ValueError("baseline and policy must have played the same scenarios")
    reasons: dict[int, list[str]] = {}
    for reason, number in _outstanding(played_baseline, played_policy):
        reasons.setdefault(number, []).append(reason)
    phrases = {"; ".join(texts): number for number, texts in reasons.items()}
    return {phrase[0].upper() + phrase[1:]: number for phrase, number in phrases.items()}


def _outstanding(baseline: Episodes, policy: Episodes) -> Iterable[tuple[str, int]]:
    """Yield why a scenario is worth watching, and its number."""
    touched_by_both = ~(baseline.missed | policy.missed)
    touched = np.flatnonzero(touched_by_both) if touched_by_both.any() else np.arange(len(touched_by_both))
    ours, gain = policy.object_velocity, baseline.object_velocity - policy.object_velocity
    scenario = policy.scenario
    contacts = np.maximum(baseline.contact_count, policy.contact_count)

    def largest(values: NDArray[np.float64] | NDArray[np.int64]) -> int:
        return int(touched[np.argmax(values[touched])])

    if touched_by_both.any():
        median = touched[np.argsort(ours[touched], kind="stable")][(len(touched) - 1) // 2]  # the lower one of two
        yield "a typical scenario: the policy's V_p is the median", int(median)
        yield "the policy's largest gain on the baseline", largest(gain)
        worst = largest(-gain)
        yield f"the policy's {'largest loss to' if gain[worst] < 0.0 else 'smallest gain on'} the baseline", worst
        yield "the policy's best: its lowest V_p", largest(-ours)
        yield "the policy's worst: its highest V_p", largest(ours)
        if contacts[touched].max() > 1:
            yield "most contacts: it is hit again and again", largest(contacts)
        yield "the highest contact force", largest(np.maximum(baseline.peak_force, policy.peak_force))
    for field, lowest, highest in (
        ("object_mass", "the lightest object", "the heaviest object"),
        ("contact_stiffness", "the softest contact", "the stiffest contact"),
        ("distance", "the nearest object", "the farthest object"),
    ):
        yield lowest, largest(-scenario[field])
        yield highest, largest(scenario[field])
    if policy.missed.any():
        yield "missed by the policy", int(np.argmax(policy.missed))
    elif baseline.missed.any():
        yield "missed by the baseline", int(np.argmax(baseline.missed))
