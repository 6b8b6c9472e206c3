"""A price on how far the tool moves against the flange before it touches, for arms whose tool hangs softly."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from impact_gym.sb3 import ImpactVecEnv

PRICE = 2.0
"""m/s for each share by which a tool moves further than it may: more than V_p and approach can gain by it."""


class HeldTool(VecEnvWrapper):
    """Charges each step for what the tool has moved beyond a limit, and beyond what was charged before.

    It is looked for at control steps; where it is in contact, nothing more is charged.
    """

    def __init__(self, envs: ImpactVecEnv, limit: float) -> None:
        """Wrap environments whose tools may move `limit`, m."""
        super().__init__(envs)
        self._envs, self._limit = envs.envs, limit
        self._rest, self._farthest = np.zeros((2, envs.num_envs))

    def reset(self) -> VecEnvObs:
        """Begin an episode everywhere."""
        observations = self.venv.reset()
        self._begin(np.ones(self.num_envs, np.bool_))
        return observations

    def step_wait(self) -> VecEnvStepReturn:
        """Play a step and take its charge from the rewards; the step of a touch is free, and so is the last one."""
        observations, rewards, ended, infos = self.venv.step_wait()
        flying = (self._envs.batch.chains["contacts"] == 0) & ~ended
        away = np.where(flying, np.abs(self._offset() - self._rest), 0.0)
        charged = np.maximum(away - self._farthest, 0.0)
        self._farthest += charged
        self._begin(ended)
        return observations, (rewards - PRICE / self._limit * charged).astype(np.float32), ended, infos

    def get_state(self) -> dict[str, Any]:
        """Return a copy of all that goes on."""
        return {"rest": self._rest.copy(), "farthest": self._farthest.copy(), "envs": self.venv.get_state()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go on from what `get_state` returned."""
        self._rest, self._farthest = state["rest"].copy(), state["farthest"].copy()
        self.venv.set_state(state["envs"])

    def _begin(self, rows: NDArray[np.bool_]) -> None:
        """Take in where the tools of new episodes rest; nothing is charged until the limit."""
        self._rest[rows], self._farthest[rows] = self._offset()[rows], self._limit

    def _offset(self) -> NDArray[np.float64]:
        """Return where the tools are against their flanges (num_envs,), m."""
        chains = self._envs.batch.chains
        return np.asarray(chains["deflection"] - chains["flange_offset"])
