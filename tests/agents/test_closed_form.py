"""PPO with its gradient written out is PPO of stable-baselines3, which lets torch find the gradient."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.policies import ActorCriticPolicy
from training import TINY

from agents.train.closed_form import ClosedFormPPO
from agents.train.ppo import make_environment, make_model

pytestmark = pytest.mark.usefixtures("one_thread")


def model_of(settings):
    environment = make_environment(settings)
    environment.seed(3)
    model = make_model(settings, environment)
    model.set_logger(Logger(None, []))
    return model


def updated(settings, train):
    """Train for two rollouts, then let `train` update once more by the second one, of which some samples are clipped.

    Return parameters before and after it, its last gradients, and what is logged.
    """
    model = model_of(settings)
    model.learn(2 * settings.round, log_interval=None)
    before = {name: value.detach().clone() for name, value in model.policy.named_parameters()}
    np.random.seed(5)  # noqa: NPY002 - stable-baselines3 draws batches from it
    train(model)
    after = dict(model.policy.named_parameters())
    return before, after, {name: value.grad for name, value in after.items()}, model.logger.name_to_value


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch")
@pytest.mark.parametrize("changes", [
    {},
    {"informed_critic": False},
    {"entropy": 0.1},
    {"clip": 0.01, "epochs": 6},
    {"gae_lambda": 0.9},
    {"activation": "relu"},
    {"activation": "relu", "depth": 3, "informed_critic": False},
    {"depth": 1, "width": 5},
    {"batch": 100},  # the last batch of an epoch is smaller
    {"batch": 255},  # it is one sample
    {"setup": "linear-ranged"},
], ids=str)  # fmt: skip
def test_an_update_is_that_of_stable_baselines3(changes):
    settings = replace(TINY, learning_rate=3e-3, final_rate=1.0, **changes)
    before, parameters, gradients, log = updated(settings, ClosedFormPPO.train)
    _, their_parameters, their_gradients, their_log = updated(settings, PPO.train)
    assert parameters.keys() == their_parameters.keys()
    for name, theirs in their_parameters.items():
        assert torch.dist(gradients[name], their_gradients[name]) < 1e-5 * their_gradients[name].norm(), name
        rounding = torch.finfo(theirs.dtype).eps * theirs.norm()
        assert torch.dist(parameters[name], theirs) < 1e-5 * torch.dist(theirs, before[name]) + rounding, name
    assert log.keys() == their_log.keys()
    assert [log[name] for name in log] == pytest.approx([their_log[name] for name in log], rel=1e-4, abs=1e-7)
    assert 0.0 < log["train/clip_fraction"] < 1.0


@pytest.mark.parametrize("deterministic", [False, True])
def test_actions_and_their_densities_are_those_of_stable_baselines3(deterministic):
    """With the same random numbers."""
    model = model_of(TINY)
    seen = torch.as_tensor(model.env.reset())
    with torch.no_grad():
        model.policy.log_std.copy_(torch.tensor([-1.0, 0.3]))
        torch.manual_seed(1)
        ours = model.policy(seen, deterministic)
        torch.manual_seed(1)
        theirs = ActorCriticPolicy.forward(model.policy, seen, deterministic)
    for one, other in zip(ours, theirs, strict=True):
        assert one.shape == other.shape
        assert one.numpy() == pytest.approx(other.numpy(), rel=1e-6, abs=1e-6)
