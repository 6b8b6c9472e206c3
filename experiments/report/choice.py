"""The recommended controller: the simplest whose mean cost at one time weight is not clearly above the lowest.

With limits, it is the soonest that keeps them, which `experiments.limits` has found. 'Not clearly' means that the 95 %
interval of the difference includes 0. Controllers from simple to complex: untuned baselines, tuned baselines by number
of parameters, the user's controllers, the policy.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from agents.evaluate.scenario_batch import Episodes
from experiments.lab.parts import Table, percent
from experiments.lab.statistics import Estimate, Floats, Resamples, estimate, reduction
from experiments.report.comparisons import PAPER, POLICY, Comparison, Contestant
from experiments.report.episodes import ComparisonResults
from experiments.report.limits import Limits, quantile, times, words
from impact_gym.task import Task


@dataclass(frozen=True)
class Choice:
    """The recommended controller, and its cost."""

    controller: str  # name of the contestant
    time_weight: float  # w, m/s per s
    cost: Estimate  # mean of V_p + w T + cost of a miss, m/s
    above: Mapping[str, Estimate]  # fraction by which the cost of each other contestant is above `cost`, by name
    measured: Mapping[str, float | None]  # see `measured`
    sentence: str  # what to take, and what it brings, in words
    reason: str  # its cost, and the costs of the others


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
    limited = comparison.limited
    name = limited["controller"] if limited else simplest(
        {each: results.selection[each][weight].loss(weight) for each in names}
    )  # fmt: skip
    costs = {each: resamples.means(results.runs[each][weight].loss(weight)) for each in names}
    cost = estimate(costs[name])
    above = {each: -reduction(costs[each], costs[name]) for each in names if each != name}
    other = comparison.chosen if name != comparison.chosen else comparison.rival.name
    others = [f"{labels[each]}: {_difference(above[each])}" for each in names if each != name]
    reason = f"Its cost, V_p + {weight:.3g} T and the cost of misses, is {cost.value:.3f} m/s. {'; '.join(others)}."
    sentence = f"Take the {comparison.words[name]}. {effect(results, name)}"
    if limited:
        sentence += f" {_kept(results, name)}"
        within = times(limited)
        others = [f"{labels[each]} after {within[each]:.3f} s" if each in within else f"{labels[each]} never"
                  for each in names]  # fmt: skip
        reason = (f"It is the soonest that keeps the limits. Least mean time that keeps them, each controller at its "
                  f"own time weight: {'; '.join(others)}.")  # fmt: skip
    elif other != name:
        sentence += f" The {comparison.words[other]} {_difference(above[other], weight)}."
    return Choice(name, weight, cost, above, measured(results.runs[name][weight]), sentence, reason)


def measured(episodes: Episodes) -> dict[str, float | None]:
    """Return mean V_p (m/s) of the touched objects, mean approach time (s), number of misses, and 95 % quantiles.

    95 % of all objects are touched and stay at or below a quantile "p95_..."; it is None if fewer are touched.
    """
    velocity, time, missed = episodes.object_velocity, episodes.approach_time, episodes.missed
    found: dict[str, float | None] = {"mean_velocity": None if missed.all() else float(velocity[~missed].mean())}
    for name, values in (("velocity", velocity), ("force", episodes.peak_force), ("time", time)):
        highest = quantile(values, missed, 0.95).value
        found[f"p95_{name}"] = highest if math.isfinite(highest) else None
    return found | {"mean_time": float(time.mean()), "missed": int(missed.sum())}


def _kept(results: ComparisonResults, name: str) -> str:
    """Return in words what a contestant reaches of the limits, in the report's scenarios."""
    wanted = Limits(**results.comparison.limited["limits"])
    reached = wanted.reached(results.runs[name][results.comparison.typical])
    least = words({option: f"{each:.3g}" for option, each in reached.items()})
    above = any(each.low > wanted.given[option] for option, each in reached.items())
    return (f"{100 * wanted.share:g} % of the objects stay at or below {least}; the limit is {words(wanted.given)}."
            f"{' In these scenarios a limit is not kept.' * above}")  # fmt: skip


