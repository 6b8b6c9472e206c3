"""The recommended controller: the simplest whose mean cost at one time weight is not clearly above the lowest.

'Not clearly' means that the 95 % interval of the difference includes 0. Controllers from simple to complex:
untuned baselines, tuned baselines by number of parameters, the user's controllers, the policy.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from experiments.lab.parts import Table, percent
from experiments.lab.statistics import Estimate, Floats, Resamples, estimate, reduction
from experiments.report.comparisons import POLICY, Comparison, Contestant
from experiments.report.episodes import ComparisonResults


@dataclass(frozen=True)
class Choice:
    """The recommended controller, and its cost."""

    controller: str  # name of the contestant
    time_weight: float  # w, m/s per s
    cost: Estimate  # mean of V_p + w T + cost of a miss, m/s
    above: Mapping[str, Estimate]  # fraction by which the cost of each other contestant is above `cost`, by name
    missed: int  # number of objects that the recommended controller misses
    sentence: str


def simplest_first(comparison: Comparison) -> list[Contestant]:
    """Return the baselines and the policy, from simple to complex."""

    def simplicity(contestant: Contestant) -> tuple[int, int]:
        (kind,), tuned = contestant.controller, contestant.controller.get("tuned", {})
        return ("baseline", "tuned", "object", "policy").index(kind), len(tuned.get("parameters", ()))

    return sorted((*comparison.baselines, comparison.policy), key=simplicity)


def simplest(costs: Mapping[str, Floats]) -> str:
    """Return the first name whose mean cost is not clearly above the lowest; `costs` has arrays (scenarios,)."""
    least = min(costs.values(), key=lambda cost: float(cost.mean()))
    means = Resamples(len(least)).means
    return next(name for name, cost in costs.items() if estimate(means(cost) - means(least)).low <= 0.0)


def choice(results: ComparisonResults) -> Choice:
    """Return the recommended controller at the typical weight."""
    comparison, weight, resamples = results.comparison, results.comparison.typical, results.resamples
    names, labels = [each.name for each in simplest_first(comparison)], comparison.labels
    name = simplest({each: results.selection[each][weight].loss(weight) for each in names})
    costs = {each: resamples.means(results.runs[each][weight].loss(weight)) for each in names}
    cost, missed = estimate(costs[name]), int(results.runs[name][weight].missed.sum())
    above = {each: -reduction(costs[each], costs[name]) for each in names if each != name}
    rivals = (each.name for each in comparison.rivals if each.name != name)
    compared = "".join(f"; {labels[each]} {_difference(above[each])}" for each in rivals)
    misses = f" It misses {missed} of {resamples.scenarios:,} objects." if missed else ""
    sentence = f"Take the {labels[name]}. It costs V_p + {weight:g} T = {cost.value:.3f} m/s{compared}.{misses}"
    return Choice(name, weight, cost, above, missed, sentence)


def _difference(above: Estimate) -> str:
    if above.low > 0.0:
        return f"{percent(above)} more"
    if above.high < 0.0:
        return f"{percent(-above)} less here, but not in the scenarios of the choice"
    return f"no significant difference ({percent(above)})"


def row(found: Choice, results: ComparisonResults) -> dict[str, str]:
    """Return the row of a set-up in the table of choices, texts by heading."""
    weight = found.time_weight
    rule, policy = (run[weight].loss(weight).mean() for run in (results.paper, results.policy))
    return {
        "set-up": results.comparison.name,
        "best choice": results.comparison.labels[found.controller],
        "its cost (m/s)": f"{found.cost:.3f}",
        "the rule's cost (m/s)": f"{rule:.3f}",
        "the policy's cost (m/s)": f"{policy:.3f}",
        "objects missed": f"{found.missed} of {results.resamples.scenarios}",
    }


def contestants(found: Choice, results: ComparisonResults) -> Table:
    """Return the table of cost, time, velocity and forces of each contestant at the typical weight, simplest first.

    The last row is the policy at about the paper's approach time.
    """
    comparison, weight, resamples = results.comparison, found.time_weight, results.resamples
    ((at_weight, late),) = results.at_rule_time[comparison.chosen].items()
    compared = {name: f"{percent(above)} above" for name, above in found.above.items()}
    compared[found.controller] = "best choice"
    names = [contestant.name for contestant in simplest_first(comparison)]
    each = [(comparison.labels[name], results.runs[name][weight], compared[name]) for name in names]
    each.append((f"{POLICY} at about the paper's approach time (w = {at_weight:.3g})", late, "-"))
    rows = []
    for label, episodes, against in each:
        velocity, peak, touched = episodes.object_velocity, episodes.peak_force, ~episodes.missed
        impulse = velocity * episodes.scenario["object_mass"]
        row = {
            "controller": label,
            f"V_p + {weight:g} T (m/s)": f"{estimate(resamples.means(episodes.loss(weight))):.4f}",
            "against the best choice": against,
            "T (s)": f"{episodes.approach_time.mean():.4f}",
            "V_p (m/s)": f"{estimate(resamples.means_where(velocity, touched)):.3f}",
            "V_p, mean of the worst 5 %": f"{np.sort(velocity)[-max(1, round(0.05 * velocity.size)) :].mean():.3f}",
            "peak force (N): mean, 95 %": f"{peak.mean():.1f}, {np.quantile(peak, 0.95):.0f}",
            "impulse (N s)": f"{resamples.means_where(impulse, touched)[0]:.4f}",
            "several contacts": f"{100 * (episodes.contact_count > 1).mean():.1f} %",
            "missed": f"{episodes.missed.sum()}",
        }
        if comparison.operated:
            more = {"slide (m)": "slide", "until the touch (s)": "touch_time", "withheld": "withheld_share"}
            row |= {heading: f"{getattr(episodes, name).mean():.3f}" for heading, name in more.items()}
        rows.append(row)
    drawn = len(results.selection[found.controller][weight].missed)
    caption = (
        f"The best choice is the simplest controller whose cost is not clearly above the lowest, on {drawn:,} "
        "other scenarios (on these, if a CSV file gives them). The numbers are of these "
        f"{resamples.scenarios:,} scenarios, with the median seed's policy (in the ablation: the mean of all seeds) "
        "and 95 % intervals over scenarios. V_p and impulse, object mass times V_p: touched objects. The weight of the "
        "last row was found on other scenarios, too"
    )
    return Table.joined(caption, rows)
