"""Policies: their actions and their files. Controllers play numbered scenarios, the same for all of them."""

import itertools
import json

import numpy as np
import pytest
from episode_runs import assert_identical
from made_up_policies import KINDS, made_up_policy, observations
from refusal import refused

from agents import load_policy, load_setup
from agents.baselines import PaperTrapezoid
from agents.evaluate.scenario_batch import TEST_SEED, TUNING_SEED, VALIDATION_SEED, ScenarioBatch, Validation
from agents.policies import Ensemble, load_ensemble
from agents.policies.networks import to_arrays
from agents.setups import trained
from agents.setups.evaluation import WEIGHTS
from agents.train.ppo import FIRST_SEED
from agents.train.seeds import median
from impact_gym.support.provenance import digest_of
from impact_gym.task import Task, evaluation_sets


def actions_by_hand(arrays, activation, rows):
    """Return the actions of a network with the weights `arrays`, row by row, in double precision."""
    arrays, actions = {name: array.astype(float) for name, array in arrays.items()}, []
    for x in rows.astype(float):
        for layer in itertools.takewhile(lambda name: f"{name}.weight" in arrays, map("hidden_{}".format, range(9))):
            x = arrays[f"{layer}.weight"] @ x + arrays[f"{layer}.bias"]
            x = np.tanh(x) if activation == "tanh" else np.maximum(x, 0.0)
        actions.append(np.clip(arrays["mean.weight"] @ x + arrays["mean.bias"], -1.0, 1.0))
    return np.array(actions)


def assert_same(first, second):
    assert_identical(to_arrays(first.network), to_arrays(second.network))
    assert (first.provenance, first.environment) == (second.provenance, second.environment)


@pytest.mark.parametrize("kind", KINDS)
def test_predict_computes_the_network_row_by_row(kind):
    """An action has the same bits whatever the other rows are."""
    policy = made_up_policy(**KINDS[kind])
    seen = observations(policy, 600)
    actions, state = policy.predict(seen, state="kept")
    assert (actions.dtype, actions.shape, state) == (np.float32, (600, 2), "kept")
    expected = actions_by_hand(to_arrays(policy.network), policy.network.activation, seen)
    assert actions == pytest.approx(expected, rel=0, abs=2e-6)
    assert np.mean(np.abs(actions) < 0.999) > 0.05
    for rows in (7, slice(0, 1), slice(7, 8), slice(5, 90), slice(488, 600), slice(599, 600)):
        assert np.array_equal(policy.predict(seen[rows])[0], actions[rows])


@pytest.mark.parametrize("name", trained())
def test_shipped_policy_is_the_median_of_its_seeds(name):
    ensemble, setup = load_ensemble(name), load_setup(name)
    assert sorted(policy.seed for policy in ensemble.policies) == list(range(setup.seeds))
    assert load_policy(name).seed == ensemble.chosen == median(ensemble.policies).seed
    assert_same(load_policy(name, setup.seeds - 1), ensemble[setup.seeds - 1])
    for policy in ensemble.policies:
        assert setup.describes(policy.task)
        assert {"command", "settings", "versions"} <= set(policy.provenance)


def test_predict_adds_noise_with_the_policys_standard_deviation():
    policy, sigma = made_up_policy(log_std=-4.0), np.exp(-4.0)
    seen = observations(policy, 60_000)
    mean = policy.predict(seen)[0]
    inside = np.abs(mean).max(axis=1) < 0.9  # other actions are clipped
    noise = (policy.predict(seen, deterministic=False)[0] - mean)[inside]
    assert len(noise) > 10_000
    assert np.abs(noise.mean(axis=0)).max() < 5.0 * sigma / np.sqrt(len(noise))
    assert np.abs(noise.std(axis=0) - sigma).max() < 5.0 * sigma / np.sqrt(2 * len(noise))
    assert abs(np.corrcoef(noise.T)[0, 1]) < 5.0 / np.sqrt(len(noise))


@pytest.mark.parametrize("kind", KINDS)
def test_ensemble_survives_its_file_bit_for_bit(tmp_path, kind):
    policies = [made_up_policy(seed, **KINDS[kind]) for seed in (3, 1, 4)]
    path = Ensemble(policies, chosen=1).save(tmp_path / "new" / "policy.npz")
    assert load_policy(path).seed == 1
    for policy in policies:
        assert_same(load_policy(path, policy.seed), policy)
    assert made_up_policy(**KINDS[kind]).to_bytes() == made_up_policy(**KINDS[kind]).save(path).read_bytes()


def test_cut_or_altered_policy_is_refused_or_reads_the_same(tmp_path):
    policy, path, rng, refusals = made_up_policy(), tmp_path / "policy.npz", np.random.default_rng(0), 0
    whole = policy.to_bytes()
    for place in rng.choice(len(whole), 120, replace=False):
        path.write_bytes(whole[:place])
        refused(lambda: load_policy(path), "policies 3 file, or is damaged")  # Python would warn of a file left open
        path.write_bytes(whole[:place] + bytes([whole[place] ^ int(rng.integers(1, 256))]) + whole[place + 1 :])
        try:
            assert_same(load_policy(path), policy)
        except ValueError:
            refusals += 1
    assert refusals > 60


