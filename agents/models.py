"""Models of stable-baselines3 from settings, and what they learned as a policy on NumPy."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from sb3_contrib import TQC, RecurrentPPO
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.networks import Affine, Network
from agents.policy import Policy, observation_table
from agents.settings import Settings
from agents.torch_networks import InformedCritic, Standardised, Tanh, behind_standard
from impact_gym.envs.observation import ENTRIES
from impact_gym.sb3 import ImpactVecEnv

TIME_WEIGHT = 7  # place of the time weight in the observation
ACTIVATIONS = {"tanh": Tanh, "relu": torch.nn.ReLU}


class EvenRewards(VecEnvWrapper):
    """Divides rewards by (1 + time weight) to a power, so that hurried episodes do not drown the others."""

    def __init__(self, envs: ImpactVecEnv, power: float) -> None:
        super().__init__(envs)
        self._envs = envs
        self._power = power
        self._scale: NDArray[np.float32] = np.ones(envs.num_envs, np.float32)

    def reset(self) -> VecEnvObs:
        """Begin an episode everywhere."""
        observations = self.venv.reset()
        self._see(observations)
        return observations

    def step_wait(self) -> VecEnvStepReturn:
        """Play a step; the scale is that of the episode the reward belongs to."""
        observations, rewards, ended, infos = self.venv.step_wait()
        rewards = rewards * self._scale
        self._see(observations)
        return observations, rewards, ended, infos

    def get_state(self) -> dict[str, Any]:
        """Return a copy of all that goes on."""
        return {"scale": self._scale, "envs": self._envs.get_state()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go on from what `get_state` returned."""
        self._scale = state["scale"]
        self._envs.set_state(state["envs"])

    def _see(self, observations: Any) -> None:
        """Take the scale from the time weights in `observations` (num_envs, n_obs)."""
        low, high = ENTRIES[TIME_WEIGHT].low, ENTRIES[TIME_WEIGHT].high
        weights = low * np.float32(high / low) ** (0.5 * (observations[:, TIME_WEIGHT] + 1.0))
        self._scale = np.asarray((1.0 + weights) ** -self._power, np.float32)


def make_environment(settings: Settings) -> EvenRewards:
    """Return the environments a training plays in."""
    envs = ImpactVecEnv(settings.envs, threads=settings.simulation_threads, **settings.training_environment)
    return EvenRewards(envs, settings.weight_power)


def make_model(settings: Settings, environment: VecEnv) -> BaseAlgorithm:
    """Return a model that has learned nothing yet."""
    layers = [settings.width] * settings.depth
    network: dict[str, Any] = {
        "net_arch": layers,
        "activation_fn": ACTIVATIONS[settings.activation],
        "features_extractor_class": Standardised,
        "features_extractor_kwargs": {"names": entry_names(settings.training_environment)},
    }

    def rate(remaining: float) -> float:
        return settings.learning_rate * (settings.final_rate + (1.0 - settings.final_rate) * remaining)

    common: dict[str, Any] = {
        "env": environment, "seed": settings.seed, "device": "cpu", "gamma": 1.0, "learning_rate": rate,
        "batch_size": min(settings.batch, settings.round) if "ppo" in settings.algo else settings.batch,
    }  # fmt: skip
    if settings.algo in ("sac", "tqc"):
        off = settings.off_policy
        return {"sac": SAC, "tqc": TQC}[settings.algo](
            "MlpPolicy",
            buffer_size=off.buffer,
            learning_starts=off.warm_up,
            train_freq=1,
            gradient_steps=off.gradient_steps,
            tau=off.tau,
            policy_kwargs=network,
            **common,
        )
    on = settings.on_policy
    network |= {"log_std_init": on.log_std, "optimizer_kwargs": {"eps": 1e-5, "fused": True}}
    algorithm: tuple[type[Any], Any] = (PPO, "MlpPolicy")
    if settings.algo == "recurrent_ppo":
        network["lstm_hidden_size"] = on.lstm
        algorithm = (RecurrentPPO, "MlpLstmPolicy")
    elif on.informed_critic:
        network["seen"] = len(entry_names(settings.environment))
        algorithm = (PPO, InformedCritic)
    return algorithm[0](
        algorithm[1],
        n_steps=on.rollout,
        n_epochs=on.epochs,
        gae_lambda=on.gae_lambda,
        ent_coef=on.entropy,
        clip_range=on.clip,
        policy_kwargs=network,
        **common,
    )


def entry_names(environment: Mapping[str, Any]) -> list[str]:
    """Return the names of what an environment shows."""
    return [entry["name"] for entry in observation_table(environment)]


def policy_from(model: BaseAlgorithm, settings: Settings, provenance: Mapping[str, Any]) -> Policy:
    """Return a copy of what acts in a model, as plain arrays."""
    network: Any = model.policy
    gates = None
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
    names = entry_names(settings.environment)
    if gates:
        gates = behind_standard(gates, names)
    else:
        layers[0] = behind_standard(layers[0], names)
    acting = Network(tuple(layers), _affine("mean", mean), log_std, settings.activation, squash, gates)
    return Policy(acting, settings.environment, provenance)


def _array(tensor: Any) -> NDArray[np.float32]:
    array: NDArray[np.float32] = tensor.detach().numpy().copy()
    return array


def _affine(name: str, layer: torch.nn.Linear) -> Affine:
    return Affine(name, _array(layer.weight), _array(layer.bias))


def _gates(lstm: torch.nn.LSTM) -> Affine:
    """Return the gates as one layer over inputs and last output; torch keeps two, with a bias each."""
    weight = np.concatenate((_array(lstm.weight_ih_l0), _array(lstm.weight_hh_l0)), axis=1)
    return Affine("gates", weight, _array(lstm.bias_ih_l0) + _array(lstm.bias_hh_l0))
