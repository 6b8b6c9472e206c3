"""Scaled rewards of a training, so that episodes with a large time weight do not dominate."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from impact_gym.sb3 import ImpactVecEnv
from impact_gym.validation import array


class ScaledRewards(VecEnvWrapper):
    """Divides rewards by (1 + time weight) ** power."""

    def __init__(self, envs: ImpactVecEnv, power: float) -> None:
        super().__init__(envs)
        self._envs, self._power, self._spec = envs, power, envs.observation_spec
        self._scale: NDArray[np.float32] = np.ones(envs.num_envs, np.float32)

    def reset(self) -> VecEnvObs:
        """Begin an episode in each environment."""
        observations = self.venv.reset()
        self._see(observations)
        return observations

    def step_wait(self) -> VecEnvStepReturn:
        """Play a step; each reward is scaled by the time weight of the episode to which it belongs."""
        observations, rewards, ended, infos = self.venv.step_wait()
        rewards = rewards * self._scale
        self._see(observations)
        return observations, rewards, ended, infos

    def get_state(self) -> dict[str, Any]:
        """Return the state needed to resume."""
        return {"scale": self._scale, "envs": self._envs.get_state()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `get_state`; ValueError: it does not fit these environments."""
        scale = array("scale of a state", state.get("scale"), self._scale.shape, "f")
        self._envs.set_state(state.get("envs", {}))
        self._scale = scale

    def _see(self, observations: VecEnvObs) -> None:
        """Set the scales from the time weights in `observations` (num_envs, n_obs)."""
        time_weight = self._spec.decode(np.asarray(observations), "time_weight")
        self._scale = np.asarray((1.0 + time_weight) ** -self._power, np.float32)
