"""PPO with its gradient written out: it learns what stable-baselines3's own learns, to rounding, in half the time.

The networks are small: what their arithmetic takes is little beside autograd, objects for distributions, and the
gathering of each batch of samples from NumPy.
"""

import math
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import MlpExtractor
from stable_baselines3.common.utils import explained_variance

LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)


class _FastTanh(torch.autograd.Function):
    """NumPy's tanh is eight times as fast as torch's, which takes a path of MKL that is slow on some processors."""

    @staticmethod
    def forward(ctx: Any, values: torch.Tensor) -> torch.Tensor:
        """Return tanh of `values`."""
        result = torch.from_numpy(np.tanh(values.detach().numpy()))
        ctx.save_for_backward(result)
        return result

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> torch.Tensor:
        """Return the gradient with respect to the values."""
        (result,) = ctx.saved_tensors
        return torch.ops.aten.tanh_backward(gradients[0], result)


class Tanh(torch.nn.Module):
    """As torch.nn.Tanh, to rounding."""

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        """Return tanh of `values`."""
        return _FastTanh.apply(values)


SLOPES = {
    Tanh: torch.ops.aten.tanh_backward,
    torch.nn.ReLU: lambda gradient, result: torch.ops.aten.threshold_backward(gradient, result, 0.0),
}
"""From the gradient with respect to the result of an activation, and the result, that with respect to its input."""