def effect(results: ComparisonResults, name: str) -> str:
    """Return what a contestant brings, against the paper's rule: speed of the objects, time, missed objects."""
    comparison, weight, count = results.comparison, results.comparison.typical, results.resamples.scenarios
    ours, rule = (results.runs[each].means(weight) for each in (name, PAPER))
    leave = "Objects reach" if Task(**comparison.environment).friction else "Objects leave at"
    until = "all is done" if comparison.operated else "are touched"
    text, later = f"{leave} {speed(ours['V'])} m/s", round(1e3 * (ours["T"] - rule["T"]))
    if name == PAPER or rule["missed"] == count:
        text += f", and {until} after {ours['T']:.2f} s."
    else:
        when = f"{abs(later)} ms {'later' if later > 0 else 'sooner'}" if later else "as soon"
        text += f" instead of {speed(rule['V'])}, and {until} {when}."
    if ours["missed"] or rule["missed"]:
        of_rule = "" if name == PAPER else f", the paper's rule {rule['missed']:,}"
        text += f" It misses {ours['missed']:,} of {count:,} objects{of_rule}."
    return text


def speed(value: float) -> str:
    """Return a speed (m/s) as text, with two decimals, or three below 0.1 m/s."""
    return f"{value:.{2 if value >= 0.1 else 3}f}"


def numbers(found: Choice, results: ComparisonResults) -> list[tuple[str, str]]:
    """Return the three numbers of the first screen, each with its words: speed of the objects, time, misses."""
    weight, count, highest = found.time_weight, results.resamples.scenarios, found.measured["p95_velocity"]
    ours, rule = results.runs[found.controller].means(weight), results.paper.means(weight)
    most = "" if highest is None else f"; 95 of 100 stay at or below {speed(highest)} m/s"
    words = "all is done" if results.comparison.operated else "the touch"
    words = f"mean time until {words}, T. Paper's rule: {rule['T']:.2f} s. A second counts as much as {weight:.3g} m/s"
    leave = f"mean final speed of the objects, V_p{most}. Paper's rule: {speed(rule['V'])} m/s"
    return [
        (f"{speed(ours['V'])} m/s", leave),
        (f"{ours['T']:.2f} s", f"{words} (time weight w): the cost is V_p + w T"),
        (f"{ours['missed']:,} of {count:,}", f"objects missed. Paper's rule: {rule['missed']:,}"),
    ]


def _difference(above: Estimate, weight: float | None = None) -> str:
    """Return a difference in cost in words; with `weight` (m/s per s) briefly, and with what the cost is."""
    if above.low <= 0.0 <= above.high:
        return "does as well, no better" if weight else f"no significant difference ({percent(above)})"
    size = f"costs {100 * abs(above.value):.1f} %" if weight else percent(above if above.low > 0.0 else -above)
    more = "more" if above.low > 0.0 else "less here, but not in the scenarios of the choice"
    return f"{size} {more}{f' (cost: V_p + {weight:.3g} T)' if weight else ''}"


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
        "objects missed": f"{found.measured['missed']} of {results.resamples.scenarios}",
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
            f"V_p + {weight:.3g} T (m/s)": f"{estimate(resamples.means(episodes.loss(weight))):.4f}",
            "against the best choice": against,
            "T (s)": f"{episodes.approach_time.mean():.4f}",
            "V_p (m/s)": f"{estimate(resamples.means_where(velocity, touched)):.3f}",
            "V_p, mean of the worst 5 %": f"{np.sort(velocity)[-max(1, round(0.05 * velocity.size)) :].mean():.3f}",
            "peak force (N): mean, 95 %": f"{peak.mean():.1f}, {np.quantile(peak, 0.95):.0f}",
            "impulse (N s)": f"{resamples.means_where(impulse, touched)[0]:.4f}",
            "several contacts": f"{100 * (episodes.contact_count > 1).mean():.1f} %",
            "missed": f"{episodes.missed.sum()}",
        }
        if limited := comparison.limited:
            wanted = Limits(**limited["limits"])
            row |= {f"{100 * wanted.share:g} % below, of {option.replace('_', ' ')}": f"{each:.3g}"
                    for option, each in wanted.reached(episodes).items()}  # fmt: skip
        if comparison.operated:
            more = {"slide (m)": "slide", "until the touch (s)": "touch_time", "withheld": "withheld_share"}
            row |= {heading: f"{getattr(episodes, name).mean():.3f}" for heading, name in more.items()}
        rows.append(row)
    drawn = len(results.selection[found.controller][weight].missed)
    best = "soonest controller that keeps the limits" if comparison.limited else (
        "simplest controller whose cost is not clearly above the lowest"
    )  # fmt: skip
    caption = (
        f"The best choice is the {best}, on {drawn:,} "
        "other scenarios (on these, if a CSV file gives them). The numbers are of these "
        f"{resamples.scenarios:,} scenarios, with the median seed's policy (in the ablation: the mean of all seeds) "
        "and 95 % intervals over scenarios. V_p and impulse, object mass times V_p: touched objects. The weight of the "
        "last row was found on other scenarios, too"
    )
    return Table.joined(caption, rows)
