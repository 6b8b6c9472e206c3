"""Limits instead of a time weight, what is recommended, and claims about arms that nobody chose."""

import json
import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import tomli_w
from made_up_comparison import COUNT, PAPER_TIME, SPEEDS, WEIGHTS, played, run
from refusal import refused

from agents import tune
from agents.evaluate.scenario_batch import Episodes
from agents.setups import load_setup
from agents.setups.evaluation import Evaluation
from experiments import controller, limits
from experiments.lab import grid
from experiments.lab.statistics import Estimate
from experiments.report import choice
from experiments.report.comparisons import PAPER, of_setup
from experiments.report.limits import Limits, front, quantile, read_limited
from experiments.studies import own_arms
from impact_gym.task import Task

WHERE = {"scenarios": {"set": "test", "count": 300}, "environment": {}}


def test_quantile_covers_the_true_one_and_counts_misses_as_above():
    samples = np.random.default_rng(0).uniform(size=(400, 300))
    found = [quantile(each, np.zeros(300, bool), 0.9) for each in samples]
    assert np.mean([each.low <= 0.9 <= each.high for each in found]) > 0.92
    hundred = np.arange(1.0, 101.0)
    assert quantile(hundred, hundred > 100, 0.95).value == 95.0
    assert quantile(hundred, hundred <= 5, 0.95).value == 100.0
    assert math.isinf(quantile(hundred, hundred <= 6, 0.95).value)


def test_largest_weight_that_keeps_a_limit_is_found():
    spec, limit = {"baseline": "constant-speed"}, 0.65
    tried = limits.attempts(spec, weights=(1.0, 0.7, 4.0), limits={"max_velocity": limit, "share": 0.9}, **WHERE)
    kept = max((each for each in tried if each.excess <= 1.0), key=lambda each: each.weight)
    beyond = min((each for each in tried if each.weight > kept.weight), key=lambda each: each.weight)
    assert beyond.excess > 1.0
    assert beyond.weight < 1.03 * kept.weight
    again = grid.play(spec, {}, WHERE["scenarios"], [kept.weight])
    assert (again["object_velocity"] <= limit).mean() > 0.9
    assert kept.times == pytest.approx(again["approach_time"].to_numpy())


def attempt(weight, time, value, limit=0.5):
    return limits.Attempt(weight, np.full(COUNT, time), {"max_velocity": Estimate(value, value, value)}, value / limit)


def search_of(monkeypatch, *answers, **given):
    """The search of a synthetic comparison, whose calls have these results."""
    answers, comparison = iter(answers), played(("profile",)).comparison
    profile = replace(comparison.baselines[1], controller={"tuned": {"rule": "BlindProfile", "parameters": []}})
    whole = replace(comparison, scenarios={"set": "test", "count": 9}, baselines=(comparison.baselines[0], profile))
    for module, name, value in (
        (tune, "cached", lambda *_, **__: next(answers)), (limits, "comparisons_of", lambda _: [whole]),
        (limits, "tune_beyond", lambda *_: None), (tune.Tune, "baselines", lambda _: {"profile": None}),
        (tune.Tune, "search", lambda *_: {}),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, value)
    return limits.Search(None, Limits(**given), tune.Tune(processes=0))


RULE, PROFILE = [attempt(2.0, 0.3, 0.9)], [attempt(0.5, 0.8, 0.3), attempt(1.0, 0.6, 0.5), attempt(2.0, 0.4, 0.7)]


@pytest.mark.parametrize(("policy", "name", "weight"), [
    ([attempt(1.0, 0.5, 0.4)], "seed-0", 1.0), ([attempt(1.0, 0.6, 0.4)], "profile", 1.0),
    ([attempt(1.0, 0.2, 0.6)], "profile", 1.0),
])  # fmt: skip
def test_soonest_within_the_limit_is_taken(policy, name, weight, monkeypatch, tmp_path):
    limited = read_limited(search_of(monkeypatch, [RULE, PROFILE, policy], max_velocity=0.5).write(tmp_path))
    assert (limited["controller"], limited["time_weight"]) == (name, weight)
    assert "limit: 0.5 m/s" in (tmp_path / "limits.svg").read_text()


@pytest.mark.parametrize(("limit", "said"), [(0.9, "no controller exceeds the limits"), (0.89, "")])
def test_limit_above_what_any_controller_does_is_named(limit, said, monkeypatch, tmp_path, capsys):
    tried = [[each._replace(excess=each.quantiles["max_velocity"].high / limit) for each in found]
             for found in (RULE, PROFILE, PROFILE)]  # fmt: skip
    search_of(monkeypatch, tried, max_velocity=limit).write(tmp_path)
    assert capsys.readouterr().out.partition(",")[0] == said


