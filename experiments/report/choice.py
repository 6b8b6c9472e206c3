"""The recommended controller: the simplest whose mean cost at one time weight is not clearly above the lowest.

'Not clearly above' means that the 95 % interval of the difference includes 0. Controllers from simple to complex:
untuned baselines, tuned baselines by number of parameters, the user's controllers, the policy.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from experiments.lab.parts import Table, percent
from experiments.lab.statistics import Comparison, Estimate, Floats, estimate
from experiments.report.episodes import Played
from experiments.report.matchups import PAPER, POLICY, Contestant


@dataclass(frozen=True)
class Choice:
    """The recommended controller, and its cost."""

    controller: str  # name of the contestant
    time_weight: float  # w, m/s per s
    cost: Estimate  # mean of V_p + w T + cost of a miss, m/s
    below_rule: Estimate  # fraction by which `cost` is below the cost of the paper's rule
    above: Mapping[str, Estimate]  # fraction by which the cost of each other contestant is above `cost`, by name
    missed: int  # number of objects that the recommended controller misses
    sentence: str


def simplicity(contestant: Contestant) -> tuple[int, int]:
    """Return a rank by which contestants are sorted, the simplest first."""
    (kind,), tuned = contestant.controller, contestant.controller.get("tuned", {})
    return ("baseline", "tuned", "object", "policy").index(kind), len(tuned.get("parameters", ()))


def simplest(costs: Mapping[str, Floats]) -> str:
    """Return the first name whose mean cost is not clearly above the lowest; `costs` has arrays (scenarios,)."""
    least = min(costs.values(), key=lambda cost: float(cost.mean()))
    return next(name for name, cost in costs.items() if Comparison.of_means(least, cost).less.low <= 0.0)


def choice(played: Played) -> Choice:
    """Return the recommended controller at the typical weight."""
    matchup, weight = played.matchup, played.matchup.typical
    contestants = sorted((*matchup.baselines, matchup.policy), key=simplicity)
    name = simplest({each.name: played.choosing[each.name].loss(weight) for each in contestants})
    runs = {**played.baselines, matchup.chosen: played.policy}
    losses = {each.name: runs[each.name].loss(weight) for each in contestants}
    ratios = {each: Comparison.of_means(loss, losses[name]).ratio for each, loss in losses.items() if each != name}
    cost = estimate(played.resamples.means(losses[name]))
    below_rule = Comparison.of_means(losses[name], losses[PAPER]).reduction
    above = {each: Estimate(*(ratio - 1.0 for ratio in (e.value, e.low, e.high))) for each, e in ratios.items()}
    missed = int(runs[name].at(weight).missed.sum())
    plain = {each.name: each.plain for each in matchup.baselines} | {matchup.chosen: POLICY}
    called = {each: word if word == each != PAPER else f"the {word.removeprefix('the ')}"
              for each, word in plain.items()}  # fmt: skip
    against = "" if name == PAPER else f", {_against_rule(below_rule)} the paper's rule"
    compared = [f"It costs V_p + {weight:g} T = {cost.value:.3f} m/s{against}"]
    for each in (other for other in dict.fromkeys((matchup.rival.name, matchup.chosen)) if other not in (name, PAPER)):
        if above[each].low > 0.0:
            compared.append(f"{called[each]} {percent(above[each])} more")
        elif above[each].high < 0.0:
            compared.append(f"{called[each]} {percent(-above[each])} less here, but not in the scenarios of the choice")
        else:
            compared.append(f"{called[each]} does not differ clearly (by {percent(above[each])})")
    misses = f" It misses {missed} of {played.count:,} objects." if missed else ""
    sentence = f"Best here: {called[name]}. {'; '.join(compared)}.{misses}"
    return Choice(name, weight, cost, below_rule, above, missed, sentence)


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


def _against_rule(below: Estimate) -> str:
    if below.low > 0.0:
        return f"{percent(below)} less than"
    if below.high < 0.0:
        return f"{percent(-below)} more here than"
    return f"with no clear difference ({percent(-below)}) from"


def table(result: Choice, played: Played) -> Table:
    """Return the table of cost, V_p, T and misses of each contestant at the typical weight, the simplest first."""
    matchup, weight = played.matchup, result.time_weight
    runs, rows = {**played.baselines, matchup.chosen: played.policy}, []
    for each in sorted((*matchup.baselines, matchup.policy), key=simplicity):
        means, above = runs[each.name].means(weight), result.above.get(each.name)
        cost = estimate(played.resamples.means(runs[each.name].loss(weight)))
        compared = "best choice" if above is None else f"{percent(above)} above"
        numbers = f"{cost:.4f}", compared, f"{means['V']:.4f}", f"{means['T']:.4f}", str(means["missed"])
        rows.append((matchup.labels[each.name], *numbers))
    head = ("controller", f"V_p + {weight:g} T (m/s)", "against the best choice", "V_p (m/s)", "T (s)", "missed")
    drawn = played.choosing[result.controller]["missed"].shape[1]
    caption = (
        f"The best choice is the simplest controller whose cost is not clearly above the lowest, on {drawn:,} "
        f"other scenarios (on these, if a CSV file gives them). The numbers are of these {played.count:,} scenarios, "
        "with the median seed's policy (in the ablation: the mean of all seeds) and 95 % intervals over scenarios"
    )
    return Table(caption, head, rows)
