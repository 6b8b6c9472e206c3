"""What policies do."""

import math

import numpy as np
import pytest
from policies import KINDS, made_up_policy, observations

from agents.policies.networks import Affine, Network, to_arrays


def sigmoid(x):
    return 1.0 / (1.0 + np.exp(-x))


def naive_action(policy, rows):
    """A policy's actions for observations that follow one another, written out in float64, and its state."""
    net = policy.network
    arrays = {name: array.astype(float) for name, array in to_arrays(net).items()}
    h, c = np.zeros(net.width), np.zeros(net.width)
    actions = []
    for row in rows.astype(float):
        x = row
        if net.gates:
            i, f, g, o = (arrays["gates.weight"] @ np.append(row, h) + arrays["gates.bias"]).reshape(4, -1)
            c = sigmoid(f) * c + sigmoid(i) * np.tanh(g)
            h = sigmoid(o) * np.tanh(c)
            x = h
        for layer in net.hidden:
            x = arrays[f"{layer.name}.weight"] @ x + arrays[f"{layer.name}.bias"]
            x = np.tanh(x) if net.activation == "tanh" else np.where(x > 0, x, 0.0)
        x = arrays["mean.weight"] @ x + arrays["mean.bias"]
        actions.append(np.tanh(x) if net.squash else np.clip(x, -1.0, 1.0))
    return np.array(actions)


@pytest.mark.parametrize("kind", KINDS)
def test_a_policy_is_the_network_it_says_it_is(kind):
    policy = made_up_policy(**KINDS[kind])
    seen = observations(policy, 300)
    actions, state = [], None
    for row in seen:
        action, state = policy.predict(row, state=state)
        actions.append(action)
        assert action.dtype == np.float32
        assert action.shape == (2,)
    assert np.array(actions) == pytest.approx(naive_action(policy, seen), rel=0, abs=2e-6)
    assert np.mean(np.abs(actions) < 0.999) > 0.05
    with pytest.raises(ValueError, match=f"{policy.inputs} numbers.*7"):
        policy.predict(np.zeros(7, np.float32))
    with pytest.raises(ValueError, match="finite"):
        policy.predict(np.full(policy.inputs, np.nan, np.float32))


@pytest.mark.parametrize("kind", KINDS)
def test_an_action_has_the_same_bits_whatever_stands_beside_it(kind):
    policy = made_up_policy(**KINDS[kind])
    seen = np.stack([observations(policy, 1000, seed) for seed in range(3)])
    whole, state = [], None
    for step in seen:
        action, state = policy.predict(step, state=state)
        whole.append(action)
    for rows in (7, slice(0, 1), slice(7, 8), slice(5, 90), slice(488, 1000), slice(999, 1000)):
        state = None
        for step, actions in zip(seen, whole, strict=True):
            action, state = policy.predict(step[rows], state=state)
            assert np.array_equal(action, actions[rows])


def test_a_recurrent_policy_forgets_where_an_episode_starts():
    policy = made_up_policy(cells=10)
    first, second = observations(policy, 4), observations(policy, 4, seed=2)
    _, state = policy.predict(first)
    fresh, _ = policy.predict(second)
    start = np.array([True, False, True, False])
    mixed, _ = policy.predict(second, state=state, episode_start=start)
    assert np.array_equal(mixed[start], fresh[start])
    assert not np.any(np.all(mixed[~start] == fresh[~start], axis=1))
    assert np.array_equal(policy.predict(second, state=state, episode_start=np.ones(4, bool))[0], fresh)
    _, one = policy.predict(first[0])
    assert np.array_equal(policy.predict(second[0], state=one, episode_start=True)[0], fresh[0])
    assert np.array_equal(policy.predict(second[0], state=one, episode_start=np.array([True]))[0], fresh[0])


def test_a_policy_without_memory_hands_the_state_through():
    policy = made_up_policy()
    assert policy.predict(observations(policy, 3), state="kept")[1] == "kept"


def test_the_noise_of_a_policy_has_the_standard_deviation_it_says():
    policy = made_up_policy(log_std=-4.0)
    policy.network.mean.bias[:] = 0.0
    mean = Affine("mean", policy.network.mean.weight * 0.0, policy.network.mean.bias)
    policy.network = Network(policy.network.hidden, mean, policy.network.log_std)
    noise = policy.predict(observations(policy, 20_000), deterministic=False)[0]
    sigma = math.exp(-4.0)
    assert np.abs(noise.mean(axis=0)).max() < 5.0 * sigma / math.sqrt(20_000)
    assert np.abs(noise.std(axis=0) - sigma).max() < 5.0 * sigma / math.sqrt(40_000)
    assert abs(np.corrcoef(noise.T)[0, 1]) < 5.0 / math.sqrt(20_000)
