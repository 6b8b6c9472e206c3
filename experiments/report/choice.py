"""The recommended controller: the simplest whose mean cost at one time weight is not clearly above the lowest.

'Not clearly above' means that the 95 % interval of the difference includes 0. Controllers from simple to complex:
untuned baselines, tuned baselines by number of parameters, the user's controllers, the policy.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from experiments.lab.parts import percent
from experiments.lab.statistics import Comparison, Estimate, Floats, estimate
from experiments.report.episodes import Played
from experiments.report.matchups import Contestant, Matchup


@dataclass(frozen=True)
class Choice:
    """The recommended controller, and its cost."""

    controller: str  # name of the contestant
    time_weight: float  # w, m/s per s
    cost: Estimate  # mean of V_p + w T + cost of a miss, m/s
    above: Mapping[str, Estimate]  # fraction by which the cost of each other contestant is above `cost`, by name
    missed: int  # number of objects that the recommended controller misses
    sentence: str


def simplest_first(matchup: Matchup) -> list[Contestant]:
    """Return the baselines and the policy, from simple to complex."""

    def simplicity(contestant: Contestant) -> tuple[int, int]:
        (kind,), tuned = contestant.controller, contestant.controller.get("tuned", {})
        return ("baseline", "tuned", "object", "policy").index(kind), len(tuned.get("parameters", ()))

    return sorted((*matchup.baselines, matchup.policy), key=simplicity)


def simplest(costs: Mapping[str, Floats]) -> str:
    """Return the first name whose mean cost is not clearly above the lowest; `costs` has arrays (scenarios,)."""
    least = min(costs.values(), key=lambda cost: float(cost.mean()))
    return next(name for name, cost in costs.items() if Comparison.of_means(least, cost).less.low <= 0.0)


def choice(played: Played) -> Choice:
    """Return the recommended controller at the typical weight."""
    matchup, weight = played.matchup, played.matchup.typical
    names, labels = [each.name for each in simplest_first(matchup)], matchup.labels
    name = simplest({each: played.choosing[each].loss(weight) for each in names})
    losses = {each: played.runs[each].loss(weight) for each in names}
    cost, missed = estimate(played.resamples.means(losses[name])), int(played.runs[name].at(weight).missed.sum())
    above = {each: -Comparison.of_means(losses[each], losses[name]).reduction for each in names if each != name}
    rivals = (each.name for each in matchup.rivals if each.name != name)
    compared = "".join(f"; {labels[each]} {_difference(above[each])}" for each in rivals)
    misses = f" It misses {missed} of {played.count:,} objects." if missed else ""
    sentence = f"Best here: {labels[name]}. It costs V_p + {weight:g} T = {cost.value:.3f} m/s{compared}.{misses}"
    return Choice(name, weight, cost, above, missed, sentence)


def _difference(above: Estimate) -> str:
    if above.low > 0.0:
        return f"{percent(above)} more"
    if above.high < 0.0:
        return f"{percent(-above)} less here, but not in the scenarios of the choice"
    return f"does not differ clearly (by {percent(above)})"


def row(result: Choice, played: Played) -> dict[str, str]:
    """Return the row of a set-up in the table of choices, texts by heading."""
    rule, policy = (run.loss(result.time_weight).mean() for run in (played.paper, played.policy))
    return {
        "set-up": played.matchup.name,
        "best choice": played.matchup.labels[result.controller],
        "its cost (m/s)": f"{result.cost:.3f}",
        "the rule's cost (m/s)": f"{rule:.3f}",
        "the policy's cost (m/s)": f"{policy:.3f}",
        "objects missed": f"{result.missed} of {played.count}",
    }
