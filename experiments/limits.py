"""The search behind `impact-gym controller --max-velocity 0.3`: the soonest controller that keeps limits.

The choice uses the scenarios in which the report chooses, and the upper ends of intervals.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.baselines import RULES
from agents.evaluate.specs import controller_of, scenario_batch_of
from agents.setups.evaluation import changes
from agents.tune import BOUND_RTOL, Tune, tune_beyond, tune_one
from experiments.lab import charts
from experiments.lab.statistics import Estimate, Floats
from experiments.report.__main__ import ReportOptions, comparisons_of
from experiments.report.choice import simplest, simplest_first
from experiments.report.episodes import selection_scenarios
from experiments.report.limits import Limits, front, words
from impact_gym.support.files import write_file
from impact_gym.support.provenance import digest_of
from impact_gym.task import Task

JSON = Mapping[str, Any]
HALVINGS = 6  # bisections between two time weights; if these are 2 apart, the error of the result is 1 %


class Attempt(NamedTuple):
    """Results of a controller at one time weight."""

    weight: float  # m/s per s
    times: Floats  # (scenarios,), approach times, s
    quantiles: Mapping[str, Estimate]  # of each limited result, by option
    excess: float  # largest ratio of the upper end of an interval to its limit; at most 1: all limits are kept


def attempts(
    controller: JSON, environment: JSON, scenarios: JSON, weights: Sequence[float], limits: JSON,
) -> list[Attempt]:  # fmt: skip
    """Return the results at `weights` (m/s per s), then those of a bisection for the largest weight that keeps all."""
    task, wanted = Task(**environment), Limits(**limits)

    def attempt(weight: float) -> Attempt:
        player = controller_of(controller, weight, task)
        played = scenario_batch_of(scenarios, weight, task, lenient=True).play(player)
        found = wanted.reached(played)
        excess = max(each.high / wanted.given[name] for name, each in found.items())
        return Attempt(weight, played.approach_time, found, excess)

    tried = [attempt(weight) for weight in sorted(weights)]
    low = max((each.weight for each in tried if each.excess <= 1.0), default=math.inf)
    high = min((each.weight for each in tried if each.weight > low), default=low)
    for _ in range(HALVINGS if high > low else 0):
        tried.append(attempt(math.sqrt(low * high)))
        low, high = (tried[-1].weight, high) if tried[-1].excess <= 1.0 else (low, tried[-1].weight)
    return tried


def attempts_elsewhere(rule: str, environment: JSON, weight: float, search: JSON, **where: Any) -> list[Attempt]:
    """Return the results of a rule that is tuned for `environment` at a time weight; `where`: see `attempts`."""
    names = RULES[rule].names()
    found = tune_one(rule, environment, weight, BOUND_RTOL, **search)["parameters"]
    content = {"rule": rule, "environment": environment, "parameters": [{"name": name} for name in names],
               "weights": {f"{weight:g}": {"parameters": dict(zip(names, found, strict=True))}}}  # fmt: skip
    own = {name: value for name, value in environment.items() if name != "scenario"}
    return attempts({"tuned": content}, own, weights=[weight], **where)


class Search:
    """The search for the soonest contestant of a comparison that keeps limits."""

    def __init__(self, page: ReportOptions, limits: Limits, tuning: Tune) -> None:
        """Tune further time weights where the limits need them. `page`, `tuning`: of a report and of its baselines."""
        (self.comparison,), self.limits, self.tuning = comparisons_of(page), limits, tuning
        scenarios = selection_scenarios(self.comparison.scenarios)
        self.where = {"scenarios": scenarios, "limits": limits.given | {"share": limits.share}}
        tune_beyond(tuning, self.keeps)
        (self.comparison,) = comparisons_of(page)  # with the further weights

    def keeps(self, content: JSON, weight: float) -> bool:
        """Return whether the tuned baseline with this content of a file keeps the limits at a weight (m/s per s)."""
        (found,) = attempts({"tuned": content}, self.comparison.environment, weights=[weight], **self.where)
        return found.excess <= 1.0

    def _each(self, function: Any, arguments: Iterable[JSON]) -> list[list[Attempt]]:
        digest = digest_of("impact_gym", "agents", "experiments.limits", "experiments.report.limits")
        return self.tuning.search_all(function, [{**each, **self.where} for each in arguments], "limits", digest)

    def write(self, folder: Path) -> Path:
        """Write `folder`/limits.json, and limits.svg, a chart of all attempts; return the path of limits.json.

        It names the simplest contestant whose mean time is not clearly above the least, and its time weight.
        ValueError: no contestant keeps the limits; it says what would help.
        """
        environment, contestants = self.comparison.environment, simplest_first(self.comparison)
        arguments = [{"controller": each.controller, "weights": each.weights, "environment": environment}
                     for each in contestants]  # fmt: skip
        tried = dict(zip((each.name for each in contestants), self._each(attempts, arguments), strict=True))
        kept = {name: [each for each in found if each.excess <= 1.0] for name, found in tried.items()}
        best = {name: min(found, key=lambda each: each.times.mean()) for name, found in kept.items() if found}
        (first, *_), rows = self.limits.given, dict[str, list[tuple[float, float, bool]]]()
        for name, found in tried.items():
            each = ((float(a.times.mean()), a.quantiles[first].value, a.excess <= 1.0) for a in found)
            rows[name] = [attempt for attempt in each if math.isfinite(attempt[1])]
        content = {"limits": self.where["limits"], "controller": "", "time_weight": 0.0, "attempts": rows}
        charts.save(front(content, self.comparison.labels).figure, folder / "limits.svg")
        if not best:
            raise ValueError(self.nobody(tried))
        if all(each.excess <= 1.0 for found in tried.values() for each in found):
            print("no controller exceeds the limits, so they decide nothing")
        name = simplest({name: each.times for name, each in best.items()})
        content |= {"controller": name, "time_weight": best[name].weight}
        return write_file(folder / "limits.json", json.dumps(content, indent=1) + "\n")

    def nobody(self, tried: Mapping[str, list[Attempt]]) -> str:
        """Say that no contestant keeps the limits, the least that is kept, and what each change of the arm gives."""

        def least(found: Sequence[Attempt]) -> str:
            best = min(found, key=lambda each: each.excess)
            if not math.isfinite(best.excess):
                return "none, as too many objects are missed"
            return words({name: f"{np.ceil(1e3 * each.high) / 1e3:g}" for name, each in best.quantiles.items()})

        excess = {name: min(each.excess for each in found) for name, found in tried.items()}
        best, searched = min(tried, key=excess.__getitem__), self.tuning.baselines()
        text = (f"no controller of this arm keeps {words(self.limits.given)} for {100 * self.limits.share:g} % of the "
                f"objects; the least is {least(tried[best])}, with the {self.comparison.labels[best]}")  # fmt: skip
        environment = {**self.comparison.environment, "scenario": self.where["scenarios"]["ranges"]}
        helps = {
            "a mount half as stiff": ("coupling.stiffness", {"times": [0.5]}),
            "half the tool's mass": ("tool_mass", {"times": [0.5]}),
            "twice the time": ("horizon", [2.0 * Task(**environment).horizon]),
        }
        others = {words: change.environment for words, of in helps.items() for change in changes(*of, environment)}
        for rule in sorted((each for each in self.comparison.baselines if each.name in searched),
                           key=lambda each: excess[each.name])[:1]:  # fmt: skip
            search = {"rule": rule.controller["tuned"]["rule"], "weight": min(rule.weights),
                      "search": self.tuning.search(rule.name, searched[rule.name])}  # fmt: skip
            found = self._each(attempts_elsewhere, ({"environment": each, **search} for each in others.values()))
            text += "".join(f"; with {change} {least(each)}" for change, each in zip(others, found, strict=True))
        return text