def test_where_no_controller_keeps_a_limit_help_is_tried(monkeypatch, tmp_path):
    tried = [[attempt(2.0, 0.3, 0.9, 0.2)], [attempt(0.5, 0.8, 0.30001, 0.2)], [attempt(1.0, 0.9, 0.4, 0.2)]]
    helps = [[attempt(0.5, 0.9, value, 0.2)] for value in (0.21234, 0.15, math.inf)]
    search = search_of(monkeypatch, tried, helps, max_velocity=0.2)
    refused(lambda: search.write(tmp_path), "keeps V_p of 0.2 m/s for 95 %",
            "the least is V_p of 0.301 m/s, with the tuned profile",
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


def test_page_recommends_by_the_limit_and_shows_it_as_a_line():
    results, attempts = played(), {"profile": [(0.4, 0.6, True), (0.2, 0.9, False)], PAPER: [(0.3, 1.5, False)]}
    limited = {"limits": {"max_velocity": 0.7, "share": 0.9}, "controller": "profile", "time_weight": 1.0}
    results.comparison = replace(results.comparison, limited=limited | {"attempts": attempts}, evaluation=Evaluation(
        weights=WEIGHTS, typical=1.0))  # fmt: skip
    results.baselines[PAPER] = run((1.0,), (PAPER_TIME,), (1.0,))
    found = choice.choice(results)
    assert (found.controller, found.time_weight) == ("profile", 1.0)
    reached = np.sort(0.4 * SPEEDS)[math.ceil(0.9 * COUNT) - 1]
    assert f"90 % of the objects stay at or below V_p of {reached:.3g} [" in found.sentence
    assert "the limit is V_p of 0.7 m/s" in found.sentence
    assert "tuned profile (profile) after 0.400 s" in found.reason
    assert "paper's rule never" in found.reason
    tight = replace(results.comparison, limited=results.comparison.limited | {"limits": {"max_velocity": 0.3}})
    assert "a limit is not kept" in choice.choice(replace(results, comparison=tight)).sentence
    (axes,) = front(results.comparison.limited, results.comparison.labels).figure.axes
    assert [line.get_ydata()[0] for line in axes.lines if line.get_label() == "limit: 0.7 m/s"] == [0.7]


def test_limits_of_another_file_are_refused(tmp_path):
    good = {"limits": {"max_velocity": 0.3, "share": 0.9}, "controller": "blind-profile", "time_weight": 1.0,
            "attempts": {"blind-profile": [[0.3, 0.2, True]]}}  # fmt: skip
    changes = [
        {"controller": "odie"}, {"controller": 3}, {"limits": {}}, {"limits": {"most": 1.0}}, {"time_weight": -1},
        {"attempts": {"blind-profile": [[0.3, "fast", True]]}}, {"attempts": [1]}, {"more": 1},
    ]  # fmt: skip
    path = tmp_path / "limits.json"
    for content in ([], "nonsense", *(good | change for change in changes)):
        path.write_text(json.dumps(content))
        refused(lambda: read_limited(path), "limits.json", "cannot be read as limits.json of impact-gym controller")
    path.write_text(json.dumps(good))
    limited = read_limited(path)
    assert of_setup(load_setup("linear-blind"), {"set": "test", "count": 2}, limited=limited).limited == good
    limited["attempts"]["garfield"] = []
    refused(lambda: of_setup(load_setup("linear-blind"), {"set": "test", "count": 2}, limited=limited),
            "limited is of another set-up than linear-blind", "'garfield'")  # fmt: skip


def test_quantiles_of_the_recommended_count_misses_as_above():
    hundred = np.arange(1.0, 101.0)
    episodes = Episodes(hundred, 2.0 * hundred, 3.0 * hundred, np.ones(100), hundred <= 5.0, {})
    assert choice.measured(episodes) == {
        "mean_velocity": 53.0, "p95_velocity": 100.0, "p95_force": 300.0, "p95_time": 200.0, "mean_time": 101.0,
        "missed": 5,
    }  # fmt: skip
    episodes.missed[:6] = True
    assert choice.measured(episodes)["p95_force"] is None


@pytest.mark.parametrize(("best", "kind", "source"), [
    (PAPER, "rule", "paper-trapezoid"), ("seed-0", "policy", "policies/linear-blind.npz"),
    ("blind-profile", "baseline", "tuned/blind-profile.json"),
])  # fmt: skip
def test_recommended_file_names_what_can_be_loaded(best, kind, source, tmp_path):
    options = controller.ControllerOptions("linear-blind", tmp_path, max_velocity=0.01, share=0.6)
    chosen = {"controller": best, "time_weight": 1.0, "measured": {"missed": 3}}
    found = json.loads(controller.write_recommended(load_setup("linear-blind").path, options, chosen).read_text())
    where = str(tmp_path / source) if "/" in source else source
    assert found == {"controller": where, "kind": kind, "time_weight": 1.0, "measured": {"missed": 3},
                     "limits": {"max_velocity": 0.01, "share": 0.6}}  # fmt: skip


def test_random_arms_are_valid_and_differ():
    arms = [own_arms.arm(seed) for seed in range(own_arms.ARMS)]
    assert len({json.dumps(each) for each in arms}) == len(arms)
    for each in arms:
        Task(**each)
        assert tomllib.loads(tomli_w.dumps(each)) == each


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(own_arms.ARMS))
def test_claims_hold_for_arms_that_nobody_chose(seed):
    assert own_arms.judged(seed) == [{"invariant": "all", "fault": ""}]
