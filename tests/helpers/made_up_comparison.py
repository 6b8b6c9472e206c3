"""A synthetic comparison: contestants with given times and velocities, so that the report's numbers follow by hand."""

import numpy as np

from agents.evaluate.scenario_batch import Episodes
from agents.setups.evaluation import Evaluation
from experiments.report.comparisons import PAPER, Comparison, Contestant
from experiments.report.episodes import ComparisonResults, Results
from impact_gym.task.scenario import FIELDS

COUNT, WEIGHTS, PAPER_TIME = 60, (1.0, 2.0), 0.3
SPEEDS = np.random.default_rng(0).uniform(0.5, 1.5, COUNT)
"""V_p of the paper's rule, m/s; the V_p of other contestants is a share of it."""
RULES = {
    "constant": "ConstantSpeed", "evenly": "ConstantDeceleration", "profile": "BlindProfile", "other": "BlindProfile",
    "range": "Ranged", "over": "RangedProfile", "filter": "FilteredProfile",
}  # fmt: skip
SCENARIO = dict.fromkeys(FIELDS, SPEEDS)
SHARES = {"constant": (0.6, 0.8), "evenly": (0.5, 0.7), "profile": (0.4, 0.6)}  # of SPEEDS, at 0.4 s and at 0.2 s


def run(shares, times=(0.4, 0.2), weights=WEIGHTS, missed=0):
    """A contestant whose V_p at each weight is a share of SPEEDS, after an approach of that weight's time (s)."""
    ones = np.ones(COUNT)
    each = (Episodes(share * SPEEDS, time * ones, ones, ones, np.arange(COUNT) < missed, SCENARIO)
            for share, time in zip(shares, times, strict=True))  # fmt: skip
    return Results(zip(weights, each, strict=True))


def played(names=("profile", "constant"), seeds=((0.2, 0.4),), varied=None, **environment):
    """At 0.3 s, V_p is 0.7 (constant speed), 0.5 (profile) and 0.3 (policy) of the rule's; `seeds` are their shares."""
    tuned = {name: {"rule": rule, "parameters": [0] * (1 + ("profile" in name))} for name, rule in RULES.items()}
    specs = {name: {"tuned": tuned[name]} if name in tuned else {"baseline": name} for name in names}
    rivals = [Contestant(name, spec, WEIGHTS, "") for name, spec in specs.items()]
    policies = tuple(Contestant(f"seed-{k}", {"policy": ""}, WEIGHTS, "") for k in range(len(seeds)))
    everyone = (Contestant(PAPER, {"baseline": "paper-trapezoid"}, (2.0,), ""), *rivals)
    evaluation = Evaluation(weights=WEIGHTS, varied=varied or {})
    comparison = Comparison("toy", environment, policies, "seed-0", everyone, {}, "", evaluation)
    results = ComparisonResults(comparison, seeds={f"seed-{k}": run(shares) for k, shares in enumerate(seeds)})
    results.baselines = {PAPER: run((1.0,), (PAPER_TIME,), (2.0,))}
    results.baselines |= {name: run(SHARES.get(name, (0.35, 0.45))) for name in names}
    results.selection = {**results.baselines, "seed-0": results.seeds["seed-0"]}
    results.at_rule_time = {"seed-0": run((0.5 * sum(seeds[0]),), (PAPER_TIME,), (1.4,))}
    return results
