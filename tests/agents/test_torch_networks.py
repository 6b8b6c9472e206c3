"""What the networks of a training add to those of stable-baselines3."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from policies import made_up_policy, observations
from training import tiny

from agents.train.closed_form import Tanh
from agents.train.ppo import (
    CENTRE_AND_SPREAD,
    Standardised,
    centres_and_spreads,
    entry_names,
    fold_in_standardisation,
    make_environment,
    make_model,
    policy_from,
)
from impact_gym.sb3 import ImpactVecEnv


def test_tanh_is_the_one_of_torch_with_its_gradient():
    values = torch.cat((torch.linspace(-12.0, 12.0, 4001), torch.tensor([-1e4, -0.0, 0.0, 1e4]))).requires_grad_()
    there = values.detach().clone().requires_grad_()
    weights = torch.linspace(1.0, 2.0, len(values))
    ours, theirs = Tanh()(values), torch.tanh(there)
    (ours * weights).sum().backward()
    (theirs * weights).sum().backward()
    assert ours.detach().numpy() == pytest.approx(theirs.detach().numpy(), rel=0, abs=3e-7)
    assert values.grad.numpy() == pytest.approx(there.grad.numpy(), rel=0, abs=1e-6)
    assert torch.autograd.gradcheck(Tanh(), torch.linspace(-2.0, 2.0, 9, dtype=torch.float64, requires_grad=True))


def test_networks_see_entries_of_about_unit_size():
    """While a policy of random commands plays; what is rare or one-sided may be far from it."""
    envs = ImpactVecEnv(256, privileged=True, range_noise=0.01, time_weight=(0.5, 8.0))
    names = entry_names({"privileged": True, "range_noise": 0.01})
    assert set(names) - set(CENTRE_AND_SPREAD) == {"reaction_delay".replace("_", " ")}  # which is fixed in training
    envs.seed(0)
    seen, rng = [envs.reset()], np.random.default_rng(0)
    for _ in range(120):
        command = np.stack((rng.normal(0.2, 0.4, 256), rng.uniform(-1.0, 1.0, 256)), axis=1)
        seen.append(envs.step(command.clip(-1.0, 1.0).astype(np.float32))[0])
    layer = Standardised(envs.observation_space, names)
    standard = layer(torch.as_tensor(np.concatenate(seen))).numpy()[:, [name in CENTRE_AND_SPREAD for name in names]]
    assert np.abs(standard.mean(axis=0)).max() < 1.5
    assert standard.std(axis=0).min() > 0.2
    assert standard.std(axis=0).max() < 3.0


def test_a_layer_behind_the_standard_is_the_same_layer():
    policy = made_up_policy(environment={"range_noise": 0.01})
    layer, names, seen = policy.network.hidden[0], entry_names(policy.environment), observations(policy)
    centre, spread = np.array(centres_and_spreads(names))
    expected = (seen - centre) / spread @ layer.weight.T + layer.bias
    assert fold_in_standardisation(layer, names)(seen) == pytest.approx(expected, rel=0, abs=2e-5)


@pytest.mark.parametrize("setup", ["linear-blind", "linear-ranged"])
def test_what_acts_does_not_see_the_scenario_and_what_judges_does(setup):
    settings = tiny(setup=setup)
    model = make_model(settings, make_environment(settings))
    count = len(entry_names(settings.environment))
    seen = torch.as_tensor(model.env.reset())
    assert seen.shape[1] == count + 5
    other = seen.clone()
    other[:, count:] += 0.3
    network = model.policy
    means = [network.get_distribution(one).distribution.mean for one in (seen, other)]
    assert torch.equal(*means)
    assert (network.predict_values(seen) != network.predict_values(other)).all()
    actions, values, _ = network(seen, deterministic=True)
    assert torch.equal(values, network.predict_values(seen))
    acting = policy_from(model, settings, {})
    assert acting.inputs == count
    assert acting.predict(seen[:, :count].numpy())[0] == pytest.approx(actions.detach().numpy(), rel=0, abs=2e-6)


def test_a_training_may_solve_its_contacts_less_exactly_than_validation():
    blunt = tiny(rtol=1e-4)
    assert (blunt.training_environment["rtol"], "rtol" in blunt.environment) == (1e-4, False)
    finals = []
    for settings in (tiny(), blunt):
        envs = make_environment(settings)
        envs.seed(7)
        envs.reset()
        infos = [envs.step(np.ones((envs.num_envs, 2), np.float32))[3] for _ in range(40)]
        finals.append([info["object_velocity"] for step in infos for info in step if "object_velocity" in info])
    errors = np.abs(np.subtract(*finals))
    assert 0.0 < errors.max() < 1e-4


def test_without_an_informed_critic_training_shows_nothing_hidden():
    settings = replace(tiny(), informed_critic=False)
    assert make_environment(settings).observation_space.shape == (8,)
