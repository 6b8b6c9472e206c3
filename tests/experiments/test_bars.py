"""The bars: targets beside the results of the seeds."""

import numpy as np
import pytest

from agents.setups.evaluation import Evaluation
from experiments.lab.statistics import Estimate
from experiments.report.bars import Bar, bars, table
from experiments.report.matchups import PAPER, Contestant, Matchup
from experiments.report.played import Played, Run
from impact_gym.task.scenario import FIELDS

COUNT, WEIGHTS = 400, (1.0, 4.0)
RNG = np.random.default_rng(0)
SPEEDS = RNG.uniform(0.5, 5.0, COUNT)


def run(share, weights, missed=0):
    """A contestant whose V_p is a `share` of the same objects' speeds, and whose approach takes 0.3 s."""
    shape = (len(weights), COUNT)
    missing = np.zeros(shape, bool)
    missing[0, :missed] = True
    results = {"object_velocity": np.broadcast_to(share * SPEEDS, shape), "approach_time": np.full(shape, 0.3)}
    others = dict.fromkeys(("peak_force", "contact_count", *FIELDS), np.ones(shape))
    return Run(weights, {**results, **others, "missed": missing})


def played(name, late, evaluation, shares=(1.1, 0.8, 0.95)):
    """Three seeds, the middle one chosen, against the paper's rule and two tuned baselines."""
    seeds = tuple(Contestant(f"seed-{k}", {}, WEIGHTS, "") for k in range(3))
    rivals = [Contestant(PAPER, {}, (2.0,), ""), *(Contestant(rival, {}, WEIGHTS, "") for rival in ("slow", "slower"))]
    results = Played(Matchup(name, {}, seeds, "seed-1", tuple(rivals), {}, {}, "", evaluation))
    results.baselines = {PAPER: run(1.0, (2.0,)), "slow": run(0.9, WEIGHTS), "slower": run(0.85, WEIGHTS)}
    results.seeds = {f"seed-{k}": run(share, WEIGHTS, missed=k) for k, share in enumerate(shares)}
    results.as_late = {f"seed-{k}": run(late * share, (2.0,)) for k, share in enumerate(shares)}
    return results


def test_bars_compare_with_rule_and_best_baseline_and_count_misses():
    results = played("one", 0.5, Evaluation(weights=WEIGHTS, at_most=0.42))
    first, *ratios, missed = bars(results, [results])
    assert first.reached == pytest.approx({"seed-0": 0.55, "seed-1": 0.4, "seed-2": 0.475})
    assert (first.interval.low, first.interval.high) == pytest.approx((0.4, 0.4))  # pairs leave nothing open
    assert first.verdict == "met"
    for bar, weight in zip(ratios, WEIGHTS, strict=True):
        assert bar.what == f"V_p + w T over that of slower, w = {weight:g}"
        expected = (0.95 * SPEEDS.mean() + 0.3 * weight) / (0.85 * SPEEDS.mean() + 0.3 * weight)
        late = 2.0 * 2 / COUNT if weight == 1.0 else 0.0  # what two misses cost
        assert bar.reached["seed-2"] == pytest.approx(expected + late / (0.85 * SPEEDS.mean() + 0.3 * weight))
    assert missed.reached == {"seed-0": 0.0, "seed-1": 1.0, "seed-2": 2.0}
    assert missed.verdict == "missed"
    rows = table([first, *ratios, missed]).rows
    assert rows[0] == (first.what, "0.42", "0.400 [0.400, 0.400]", "0.4, 0.475, 0.55", "1 of 3", "met")
    assert rows[-1][1:] == ("0", "1", "0, 1, 2", "1 of 3", "missed")


def test_bars_compare_with_another_set_up_only_if_it_is_played():
    measure = played("other", 0.5, Evaluation())
    results = played("one", 0.25, Evaluation(weights=WEIGHTS, at_most=1.0, of="other"))
    first = bars(results, [measure, results])[0]
    assert first.what.startswith("V_p over that of the policy of other")
    assert first.reached["seed-1"] == pytest.approx(0.5)
    assert bars(results, [results])[0].what.startswith("V_p + w T")  # alone there is nothing to measure it against


def test_bars_of_nominal_set_ups_compare_with_another_arm_and_under_changes_with_the_rule():
    evaluation = Evaluation(weights=WEIGHTS, at_most=1.02, of="linear-blind", nominal={"tool_mass": 0.2},
                            varied={"tool_mass": [0.1, 0.2, 0.3]})  # fmt: skip
    results = played("one", 0.5, evaluation)
    results.nominal = {f"seed-{k}": run(share, WEIGHTS) for k, share in enumerate((0.6, 0.51, 0.5))}
    results.nominal["linear-blind"] = run(0.5, WEIGHTS)
    for label, share, missed in (("0.1", 0.3, 0), ("0.2", 0.5, 2), ("0.3", 1.2, 1)):
        results.varied["tool_mass", label, "seed-1"] = run(share, (2.0,), missed)
        results.varied["tool_mass", label, PAPER] = run(1.0, (2.0,))
    first, second, rule, missed, *_ = bars(results, [results])
    for bar, weight in ((first, 1.0), (second, 4.0)):
        assert f"linear-blind's policy, w = {weight:g}" in bar.what
        base = SPEEDS.mean()
        assert bar.reached["seed-0"] == pytest.approx((0.6 * base + 0.3 * weight) / (0.5 * base + 0.3 * weight))
        assert bar.at_most == 1.02
    penalty = 2.0 * 1 / COUNT  # what a miss costs
    expected = (1.2 * SPEEDS.mean() + 0.3 + penalty) / (SPEEDS.mean() + 0.3)  # w = 1, of theirs the nearest to 2
    assert rule.reached == {"seed-1": pytest.approx(expected)}
    assert (rule.at_most, rule.verdict) == (1.0, "missed")
    assert missed.reached == {"seed-1": 2 / COUNT}
    assert (missed.at_most, missed.verdict) == (1 / 500, "missed")


@pytest.mark.parametrize(("interval", "verdict"), [
    ((0.9, 0.8, 0.95), "met"),
    ((0.99, 0.98, 1.01), "met, within the interval"),
    ((1.01, 0.99, 1.02), "missed, within the interval"),
    ((1.1, 1.05, 1.2), "missed"),
])  # fmt: skip
def test_verdict_says_what_the_interval_leaves_open(interval, verdict):
    assert Bar("a ratio", 1.0, "seed-0", Estimate(*interval), {"seed-0": interval[0]}).verdict == verdict
