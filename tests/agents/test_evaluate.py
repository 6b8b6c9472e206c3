"""Controllers play numbered scenarios: the same for all of them, whatever the other scenarios are."""

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import ID, Always, assert_identical, play
from made_up_policies import made_up_policy

from agents import load_policy, load_setup
from agents.baselines import ConstantSpeed, PaperTrapezoid, load_baseline
from agents.evaluate import play as jobs
from agents.evaluate.scenario_batch import RESULTS, TEST_SEED, TUNING_SEED, VALIDATION_SEED, ScenarioBatch, Validation
from agents.provenance import digest_of
from agents.setups.evaluation import WEIGHTS
from agents.train.ppo import FIRST_SEED
from impact_gym.task import Task, evaluation_sets


@pytest.mark.parametrize("make", [PaperTrapezoid, made_up_policy])
def test_result_of_a_scenario_does_not_depend_on_the_others(make):
    """To the last bit. The seed alone determines the scenario."""
    many, few = (ScenarioBatch(TEST_SEED + k, n).play(make()) for k, n in ((0, 60), (41, 7)))
    other = ScenarioBatch(TEST_SEED, 60).play(ConstantSpeed(1.5, 20.0))
    assert_identical({name: values[41:48] for name, values in other.scenario.items()}, few.scenario)
    for name in RESULTS:
        assert np.array_equal(getattr(many, name)[41:48], getattr(few, name))
    episode = play(gym.make(ID, scenario="test"), make(), TEST_SEED + 41)
    assert few.loss(2.0)[0] == pytest.approx(-episode.rewards.sum(), rel=1e-12)


def test_failed_scenario_is_reported_or_counted_as_missed():
    with pytest.raises(RuntimeError, match=f"scenario with seed {TEST_SEED}: .*more integration steps"):
        ScenarioBatch(TEST_SEED, 1, max_steps=10).play(PaperTrapezoid())
    validation = Validation(Task(), WEIGHTS, scenarios=5, max_steps=10)
    assert validation.score(PaperTrapezoid())["missed"] == [1.0] * len(WEIGHTS)
    result = ScenarioBatch(TEST_SEED, 20, lenient=True, max_steps=40).play(PaperTrapezoid())
    assert 0 < result.missed.sum() < 20
    assert not ScenarioBatch(TEST_SEED, 20).play(PaperTrapezoid()).missed.any()
    assert result.loss(1.0)[result.missed].min() > 2.0 > result.loss(1.0)[~result.missed].max()


class ByWeight(ConstantSpeed):
    def command(self, view):
        velocity, acceleration = super().command(view)
        return velocity * view["time_weight"] ** 0.1, acceleration


@pytest.mark.parametrize("environment", [
    {"range_noise": 0.01}, {"scenario": {"distance": [0.1, 0.3]}, "coupling": {"type": "Bistable"}},
], ids=str)  # fmt: skip
@pytest.mark.parametrize("rule", [ByWeight(0.8, 12.0), Always(0.0, 10.5)])
def test_validation_and_evaluation_play_the_same_scenarios(rule, environment):
    """Validation plays a frozen set at all weights in one batch, evaluation draws from seeds at one weight."""
    rule = rule.for_task(Task(**environment)) if isinstance(rule, ByWeight) else rule
    scores = Validation(Task(**environment), WEIGHTS, scenarios=40).score(rule)
    for place, weight in enumerate(WEIGHTS):
        episodes = ScenarioBatch(VALIDATION_SEED, 40, Task(**environment, time_weight=weight)).play(rule)
        expected = {name: getattr(episodes, name).mean() for name in ("object_velocity", "approach_time", "missed")}
        expected["cost"] = episodes.loss(weight).mean()
        assert {name: scores[name][place] for name in expected} == pytest.approx(expected, rel=1e-12)
    assert scores["score"] == pytest.approx(np.mean(scores["cost"]), rel=1e-12)
    drawn = ScenarioBatch.of("validation", 40, Task(**environment)).play(rule).scenario
    assert np.array_equal(drawn["distance"], episodes.scenario["distance"])


def test_seeds_of_evaluation_tuning_and_training_do_not_overlap():
    sets = [evaluation_sets.load(name) for name in ("validation", "test", "hard")]
    assert [frozen.seed for frozen in sets[:2]] == [VALIDATION_SEED, TEST_SEED]
    assert all(frozen.seed + frozen.count <= TUNING_SEED for frozen in sets)
    assert TUNING_SEED + 1_000_000 <= FIRST_SEED


def test_policy_warns_once_of_the_arguments_that_differ(recwarn):
    """If it plays another environment; not if an argument has the same value, or makes no difference to a policy."""
    policy, elsewhere = load_policy("bistable-blind"), ScenarioBatch(5, 3, Task(coupling={"type": "Bistable"}))
    for _ in range(2):
        elsewhere.play(policy)
    ScenarioBatch(5, 3, load_setup("bistable-blind").task, time_weight=[1.0]).play(policy)
    equal = {"reaction_delay": np.full(2, 0.016), "coupling": {"type": "SpringDamper", "stiffness": 50.0}}
    equal |= {"privileged": True, "time_weight": 1.0, "rtol": 1e-5, "scenario": "hard", "max_episode_steps": 9}
    for change in (equal, {"reaction_delay": [0.01, 0.02], "tool_mass": [0.1, 0.15]}):
        made_up_policy(environment={"range_noise": 0.01}).warn_if_elsewhere(Task(**{"range_noise": 0.01, **change}))
    said = [str(warning.message).partition("differs in ")[2] for warning in recwarn.list]
    assert said == ["coupling", "reaction_delay, tool_mass"]


def test_tuned_profile_keeps_its_positions_in_other_scenarios():
    """Its positions belong to the distances of its own set-up: the distances of a batch must not move them."""
    own = load_setup("linear-wide").environment
    elsewhere = {name: value for name, value in own.items() if name != "scenario"}
    scenarios = {"seed": TEST_SEED, "count": 20, "ranges": own["scenario"]}
    rule = load_baseline("wide-profile", 2.0).for_task(Task(**own))
    expected = ScenarioBatch(TEST_SEED, 20, rule.task).play(rule)
    result = jobs.play({"baseline": "wide-profile"}, scenarios, environment=elsewhere)
    assert np.array_equal(result["object_velocity"][0], expected.object_velocity)


def test_play_takes_sets_tables_and_ranges_alike():
    frozen = evaluation_sets.load("test")
    table = {name: values[:20].tolist() for name, values in frozen.scenario.items()}
    same = [{"set": "test"}, {"table": table, "seed": frozen.seed}, {"ranges": "train", "seed": frozen.seed}]
    first, *rest = (
        jobs.play({"baseline": "paper-trapezoid"}, {**each, "count": 20}, environment={"range_noise": 0.01})
        for each in same
    )
    assert_identical([first, first], rest)


def test_digest_changes_with_any_source_of_the_module(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    inner = tmp_path / "package_of_jobs" / "inner"
    inner.mkdir(parents=True)
    (inner.parent / "__init__.py").touch()
    names, found = ("package_of_jobs", "package_of_jobs.inner"), []
    for file, text in (("__init__.py", "ONE = 1"), ("__init__.py", "ONE = 2"), ("it.json", "[]"), ("it.json", "{}")):
        (inner / file).write_text(text)
        found.append([digest_of(name) for name in names])
        assert found[-1] == [digest_of(name) for name in names]
    assert len({each[0] for each in found}) == len({each[1] for each in found}) == len(found)
