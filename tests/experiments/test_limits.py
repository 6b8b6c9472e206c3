"""Limits instead of a time weight, what is recommended, and claims about arms that nobody chose."""

import json
import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from made_up_comparison import COUNT, played
from refusal import refused

from agents import tune
from agents.evaluate.play import play
from agents.setups import load_setup
from experiments import controller, limits
from experiments.lab.statistics import Estimate
from experiments.limits import Attempt, Limits, Search
from experiments.report.__main__ import ReportOptions, comparisons_of
from experiments.report.comparisons import PAPER
from experiments.studies import own_arms
from impact_gym.task import Task

WHERE = {"scenarios": {"set": "test", "count": 300}, "environment": {}}


def test_quantile_covers_the_true_one_and_counts_misses_as_above():
    samples = np.random.default_rng(0).uniform(size=(400, 300))
    found = [limits.quantile(each, np.zeros(300, bool), 0.9) for each in samples]
    assert np.mean([each.low <= 0.9 <= each.high for each in found]) > 0.92
    hundred = np.arange(1.0, 101.0)
    assert limits.quantile(hundred, hundred > 100, 0.95).value == 95.0
    assert limits.quantile(hundred, hundred <= 5, 0.95).value == 100.0
    assert math.isinf(limits.quantile(hundred, hundred <= 6, 0.95).value)


def test_largest_weight_that_keeps_a_limit_is_found():
    spec, limit = {"baseline": "constant-speed"}, 0.65
    tried = limits.attempts(spec, weights=(1.0, 0.7, 4.0), limits={"max_velocity": limit, "share": 0.9}, **WHERE)
    kept = max((each for each in tried if each.excess <= 1.0), key=lambda each: each.weight)
    beyond = min((each for each in tried if each.weight > kept.weight), key=lambda each: each.weight)
    assert beyond.excess > 1.0
    assert beyond.weight < 1.03 * kept.weight
    again = play(spec, WHERE["scenarios"], [kept.weight])
    assert (again["object_velocity"] <= limit).mean() > 0.9
    assert kept.times == pytest.approx(again["approach_time"][0])


def attempt(weight, time, value, limit=0.5):
    return Attempt(weight, np.full(COUNT, time), {"max_velocity": Estimate(value, value, value)}, value / limit)


def search_of(monkeypatch, *answers, **given):
    """The search of a synthetic comparison, whose calls have these results."""
    answers, comparison = iter(answers), played(("profile",)).comparison
    profile = replace(comparison.baselines[1], controller={"tuned": {"rule": "BlindProfile", "parameters": []}})
    whole = replace(comparison, scenarios={"set": "test", "count": 9}, baselines=(comparison.baselines[0], profile))
    for module, name, value in (
        (limits, "cached", lambda *_, **__: next(answers)), (limits, "comparisons_of", lambda _: [whole]),
        (limits, "tune_beyond", lambda *_: None), (tune.Tune, "baselines", lambda _: {"profile": None}),
        (tune.Tune, "search", lambda *_: {}),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, value)
    return Search(None, Limits(**given), tune.Tune(processes=0))


RULE, PROFILE = [attempt(2.0, 0.3, 0.9)], [attempt(0.5, 0.8, 0.3), attempt(1.0, 0.6, 0.5), attempt(2.0, 0.4, 0.7)]


@pytest.mark.parametrize(("policy", "name", "weight"), [
    ([attempt(1.0, 0.5, 0.4)], "seed-0", 1.0), ([attempt(1.0, 0.6, 0.4)], "profile", 1.0),
    ([attempt(1.0, 0.2, 0.6)], "profile", 1.0),
])  # fmt: skip
def test_soonest_within_the_limit_is_taken(policy, name, weight, monkeypatch, tmp_path):
    chart = tmp_path / "limits.svg"
    assert search_of(monkeypatch, [RULE, PROFILE, policy], max_velocity=0.5).soonest(chart) == (name, weight)
    assert "limit: 0.5 m/s" in chart.read_text()


