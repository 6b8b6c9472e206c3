"""The environments as a `VecEnv` of stable-baselines3; needs the extra `train`."""

import warnings
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import cycle
from typing import Any

import numpy as np
import torch
from gymnasium import Wrapper
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.support.threads import CORES
from impact_gym.support.validation import one_of
from impact_gym.task.episodes import reset_options
from impact_gym.task.task import ARGUMENTS, Task


@cache
def warn_of_threads(threads: int, available: int) -> None:
    """Warn, once for each number of threads, if torch uses several threads and more than half of the cores."""
    if threads > max(1, available // 2):
        text = f"torch uses {threads} threads on {available} cores, which makes small networks several times slower:"
        warnings.warn(f"{text} call torch.set_num_threads(1)", stacklevel=2)


class ImpactVecEnv(VecEnv):
    """`num_envs` environments for stable-baselines3. Arguments: as `ImpactApproachVectorEnv`, without `autoreset_mode`.

    The last step of an episode returns the first observation of the next episode, and an `info` with
    `terminal_observation` and `TimeLimit.truncated`. For at most 16 environments, made with `render_mode="rgb_array"`,
    `render` returns one picture with all environments in a grid, as `VecVideoRecorder` needs.
    """

    def __init__(
        self,
        num_envs: int,
        *,
        render_mode: str | None = None,
        threads: int | None = None,
        per_slot: Sequence[Mapping[str, Any]] | None = None,
        **arguments: Any,  # arguments of `Task`
    ) -> None:
        unknown = {name: None for name in arguments if name not in ARGUMENTS}
        Task.of("environment", unknown, "num_envs", "render_mode", "threads", "per_slot")  # refuses them
        warn_of_threads(torch.get_num_threads(), CORES)
        mode = AutoresetMode.DISABLED  # `step_wait` resets on the step that ends an episode
        self.envs = ImpactApproachVectorEnv(
            num_envs, render_mode=render_mode, autoreset_mode=mode, threads=threads, per_slot=per_slot, **arguments
        )
        self.observation_spec, self.set_scenario = self.envs.observation_spec, self.envs.set_scenario
        self.get_state, self.set_state = self.envs.get_state, self.envs.set_state  # call these only between steps
        self._actions: NDArray[Any] = np.zeros((num_envs, len(self.envs.batch.action_spec)), np.float32)
        super().__init__(num_envs, self.envs.single_observation_space, self.envs.single_action_space)
        self.metadata = self.envs.metadata

    def get_images(self) -> list[NDArray[np.uint8] | None]:
        """Return a picture (540, 960, 3) of each environment; an empty list without a `render_mode`."""
        return list(self.envs.render() or ())

    def reset(self) -> VecEnvObs:
        """Begin an episode in every environment, with the seeds and options that were set since the last reset."""
        one_of("options", self._options, list)
        if len(self._options) != self.num_envs:
            raise ValueError(f"options must be a mapping or {self.num_envs} mappings, got {len(self._options)}")
        asked = zip(self._options, cycle(self.envs.batch.tasks), strict=False)
        fixed = np.concatenate([reset_options(options, [task]) for options, task in asked])
        observations = self.envs.begin(list(self._seeds), np.ones(self.num_envs, np.bool_), fixed)
        self.reset_infos = [{} for _ in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Store `actions` (num_envs, n) for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Play a control step with the stored actions."""
        terminated, truncated = self.envs.play(self._actions)
        batch, ended = self.envs.batch, terminated | truncated
        rewards = batch.rewards.astype(np.float32)
        infos = batch.step_infos()
        if ended.any():
            rows = np.flatnonzero(ended)
            lasts, cuts = batch.observations[rows], (truncated & ~terminated)[rows].tolist()
            for row, info, last, cut in zip(rows.tolist(), batch.infos(rows), lasts, cuts, strict=True):
                infos[row] |= ({} if cut else info) | {"terminal_observation": last, "TimeLimit.truncated": cut}
            self.envs.begin(None, ended)
        return batch.observations.copy(), rewards, ended, infos

    def close(self) -> None:
        """Do nothing, because a batch holds no resources."""

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of `envs`, once for each of `indices`."""
        return [getattr(self.envs, attr_name) for _ in np.arange(self.num_envs)[[*self._get_indices(indices)]]]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of `envs`; `indices` must include all environments."""
        self._must_be_all(indices, attr_name)
        setattr(self.envs, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of all environments, see `ImpactApproachVectorEnv.call`; return its value for each one."""
        self._must_be_all(indices, method_name)
        return list(self.envs.call(method_name, *method_args, **method_kwargs))

    def env_is_wrapped(
        self, wrapper_class: type[Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Return False for each of `indices`: no environment in the batch is wrapped."""
        return [False for _ in np.arange(self.num_envs)[[*self._get_indices(indices)]]]

    def _must_be_all(self, indices: VecEnvIndices, name: str) -> None:
        if {*self._get_indices(indices)} != {*range(self.num_envs)}:
            raise ValueError(f"{name!r} belongs to the whole batch: leave `indices` out, got {indices!r}")
