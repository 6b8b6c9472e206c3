"""Policies: their actions and their files."""

import itertools
import json
import math
import os
import pickle

import numpy as np
import pytest
from episode_runs import assert_identical
from made_up_policies import KINDS, made_up_policy, observations
from refusal import refused

from agents import load_policy, load_setup
from agents.policies import Ensemble, load_ensemble
from agents.policies.networks import to_arrays
from agents.setups import shipped
from agents.train.seeds import median


def actions_by_hand(arrays, activation, rows):
    """Return the actions of a network with the weights `arrays`, row by row, in double precision."""
    arrays, actions = {name: array.astype(float) for name, array in arrays.items()}, []
    for x in rows.astype(float):
        for layer in itertools.takewhile(lambda name: f"{name}.weight" in arrays, map("hidden_{}".format, range(9))):
            x = arrays[f"{layer}.weight"] @ x + arrays[f"{layer}.bias"]
            x = np.tanh(x) if activation == "tanh" else np.maximum(x, 0.0)
        actions.append(np.clip(arrays["mean.weight"] @ x + arrays["mean.bias"], -1.0, 1.0))
    return np.array(actions)


@pytest.fixture
def path(tmp_path):
    return made_up_policy().save(tmp_path / "policy.npz")


def arrays_of(path):
    with np.load(path, allow_pickle=False) as file:
        return dict(file)


def assert_same(first, second):
    assert_identical(to_arrays(first.network), to_arrays(second.network))
    assert (first.provenance, first.environment) == (second.provenance, second.environment)
    assert first.spec.entries == second.spec.entries


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


@pytest.mark.parametrize("name", shipped())
def test_shipped_policy_is_the_median_of_its_seeds(name):
    ensemble, setup = load_ensemble(name), load_setup(name)
    assert sorted(policy.seed for policy in ensemble.policies) == list(range(setup.seeds))
    assert load_policy(name).seed == ensemble.chosen == median(ensemble.policies).seed
    assert_same(load_policy(name, setup.seeds - 1), ensemble[setup.seeds - 1])
    for policy in ensemble.policies:
        assert setup.describes(policy.task)
        assert {"command", "settings", "versions"} <= set(policy.provenance)


def test_predict_adds_noise_with_the_policys_standard_deviation():
    policy, sigma = made_up_policy(log_std=-4.0), math.exp(-4.0)
    seen = observations(policy, 60_000)
    mean = policy.predict(seen)[0]
    inside = np.abs(mean).max(axis=1) < 0.9  # other actions are clipped
    noise = (policy.predict(seen, deterministic=False)[0] - mean)[inside]
    assert len(noise) > 10_000
    assert np.abs(noise.mean(axis=0)).max() < 5.0 * sigma / math.sqrt(len(noise))
    assert np.abs(noise.std(axis=0) - sigma).max() < 5.0 * sigma / math.sqrt(2 * len(noise))
    assert abs(np.corrcoef(noise.T)[0, 1]) < 5.0 / math.sqrt(len(noise))


@pytest.mark.parametrize("kind", KINDS)
def test_ensemble_survives_its_file_bit_for_bit(tmp_path, kind):
    policies = [made_up_policy(seed, **KINDS[kind]) for seed in (3, 1, 4)]
    path = Ensemble(policies, chosen=1).save(tmp_path / "new" / "policy.npz")
    assert [file.name for file in path.parent.iterdir()] == ["policy.npz"]
    assert [policy.seed for policy in load_ensemble(path).policies] == [3, 1, 4]
    assert load_policy(path).seed == 1
    for policy in policies:
        assert_same(load_policy(path, policy.seed), policy)
    assert made_up_policy(**KINDS[kind]).to_bytes() == made_up_policy(**KINDS[kind]).save(path).read_bytes()


class Bomb:
    """When it is unpickled, it runs code that makes a folder."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


def test_load_policy_runs_no_code(path, tmp_path):
    mark, good = tmp_path / "code ran", arrays_of(path)
    for name in good:
        np.savez(path, **{**good, name: np.array([Bomb(mark)], object)})
        refused(lambda: load_policy(path), "pickled objects, which are never loaded")
    assert not mark.exists()
    pickle.loads(pickle.dumps(Bomb(mark)))
    assert mark.exists()


def test_cut_or_altered_policy_is_refused_or_reads_the_same(path):
    policy, whole, rng, refusals = load_policy(path), path.read_bytes(), np.random.default_rng(0), 0
    for length in [*rng.integers(0, len(whole), 15), len(whole) - 1]:
        path.write_bytes(whole[:length])
        refused(lambda: load_policy(path), "policies 3 file, or is damaged")  # Python would warn of a file left open
    for place in rng.choice(len(whole), 120, replace=False):
        altered = bytearray(whole)
        altered[place] ^= int(rng.integers(1, 256))
        path.write_bytes(altered)
        try:
            assert_same(load_policy(path), policy)
        except ValueError:
            refusals += 1
    assert refusals > 60


def test_checksum_of_an_archive_leaves_nothing_out(path):
    arrays, name = arrays_of(path), "0/mean.weight"
    header = json.loads(str(arrays["header"]))
    renamed = {"0/other" if each == name else each: array for each, array in arrays.items()}
    changed = [{name: arrays[name] * 2}, {name: arrays[name].reshape(-1, 2)}, {name: arrays[name].view(np.int32)}]
    for content in ({"chosen": 1}, {"provenance": {"0": {"command": "another"}}}):
        changed.append({"header": np.array(json.dumps(header | {"content": header["content"] | content}))})
    for complete in (renamed, *(arrays | change for change in changed)):
        np.savez(path, **complete)
        refused(lambda: load_policy(path), "its checksum is")
