"""Environments with a vector reward, one number per objective, as MO-Gymnasium defines them.

`import impact_gym` registers their ids, such as "mo-impact-approach-v0" for "ImpactApproach-v0"; MO-Gymnasium itself is
not needed.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from impact_gym.envs.batch import Batch
from impact_gym.envs.single import ImpactApproachEnv
from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.task import Task

Rewards = NDArray[np.float64]


def vector_rewards(batch: Batch) -> Rewards:
    """Return the rewards of the last control step (rows, n): -time (s), -V_p or -`missed_cost` (m/s), and -force (N).

    See `MOImpactApproachEnv`. The force is an objective if any task has a `force_weight` above 0, and is 0 in rows with
    a `force_weight` of 0. The scalar reward is the sum of these numbers, weighted by time_weight, 1 and force_weight.
    """
    forced = np.resize([task.force_weight > 0.0 for task in batch.tasks], batch.size)
    totals = []
    for terms in (batch.episodes["terms_before"], batch.episodes["terms"]):
        force = [terms["force"] * forced] if forced.any() else []
        totals.append(np.stack([terms["time"], terms["speed"] + terms["miss"], *force], axis=1))
    return totals[0] - totals[1]


def described(tasks: Sequence[Task]) -> tuple[Box, int, Rewards]:
    """Return reward space, reward dimension and reference point for a batch of `tasks`."""
    worst = [max(task.horizon for task in tasks), max(task.missed_cost for task in tasks)]
    worst += [np.inf] if any(task.force_weight > 0.0 for task in tasks) else []
    return Box(-np.inf, 0.0, (len(worst),), np.float64), len(worst), -np.array(worst)


class MOImpactApproachEnv(ImpactApproachEnv):
    """`ImpactApproach` with a vector reward; `info["original_reward"]` has the scalar reward.

    ## Rewards
    `reward_space` is `Box(-inf, 0, (reward_dim,), float64)`. The first number of a step is minus the step's time (s)
    before the first contact or, with an operator, minus the duration of the whole step (s). The other numbers are 0
    before the step that terminates an episode. In this step the second number is -V_p (m/s), or -`missed_cost` if the
    object was not touched. With a `force_weight` the third number is minus the largest contact force (N). If V_p is at
    most `missed_cost`, the sums over an episode are at least `reference_point` (-horizon, -`missed_cost`, -inf).

    ## Version History
    * v0: first version
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)
        self.reward_space, self.reward_dim, self.reference_point = described(self._batch.tasks)

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], Any, bool, bool, dict[str, Any]]:
        """Play one control step; the reward is (reward_dim,)."""
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, vector_rewards(self._batch)[0], terminated, truncated, info | {"original_reward": reward}


class MOImpactApproachVectorEnv(ImpactApproachVectorEnv):
    """`ImpactApproachVectorEnv` with vector rewards (num_envs, reward_dim)."""

    def __init__(self, num_envs: int = 1, **arguments: Any) -> None:
        super().__init__(num_envs, **arguments)
        self.reward_space, self.reward_dim, self.reference_point = described(self.batch.tasks)

    def _rewards(self) -> tuple[Rewards, dict[str, Any]]:
        return vector_rewards(self.batch), {"original_reward": self.batch.rewards.copy()}