class ActorAndCritic(ActorCriticPolicy):
    """A policy whose critic may see more than its actor: the scenario, so that luck is not taken for skill.

    The advantage of an action has the same mean with any critic that does not see the action, and less variance with
    one that knows the mass and the distance of the object (Pinto et al. 2018, asymmetric actor critic).
    """

    def __init__(self, *arguments: Any, seen: int, **options: Any) -> None:
        """Make one whose actor sees the first `seen` entries, and whose critic sees all."""
        self.seen = seen
        super().__init__(*arguments, **options)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = _TwoViews(self.features_dim, self.seen, self.net_arch, self.activation_fn)

    def forward(
        self, obs: torch.Tensor, deterministic: bool = False
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return actions (n, 2) for `obs` (n, entries), values (n, 1), and logarithms of the actions' density (n,)."""
        actor, critic = self.mlp_extractor(self.features_extractor(obs))
        mean = self.action_net(actor)
        noise = torch.zeros_like(mean) if deterministic else torch.randn_like(mean)
        return mean + self.log_std.exp() * noise, self.value_net(critic), self.log_density(noise)[:, 0]

    def log_density(self, noise: torch.Tensor) -> torch.Tensor:
        """Return the logarithm of the density (n, 1) of actions that are `noise` (n, 2) standard deviations off."""
        return -(0.5 * noise.square() + self.log_std + LOG_SQRT_2PI).sum(1, keepdim=True)


class _TwoViews(MlpExtractor):
    """An actor that sees the first `seen` features, and a critic that sees all."""

    def __init__(self, features: int, seen: int, layers: list[int], activation: type[torch.nn.Module]) -> None:
        super().__init__(seen, {"pi": layers, "vf": []}, activation, "cpu")
        critic = MlpExtractor(features, {"pi": [], "vf": layers}, activation, "cpu")
        self._seen, self.value_net, self.latent_dim_vf = seen, critic.value_net, critic.latent_dim_vf

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """Return what the action is read from."""
        return self.policy_net(features[:, : self._seen])


class Layers:
    """An actor or a critic, forwards and backwards."""

    def __init__(self, hidden: torch.nn.Sequential, head: torch.nn.Linear) -> None:
        self._layers = [*hidden[::2], head]
        self._activation = hidden[1]
        self._inputs: list[torch.Tensor] = []  # of each layer

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Return what the head makes of `features` (n, entries)."""
        *hidden, head = self._layers
        self._inputs = [features]
        for layer in hidden:
            self._inputs.append(self._activation(layer(self._inputs[-1])))
        return head(self._inputs[-1])

    def backward(self, gradient: torch.Tensor) -> None:
        """Give each parameter its gradient from that with respect to what `forward` returned."""
        for place in reversed(range(len(self._layers))):
            layer, inputs = self._layers[place], self._inputs[place]
            layer.weight.grad = gradient.T @ inputs
            layer.bias.grad = gradient.sum(0)
            if place:
                gradient = SLOPES[type(self._activation)](gradient @ layer.weight, inputs)


class ClosedFormPPO(PPO):
    """PPO for an `ActorAndCritic`; what it logs is called as in stable-baselines3."""

    policy: ActorAndCritic

    @torch.no_grad()
    def train(self) -> None:
        """Update the policy with the rollout that was collected."""
        policy, buffer, hidden = self.policy, self.rollout_buffer, self.policy.mlp_extractor
        self._update_learning_rate(policy.optimizer)
        actor, critic = Layers(hidden.policy_net, policy.action_net), Layers(hidden.value_net, policy.value_net)
        arrays = (buffer.observations, buffer.actions, buffer.log_probs, buffer.advantages, buffer.returns)
        columns = [torch.from_numpy(buffer.swap_and_flatten(array)) for array in arrays]
        columns[0] = policy.features_extractor(columns[0])
        parameters = [*policy.parameters()]
        terms: list[list[dict[str, torch.Tensor]]] = []
        for _ in range(self.n_epochs):
            terms.append([])
            order = torch.from_numpy(np.random.permutation(len(columns[0])))  # noqa: NPY002 - as stable-baselines3 draws it
            shuffled = (column.index_select(0, order).split(self.batch_size) for column in columns)
            for features, *rest in zip(*shuffled, strict=True):
                outputs = actor.forward(features[:, : policy.seen]), critic.forward(features)
                by_mean, by_log_std, by_values, said = self._derivatives(*outputs, *rest)
                actor.backward(by_mean)
                critic.backward(by_values)
                policy.log_std.grad = by_log_std
                torch.nn.utils.clip_grad_norm_(parameters, self.max_grad_norm)
                policy.optimizer.step()
                terms[-1].append(said)
            self._n_updates += 1
        self._log(terms)

    def _derivatives(
        self,
        mean: torch.Tensor,
        values: torch.Tensor,
        actions: torch.Tensor,
        old_log_density: torch.Tensor,
        advantages: torch.Tensor,
        returns: torch.Tensor,
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, dict[str, torch.Tensor]]:
        """Return the derivatives of the loss by the mean action (n, 2), by log_std (2,) and by the values (n, 1).

        Then what is to be logged. The loss is that of Schulman et al. 2017, eq. 9, the other way round. Of the actions
        (n, 2) and the columns (n, 1) that the rollout left, one sample has nothing to be standardised by.
        """
        count, clip, spread = len(mean), self.clip_range(self._current_progress_remaining), self.policy.log_std.exp()
        if count > 1:
            advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        noise, error = (actions - mean) / spread, values - returns
        log_ratio = self.policy.log_density(noise) - old_log_density
        ratio = log_ratio.exp()
        gain, clipped = advantages * ratio, advantages * ratio.clamp(1.0 - clip, 1.0 + clip)
        by_log_density = torch.where(gain <= clipped, gain, 0.0) / -count  # a clipped gain is the same for all policies
        by_log_std = (by_log_density * (noise.square() - 1.0)).sum(0) - self.ent_coef
        return (
            by_log_density * noise / spread,
            by_log_std,
            2.0 * self.vf_coef / count * error,
            {
                "entropy_loss": -(self.policy.log_std + LOG_SQRT_2PI + 0.5).sum(),
                "policy_gradient_loss": -torch.minimum(gain, clipped).mean(),
                "value_loss": error.square().mean(),
                "approx_kl": (ratio - 1.0 - log_ratio).mean(),
                "clip_fraction": ((ratio - 1.0).abs() > clip).float().mean(),
            },
        )

    def _log(self, terms: list[list[dict[str, torch.Tensor]]]) -> None:
        """Log means over all batches of all epochs; as stable-baselines3 does, the divergence over the last epoch."""
        for name in terms[0][0]:
            epochs = terms[-1:] if name == "approx_kl" else terms
            self.logger.record(f"train/{name}", float(np.mean([said[name] for epoch in epochs for said in epoch])))
        last = terms[-1][-1]
        loss = last["policy_gradient_loss"] + self.ent_coef * last["entropy_loss"] + self.vf_coef * last["value_loss"]
        self.logger.record("train/loss", loss.item())
        values, returns = self.rollout_buffer.values.flatten(), self.rollout_buffer.returns.flatten()
        self.logger.record("train/explained_variance", explained_variance(values, returns))
        self.logger.record("train/std", self.policy.log_std.exp().mean().item())
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/clip_range", self.clip_range(self._current_progress_remaining))

    def _update_info_buffer(self, infos: list[dict[str, Any]], dones: Any = None) -> None:
        """Look for nothing: nothing here reads the statistics that `Monitor` would leave in `infos`."""
