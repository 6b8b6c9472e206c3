"""PPO from top to bottom: what it plays in, what its networks see, every number that it is given, what it has learned.

The numbers are in `agents.train.settings`; a set-up's file says which of them it wants otherwise.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.policies.networks import Affine, Network
from agents.policies.policy import Policy, observation_table
from agents.setups import load_setup
from agents.train.beside import Beside, narrowed
from agents.train.closed_form import ActorAndCritic, ClosedFormPPO, Tanh
from agents.train.held_tool import HeldTool
from agents.train.imitation import Pupil, Teacher, time_weights
from agents.train.settings import Settings
from impact_gym.sb3 import ImpactVecEnv

CENTRE_AND_SPREAD = {
    "flange position": (-0.1, 0.3),
    "flange velocity": (0.4, 0.45),
    "time": (-0.7, 0.2),
    "alarm": (0.35, 0.5),
    "time since the alarm": (0.2, 0.3),
    "contact force as sensed a delay ago": (0.05, 0.1),
    "its maximum so far, likewise": (0.15, 0.25),
    "time weight": (0.0, 0.3),
    "distance estimate minus flange position": (0.05, 0.1),  # sharper than it is met: 10 mm, its error, must count
    "standard deviation of the distance estimate": (0.3, 0.2),
    "tool minus flange from rest, as sensed a delay ago": (0.0, 0.2),
    "object mass": (0.15, 0.3),
    "contact stiffness": (-0.4, 0.35),
    "restitution": (0.55, 0.25),
    "distance minus flange position": (0.1, 0.3),
}
"""Centre and spread of each entry of the observation while a policy trains, to a digit. The networks see entries
standardised by them, or what differs little would be learned late; an exported policy has them in its weights."""


class ScaledRewards(VecEnvWrapper):
    """Divides rewards by (1 + time weight) to a power, so that hurried episodes do not drown the others."""

    def __init__(self, envs: ImpactVecEnv | HeldTool | Beside, power: float) -> None:
        super().__init__(envs)
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
        return {"scale": self._scale, "envs": self.venv.get_state()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go on from what `get_state` returned."""
        self._scale = state["scale"]
        self.venv.set_state(state["envs"])

    def _see(self, observations: Any) -> None:
        """Take the scale from the time weights in `observations` (num_envs, n_obs)."""
        self._scale = np.asarray((1.0 + time_weights(observations)) ** -self._power, np.float32)


def make_environment(settings: Settings) -> ScaledRewards:
    """Return the environments a training plays in."""
    plain = round(settings.nominal * settings.envs)
    nominal = load_setup(settings.setup).evaluation.nominal
    parts = [(settings.envs - plain, settings.training_environment)]
    parts += [(plain, narrowed(settings.training_environment, nominal))]
    batches = [ImpactVecEnv(n, threads=settings.simulation_threads, **played) for n, played in parts if n]
    if settings.deflection is not None:
        batches = [HeldTool(batch, settings.deflection) for batch in batches]
    return ScaledRewards(batches[0] if len(batches) == 1 else Beside(*batches), settings.weight_power)


def make_model(settings: Settings, environment: VecEnv) -> ClosedFormPPO:
    """Return a model that has learned nothing yet; the discount is 1, as an episode ends and its sum is what counts."""
    network = {
        "seen": len(entry_names(settings.environment)),
        "net_arch": [settings.width] * settings.depth,
        "activation_fn": {"tanh": Tanh, "relu": torch.nn.ReLU}[settings.activation],
        "features_extractor_class": Standardised,
        "features_extractor_kwargs": {"names": entry_names(settings.training_environment)},
        "log_std_init": settings.log_std,
        "optimizer_kwargs": {"eps": 1e-5, "fused": True},
    }
    arguments: dict[str, Any] = {
        "policy": ActorAndCritic,
        "policy_kwargs": network,
        "env": environment,
        "n_steps": settings.rollout,
        "batch_size": min(settings.batch, settings.round),
        "n_epochs": settings.epochs,
        "learning_rate": settings.rate,
        "gamma": 1.0,
        "gae_lambda": settings.gae_lambda,
        "clip_range": settings.clip,
        "ent_coef": settings.entropy,
        "seed": settings.seed,
        "device": "cpu",
    }
    if not settings.teacher:
        return ClosedFormPPO(**arguments)
    return Pupil(teacher=Teacher(settings.setup, settings.teacher), until=settings.taught, **arguments)


def policy_from(model: ClosedFormPPO, settings: Settings, provenance: Mapping[str, Any]) -> Policy:
    """Return a copy of what acts in a model, on NumPy."""
    acting, mean = model.policy.mlp_extractor.policy_net, model.policy.action_net
    linear = [layer for layer in acting if isinstance(layer, torch.nn.Linear)]
    layers = [_affine(f"hidden_{place}", layer) for place, layer in enumerate(linear)]
    layers[0] = fold_in_standardisation(layers[0], entry_names(settings.environment))
    bias = _array(model.policy.log_std)
    log_std = Affine("log_std", np.zeros((len(bias), mean.in_features), np.float32), bias)
    network = Network(tuple(layers), _affine("mean", mean), log_std, settings.activation)
    return Policy(network, settings.environment, provenance)


def _affine(name: str, layer: torch.nn.Linear) -> Affine:
    return Affine(name, _array(layer.weight), _array(layer.bias))


def _array(tensor: torch.Tensor) -> NDArray[np.float32]:
    return tensor.detach().numpy().copy()


def entry_names(environment: Mapping[str, Any]) -> list[str]:
    """Return the names of what an environment shows."""
    return [entry["name"] for entry in observation_table(environment)]


def centres_and_spreads(names: Sequence[str]) -> NDArray[np.float64]:
    """Return centres and spreads (2, entries) of entries of the observation; of one not in the table, 0 and 1."""
    now = (re.sub(r", \d before$", "", name) for name in names)  # a past reading as the last one
    return np.array([CENTRE_AND_SPREAD.get(name, (0.0, 1.0)) for name in now]).T


class Standardised(BaseFeaturesExtractor):
    """(observation - centre) / spread, of each entry."""

    def __init__(self, observation_space: spaces.Space[Any], names: Sequence[str]) -> None:
        """Make one for the entries `names`."""
        super().__init__(observation_space, len(names))
        centre, spread = torch.tensor(centres_and_spreads(names), dtype=torch.float32)
        self.register_buffer("centre", centre)
        self.register_buffer("spread", spread)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return what the networks see."""
        return (observations - self.centre) / self.spread


def fold_in_standardisation(layer: Affine, names: Sequence[str]) -> Affine:
    """Return a layer that does to observations what `layer` does to standardised ones."""
    centre, spread = centres_and_spreads(names)
    weight = layer.weight / spread
    bias = layer.bias - weight @ centre
    return Affine(layer.name, weight.astype(np.float32), bias.astype(np.float32))
