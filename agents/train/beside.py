"""Two batches of environments as one: those of a set-up, and beside them some in which hardly anything is drawn."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import Wrapper
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from agents.train.held_tool import HeldTool
from impact_gym.sb3 import ImpactVecEnv

NARROW = 1e-6  # share of a range that is left of it


class Beside(VecEnv):
    """Batches that show the same entries, one behind the other."""

    def __init__(self, *batches: ImpactVecEnv | HeldTool) -> None:
        """Put them side by side.

        Raises:
            ValueError: they show observations of different length.
        """
        shapes = {batch.observation_space.shape for batch in batches}
        if len(shapes) > 1:
            raise ValueError(f"the batches show observations of different shapes, {sorted(map(str, shapes))}")
        self._batches = batches
        self._cuts = np.cumsum([batch.num_envs for batch in batches])[:-1]
        super().__init__(
            sum(batch.num_envs for batch in batches), batches[0].observation_space, batches[0].action_space
        )

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Seed them one by one, from `seed` on."""
        firsts = [0, *self._cuts.tolist()]
        seeds = [None if seed is None else seed + first for first in firsts]
        return [one for batch, first in zip(self._batches, seeds, strict=True) for one in batch.seed(first)]

    def reset(self) -> VecEnvObs:
        """Begin an episode everywhere."""
        return np.concatenate([np.asarray(batch.reset()) for batch in self._batches])

    def step_async(self, actions: NDArray[Any]) -> None:
        """Remember `actions` (num_envs, 2)."""
        for batch, own in zip(self._batches, np.split(actions, self._cuts), strict=True):
            batch.step_async(own)

    def step_wait(self) -> VecEnvStepReturn:
        """Play them."""
        seen, rewards, ended, infos = zip(*(batch.step_wait() for batch in self._batches), strict=True)
        return (
            np.concatenate(seen),
            np.concatenate(rewards),
            np.concatenate(ended),
            [one for part in infos for one in part],
        )

    def get_state(self) -> dict[str, Any]:
        """Return a copy of all that goes on."""
        return {"batches": [batch.get_state() for batch in self._batches]}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go on from what `get_state` returned."""
        for batch, own in zip(self._batches, state["batches"], strict=True):
            batch.set_state(own)

    def close(self) -> None:
        """Release nothing: there is nothing to release."""

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return the attribute of each environment asked for."""
        values = [one for batch in self._batches for one in batch.get_attr(attr_name)]
        return [values[index] for index in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of all of them."""
        for batch in self._batches:
            batch.set_attr(attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of each batch."""
        parts = [batch.env_method(method_name, *method_args, **method_kwargs) for batch in self._batches]
        return [one for part in parts for one in part]

    def env_is_wrapped(
        self, wrapper_class: type[Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Nothing in the batches is wrapped."""
        return [False for _ in self._get_indices(indices)]


def narrowed(environment: Mapping[str, Any], nominal: Mapping[str, Any]) -> dict[str, Any]:
    """Return an environment's arguments with each range that `nominal` names shrunk to the value it has there.

    It is still a range, so that a privileged observation has the same entries. For a rigid robot stands the stiffest.
    """
    return {**environment, **{name: _narrow(environment.get(name), value) for name, value in nominal.items()}}


def _narrow(given: Any, value: Any) -> Any:
    """Return a narrow range at `value` where a range is given, in tables as well."""
    if isinstance(given, Mapping):
        inside = value if isinstance(value, Mapping) else dict.fromkeys(given, value)
        return {name: one if name == "type" else _narrow(one, inside[name]) for name, one in given.items()}
    rigid = isinstance(value, str)
    if isinstance(given, list | tuple):
        low, high = given
        width = NARROW * (high - low)
        return [high - width, high] if rigid else [value, value + width]
    return given if rigid else value or NARROW * given
