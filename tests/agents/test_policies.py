"""What policies do."""

import math

import numpy as np
import pytest
from policies import KINDS, made_up_policy, observations

from agents.policies.networks import Affine, Network, to_arrays


def naive_action(policy, rows):
    """A policy's actions for observations, written out in float64."""
    net = policy.network
    arrays = {name: array.astype(float) for name, array in to_arrays(net).items()}
    x = rows.astype(float).T
    for layer in net.hidden:
        x = arrays[f"{layer.name}.weight"] @ x + arrays[f"{layer.name}.bias"][:, None]
        x = np.tanh(x) if net.activation == "tanh" else np.where(x > 0, x, 0.0)
    return np.clip(arrays["mean.weight"] @ x + arrays["mean.bias"][:, None], -1.0, 1.0).T


@pytest.mark.parametrize("kind", KINDS)
def test_a_policy_is_the_network_it_says_it_is(kind):
    policy = made_up_policy(**KINDS[kind])
    seen = observations(policy, 300)
    actions = []
    for row in seen:
        action, _ = policy.predict(row)
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
    seen = observations(policy, 1000)
    whole, _ = policy.predict(seen)
    for rows in (7, slice(0, 1), slice(7, 8), slice(5, 90), slice(488, 1000), slice(999, 1000)):
        assert np.array_equal(policy.predict(seen[rows])[0], whole[rows])


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
