"""Controllers without learning, evaluation, and the policies that are shipped."""

import math

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, play
from policies import made_up_policy, observations

from agents import baselines, load_policy
from agents.evaluate.stage import TEST_SEED, VALIDATION_SEED, Stage, evaluate
from impact_gym.envs import batch


@pytest.mark.parametrize(("controller", "go", "stop"), [
    (baselines.PaperTrapezoid(), (1.0, 8.0), (0.0, 8.0)),
    (baselines.ConstantSpeed(0.3), (0.3, 8.0), (0.0, 8.0)),
    (baselines.ConstantSpeed(1.5, 20.0, 1.0), (1.5, 20.0), (0.0, 1.0)),
])  # fmt: skip
def test_the_baselines_go_until_the_alarm_and_then_stop(controller, go, stop):
    seen = observations(made_up_policy(), 50)
    seen[:, 3] = np.arange(50) % 2
    low, high = np.array([-0.5, 1.0]), np.array([1.5, 20.0])
    batch, state = controller.predict(seen, state="kept", episode_start=np.zeros(50, bool), deterministic=True)
    assert state == "kept"
    assert batch.dtype == np.float32
    assert batch.shape == (50, 2)
    expected = np.where(seen[:, 3:4] == 1.0, stop, go)
    assert low + 0.5 * (batch.astype(float) + 1.0) * (high - low) == pytest.approx(expected, rel=0, abs=1e-6)
    for row, observation in zip(batch, seen, strict=True):
        action, state = controller.predict(observation)
        assert state is None
        assert action.shape == (2,)
        assert action in gym.make(ID).action_space
        assert np.array_equal(action, row)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"speed": 0.0}, "speed.*above 0.*m/s"),
    ({"speed": 1.6}, "speed.*at most 1.5"),
    ({"speed": 1.0, "acceleration": 0.5}, "acceleration.*at least 1"),
    ({"speed": 1.0, "deceleration": 21.0}, "deceleration.*at most 20"),
    ({"speed": math.nan}, "speed.*finite"),
], ids=str)  # fmt: skip
def test_a_baseline_that_the_environment_cannot_play_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        baselines.ConstantSpeed(**arguments)


@pytest.mark.parametrize("controller", [baselines.PaperTrapezoid(), made_up_policy()])
def test_the_result_for_a_scenario_depends_on_neither_count_nor_neighbours(controller):
    """To the last bit."""
    many, few = evaluate(controller, TEST_SEED, 60), evaluate(controller, TEST_SEED + 41, 7)
    assert all(np.array_equal(values[41:48], few.scenario[name]) for name, values in many.scenario.items())
    for name in ("object_velocity", "approach_time", "peak_force", "contact_count", "missed"):
        assert np.array_equal(getattr(many, name)[41:48], getattr(few, name))
    env = gym.make(ID, scenario="test")
    for row in (0, 41, 59):
        info = play(env, controller, TEST_SEED + row).info
        assert info["scenario"] == {name: values[row] for name, values in many.scenario.items()}
        for name in ("object_velocity", "approach_time", "peak_force"):
            assert info[name] == getattr(many, name)[row]


def test_every_controller_meets_the_same_scenarios_and_other_seeds_others():
    controllers = [baselines.PaperTrapezoid(), baselines.ConstantSpeed(1.5, 20.0), made_up_policy()]
    sets = [evaluate(controller, TEST_SEED, 50).scenario for controller in controllers]
    for scenario in sets[1:]:
        assert all(np.array_equal(scenario[name], sets[0][name]) for name in sets[0])
    validation = evaluate(controllers[0], VALIDATION_SEED, 50).scenario
    assert not np.isin(validation["distance"], sets[0]["distance"]).any()


def test_a_solver_that_fails_is_reported_with_the_seed_of_the_scenario(monkeypatch):
    monkeypatch.setattr(batch, "MAX_STEPS", 10)
    with pytest.raises(RuntimeError, match=f"scenario seeded {TEST_SEED}: .*more integration steps"):
        evaluate(baselines.PaperTrapezoid(), TEST_SEED, 1)


def test_the_cost_of_an_episode_is_minus_its_return():
    episodes = evaluate(baselines.PaperTrapezoid(), TEST_SEED, 20, time_weight=3.0)
    env = gym.make(ID, scenario="test", time_weight=3.0)
    returns = [play(env, baselines.PaperTrapezoid(), TEST_SEED + k).rewards.sum() for k in range(20)]
    assert episodes.cost(3.0) == pytest.approx(-np.array(returns), rel=1e-12)


def test_the_shipped_policy_beats_the_papers_rule_on_both_objectives():
    """On scenarios that training never saw: at most half the object velocity, and no later."""
    policy, paper = load_policy("linear-blind"), baselines.PaperTrapezoid()
    learned, fixed = evaluate(policy, TEST_SEED, 300), evaluate(paper, TEST_SEED, 300)
    assert not learned.missed.any()
    assert learned.object_velocity.mean() <= 0.5 * fixed.object_velocity.mean()
    assert learned.approach_time.mean() <= fixed.approach_time.mean()
    assert policy.inputs == 8
    assert {"command", "settings", "versions"} <= set(policy.provenance)


def test_a_search_takes_a_scenario_in_which_the_solver_fails_as_missed(monkeypatch):
    monkeypatch.setattr(batch, "MAX_STEPS", 40)
    stage = Stage(TEST_SEED, 20, lenient=True)
    played = stage.play(baselines.PaperTrapezoid())
    failed = stage._batch.info()["status"] != "ok"
    assert 0 < failed.sum() < 20
    assert np.array_equal(played.missed, failed)
    assert played.loss(1.0)[failed].min() > 2.0 > played.loss(1.0)[~failed].max()
