"""Networks of a training: an actor, and a critic that may also observe the true scenario.

A critic that observes mass and distance of the object reduces the variance of the policy gradient (Pinto et al. 2018,
asymmetric actor critic).
"""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, MlpExtractor

from impact_gym.task import ObservationSpec, Task

CENTRE_AND_SPREAD = {
    "position": (-0.1, 0.3),
    "velocity": (0.4, 0.45),
    "time": (-0.7, 0.2),
    "alarm": (0.35, 0.5),
    "time_since_alarm": (0.2, 0.3),
    "force": (0.05, 0.1),
    "force_peak": (0.15, 0.25),
    "time_weight": (0.0, 0.3),
    "distance_estimate": (0.05, 0.1),  # small spread, so that the networks notice an estimation error of 10 mm
    "range_noise": (0.3, 0.2),
    "deflection": (0.0, 0.2),
    "object_mass": (0.15, 0.3),
    "contact_stiffness": (-0.4, 0.35),
    "restitution": (0.55, 0.25),
    "distance": (0.1, 0.3),
}
"""Approximate centre and spread of the observed (scaled) numbers during a training. Without standardisation, numbers
that vary little would influence the networks only late in the training."""


def standardisation(tasks: Sequence[Task]) -> NDArray[np.float64]:
    """Return centre and spread of each observed number, (2, n_obs); all `tasks` observe the same quantities.

    Numbers in CENTRE_AND_SPREAD have the values there. If another number is drawn from a range, its centre is the mean
    of the range, and its spread is the standard deviation. All others have the centre 0 and the spread 1.
    """
    spec, pairs = ObservationSpec.of_rows(tasks), []
    drawn = {name: pair for task in reversed(tasks) for name, pair in task.ranges.items() if pair[0] < pair[1]}
    for name in spec.ids:
        newest = re.sub(r"_\d$", "", name)  # a past reading has the centre and spread of the newest one
        if newest in CENTRE_AND_SPREAD:
            pairs.append(CENTRE_AND_SPREAD[newest])
        elif name in drawn:
            low, high = spec.encode(name, drawn[name])
            pairs.append((0.5 * (low + high), max(high - low, 1e-3) / np.sqrt(12.0)))
        else:
            pairs.append((0.0, 1.0))
    return np.array(pairs).T


class Standardised(BaseFeaturesExtractor):
    """A layer that standardises each number: (observation - centre) / spread."""

    centre: torch.Tensor  # (n_obs,)
    spread: torch.Tensor  # (n_obs,)

    def __init__(self, observation_space: spaces.Space[Any], tasks: Sequence[Task]) -> None:
        """Make a layer; all `tasks` observe the same quantities."""
        centre, spread = torch.tensor(standardisation(tasks), dtype=torch.float32)
        super().__init__(observation_space, len(centre))
        self.register_buffer("centre", centre)
        self.register_buffer("spread", spread)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the standardised observations."""
        return (observations - self.centre) / self.spread


class AsymmetricPolicy(ActorCriticPolicy):
    """A policy of stable-baselines3 whose critic may observe more than the actor."""

    def __init__(self, *arguments: Any, actor_inputs: int, **options: Any) -> None:
        """Make a policy; the actor observes the first `actor_inputs` numbers, the critic all numbers."""
        self.actor_inputs = actor_inputs
        super().__init__(*arguments, **options)

    def _build_mlp_extractor(self) -> None:  # documented by stable-baselines3 2.9 for custom networks
        layers: Any = self.net_arch
        actor: Any = MlpExtractor(self.actor_inputs, {"pi": layers, "vf": []}, self.activation_fn, "cpu")
        critic = MlpExtractor(self.features_dim, {"pi": [], "vf": layers}, self.activation_fn, "cpu")
        actor.value_net, actor.latent_dim_vf = critic.value_net, critic.latent_dim_vf
        actor.forward_actor = lambda features: actor.policy_net(features[:, : self.actor_inputs])
        self.mlp_extractor = actor


class FastTanh(torch.nn.Module):
    """tanh by NumPy: equal to torch.nn.Tanh within rounding, and on some machines eight times as fast."""

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        """Return tanh of `values`."""
        return _NumpyTanh.apply(values)  # type: ignore[no-untyped-call]  # torch declares no types here


class _NumpyTanh(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: torch.Tensor) -> torch.Tensor:
        result = torch.from_numpy(np.tanh(values.detach().numpy()))
        ctx.save_for_backward(result)
        return result

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> torch.Tensor:
        (result,) = ctx.saved_tensors
        return torch.ops.aten.tanh_backward(gradients[0], result)


ACTIVATIONS: dict[str, type[torch.nn.Module]] = {"tanh": FastTanh, "relu": torch.nn.ReLU}
