"""The algorithms by name, and what any of them has learned as a policy on NumPy."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from sb3_contrib import TQC, RecurrentPPO
from stable_baselines3 import SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from agents.policies.networks import Affine, Network
from agents.policies.policy import Policy
from agents.train import ppo
from agents.train.settings import Settings


def make_model(settings: Settings, environment: VecEnv) -> BaseAlgorithm:
    """Return a model that has learned nothing yet."""
    if settings.algo == "ppo":
        return ppo.ppo(settings, environment)
    if settings.algo == "recurrent_ppo":
        network = ppo.network_arguments(settings) | {"lstm_hidden_size": settings.on_policy.lstm}
        return RecurrentPPO("MlpLstmPolicy", policy_kwargs=network, **ppo.on_policy_arguments(settings, environment))
    off = settings.off_policy
    return {"sac": SAC, "tqc": TQC}[settings.algo](
        "MlpPolicy",
        environment,
        learning_rate=settings.rate,
        buffer_size=off.buffer,
        learning_starts=off.warm_up,
        batch_size=settings.batch,
        tau=off.tau,
        gamma=1.0,
        train_freq=1,
        gradient_steps=off.gradient_steps,
        policy_kwargs=ppo.layer_arguments(settings),
        seed=settings.seed,
        device="cpu",
    )


def policy_from(model: BaseAlgorithm, settings: Settings, provenance: Mapping[str, Any]) -> Policy:
    """Return a copy of what acts in a model, as plain arrays."""
    network, gates = model.policy, None
    if settings.algo in ("sac", "tqc"):
        hidden, mean, squash = network.actor.latent_pi, network.actor.mu, True
        log_std = _affine("log_std", network.actor.log_std)
    else:
        hidden, mean, squash = network.mlp_extractor.policy_net, network.action_net, False
        bias = _array(network.log_std)
        log_std = Affine("log_std", np.zeros((len(bias), mean.in_features), np.float32), bias)
        if settings.algo == "recurrent_ppo":
            gates = _gates(network.lstm_actor)
    linear = [layer for layer in hidden if isinstance(layer, torch.nn.Linear)]
    layers = [_affine(f"hidden_{place}", layer) for place, layer in enumerate(linear)]
    names = ppo.entry_names(settings.environment)
    if gates:
        gates = ppo.fold_in_standardisation(gates, names)
    else:
        layers[0] = ppo.fold_in_standardisation(layers[0], names)
    acting = Network(tuple(layers), _affine("mean", mean), log_std, settings.activation, squash, gates)
    return Policy(acting, settings.environment, provenance)


def _array(tensor: torch.Tensor) -> NDArray[np.float32]:
    return tensor.detach().numpy().copy()


def _affine(name: str, layer: torch.nn.Linear) -> Affine:
    return Affine(name, _array(layer.weight), _array(layer.bias))


def _gates(lstm: torch.nn.LSTM) -> Affine:
    """Return the gates as one layer over inputs and last output; torch keeps two, with a bias each."""
    weight = np.concatenate((_array(lstm.weight_ih_l0), _array(lstm.weight_hh_l0)), axis=1)
    return Affine("gates", weight, _array(lstm.bias_ih_l0) + _array(lstm.bias_hh_l0))