def test_archive_with_another_content_or_a_pickle_is_refused(tmp_path):
    """Reading a pickle can run code of the file."""
    with np.load(path := made_up_policy().save(tmp_path / "policy.npz")) as file:
        arrays, name = dict(file), "0/mean.weight"
    header = json.loads(str(arrays["header"]))
    renamed = {"0/other" if each == name else each: array for each, array in arrays.items()}
    changed = [{name: arrays[name] * 2}, {name: arrays[name].reshape(-1, 2)}, {name: arrays[name].view(np.int32)}]
    for content in ({"chosen": 1}, {"provenance": {"0": {"command": "another"}}}):
        changed.append({"header": np.array(json.dumps(header | {"content": header["content"] | content}))})
    for complete in (renamed, *(arrays | change for change in changed)):
        np.savez(path, **complete)
        refused(lambda: load_policy(path), "its checksum is")
    for name in arrays:
        np.savez(path, **arrays | {name: np.array([None])})
        refused(lambda: load_policy(path), "pickled objects, which are never loaded")


def test_failed_scenario_is_reported_or_counted_as_missed():
    with pytest.raises(RuntimeError, match=f"scenario with seed {TEST_SEED}: .*more integration steps"):
        ScenarioBatch(TEST_SEED, 1, max_steps=10).play(PaperTrapezoid())
    validation = Validation(Task(), WEIGHTS, scenarios=5, max_steps=10)
    assert validation.score(PaperTrapezoid())["missed"] == [1.0] * len(WEIGHTS)
    result = ScenarioBatch(TEST_SEED, 20, lenient=True, max_steps=40).play(PaperTrapezoid())
    assert 0 < result.missed.sum() < 20
    assert not ScenarioBatch(TEST_SEED, 20).play(PaperTrapezoid()).missed.any()
    assert result.loss(1.0)[result.missed].min() > 2.0 > result.loss(1.0)[~result.missed].max()


@pytest.mark.parametrize(("seed", "environment"), [
    (8, {"range_noise": 0.01}), (1, {"scenario": {"distance": [0.1, 0.3]}, "coupling": {"type": "Bistable"}}),
], ids=str)  # fmt: skip
def test_validation_and_evaluation_play_the_same_scenarios(seed, environment):
    """Validation plays a frozen set at all weights in one batch, evaluation draws from seeds at one weight."""
    policy = made_up_policy(seed, environment)
    scores = Validation(Task(**environment), WEIGHTS, scenarios=40).score(policy)
    for place, weight in enumerate(WEIGHTS):
        episodes = ScenarioBatch(VALIDATION_SEED, 40, Task(**environment, time_weight=weight)).play(policy)
        expected = {name: getattr(episodes, name).mean() for name in ("object_velocity", "approach_time", "missed")}
        costs = episodes.object_velocity + weight * episodes.approach_time + 2.0 * episodes.missed
        expected["cost"] = costs.mean()
        assert episodes.loss(weight) == pytest.approx(costs, rel=1e-12)
        assert {name: scores[name][place] for name in expected} == pytest.approx(expected, rel=1e-12)
    assert 0.0 < np.mean(scores["missed"]) < 1.0
    assert scores["score"] == pytest.approx(np.mean(scores["cost"]), rel=1e-12)


def test_seeds_of_evaluation_tuning_and_training_do_not_overlap():
    sets = [evaluation_sets.load(name) for name in ("validation", "test", "hard")]
    assert [frozen.seed for frozen in sets[:2]] == [VALIDATION_SEED, TEST_SEED]
    assert all(frozen.seed + frozen.count <= TUNING_SEED for frozen in sets)
    assert TUNING_SEED + 1_000_000 <= FIRST_SEED


def test_policy_warns_once_of_the_arguments_that_differ(recwarn):
    """Not if an argument has the same value, or makes no difference to a policy."""
    policy, elsewhere = load_policy("bistable-blind"), ScenarioBatch(5, 3, Task(coupling={"type": "Bistable"}))
    for _ in range(2):
        elsewhere.play(policy)
    equal = {"reaction_delay": np.full(2, 0.016), "coupling": {"type": "SpringDamper", "stiffness": 50.0}}
    equal |= {"privileged": True, "time_weight": 1.0, "rtol": 1e-5, "scenario": "hard", "max_episode_steps": 9}
    for change in (equal, {"reaction_delay": [0.01, 0.02], "tool_mass": [0.1, 0.15]}):
        made_up_policy(environment={"range_noise": 0.01}).warn_if_elsewhere(Task(**{"range_noise": 0.01, **change}))
    said = [str(warning.message).partition("differs in ")[2] for warning in recwarn.list]
    assert said == ["coupling", "reaction_delay, tool_mass"]


def test_digest_changes_with_any_source_of_the_module(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "package_of_jobs" / "inner").mkdir(parents=True)
    found = []
    for file, text in (("__init__.py", "ONE = 1"), ("__init__.py", "ONE = 2"), ("it.json", "[]"), ("it.json", "{}")):
        (tmp_path / "package_of_jobs" / "__init__.py").touch()
        (tmp_path / "package_of_jobs" / "inner" / file).write_text(text)
        found += [digest_of("package_of_jobs"), digest_of("package_of_jobs.inner")]
        assert digest_of("package_of_jobs") == found[-2]
    assert len({*found}) == 8