@pytest.mark.parametrize(("limit", "said"), [(0.9, "no controller exceeds the limits"), (0.89, "")])
def test_limit_above_what_any_controller_does_is_named(limit, said, monkeypatch, tmp_path, capsys):
    tried = [[each._replace(excess=each.quantiles["max_velocity"].high / limit) for each in found]
             for found in (RULE, PROFILE, PROFILE)]  # fmt: skip
    search_of(monkeypatch, tried, max_velocity=limit).soonest(tmp_path / "limits.svg")
    assert capsys.readouterr().out.partition(",")[0] == said


def test_where_no_controller_keeps_a_limit_help_is_tried(monkeypatch, tmp_path):
    tried = [[attempt(2.0, 0.3, 0.9, 0.2)], [attempt(0.5, 0.8, 0.30001, 0.2)], [attempt(1.0, 0.9, 0.4, 0.2)]]
    helps = [[attempt(0.5, 0.9, value, 0.2)] for value in (0.21234, 0.15, math.inf)]
    search = search_of(monkeypatch, tried, helps, max_velocity=0.2)
    refused(lambda: search.soonest(tmp_path / "limits.svg"),
            "keeps V_p of 0.2 m/s for 95 %", "the least is V_p of 0.301 m/s, with the tuned profile",
            "half as stiff V_p of 0.213 m/s; with half the tool's mass V_p of 0.15 m/s; with twice the time none",
    )  # fmt: skip


@pytest.mark.parametrize(("border", "added"), [
    (0.3, [0.35, 0.175]), (9.0, [8.0, 16.0]), (99.0, [8.0, 16.0, 32.0]), (0.0, [0.35, 0.175, 0.0875, 0.0438, 0.0219]),
    (1.5, []),
])  # fmt: skip
def test_baselines_are_tuned_to_both_sides_of_a_limit(border, added, monkeypatch):
    weights = dict.fromkeys(("0.7", "4"))
    monkeypatch.setattr(tune.tuned, "read_tuned", lambda *_: {"weights": weights})
    monkeypatch.setattr(tune, "tune", lambda options: weights.update(dict.fromkeys(map(str, options.weights))))
    options = tune.Tune(("rigid-blind",), names=("rigid-blind-profile",))
    tune.tune_beyond(options, lambda _, weight: weight <= border)
    assert [float(weight) for weight in weights][2:] == pytest.approx(added, rel=0.01)


def test_recommended_file_has_what_the_reports_scenarios_give(tmp_path):
    setup, weight = load_setup("linear-blind"), 1.0
    options = controller.ControllerOptions("linear-blind", tmp_path, max_velocity=0.01, share=0.6)
    page = ReportOptions(setups=("linear-blind",), count=100)
    for best, kind in ((PAPER, "rule"), ("blind-profile", "baseline"), ("seed-0", "policy")):
        sentence = controller.write_recommended(setup.path, options, page, best, weight)
        found = json.loads((tmp_path / "recommended.json").read_text())
        assert (found["kind"], found["time_weight"], found["limits"]) == (
            kind,
            weight,
            {"max_velocity": 0.01, "share": 0.6},
        )
        assert "In these scenarios a limit is not kept." in sentence
    assert found["controller"] == str(tmp_path / "policies" / "linear-blind.npz")
    (seed,) = (each.controller for each in comparisons_of(page)[0].seeds if each.name == "seed-0")
    again = {name: values[0] for name, values in play(seed, WHERE["scenarios"] | {"count": 100}, [weight]).items()
             if values.ndim == 2}  # fmt: skip
    for name, measured in (("velocity", "object_velocity"), ("force", "peak_force"), ("time", "approach_time")):
        assert (again[measured] <= found["measured"][f"p95_{name}"]).sum() == 95
    assert found["measured"]["mean_time"] == pytest.approx(again["approach_time"].mean())
    assert found["measured"]["mean_velocity"] == pytest.approx(again["object_velocity"].mean())


def test_random_arms_are_valid_and_differ():
    arms = [own_arms.arm(seed) for seed in range(own_arms.ARMS)]
    assert len({json.dumps(each) for each in arms}) == len(arms)
    for each in arms:
        Task(**each)
        assert tomllib.loads("\n".join(own_arms.toml(each, "environment."))) == {"environment": each}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(own_arms.ARMS))
def test_claims_hold_for_arms_that_nobody_chose(seed):
    assert own_arms.judged(seed) == [{"invariant": "all", "fault": ""}]
