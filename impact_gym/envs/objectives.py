"""The task with its objectives apart: vector rewards, by MO-Gymnasium's contract, single and as a native batch.

`mo_gymnasium.make("mo-impact-approach-v0")` and `gym.make_vec` know the ids, as `import impact_gym` registers them;
MO-Gymnasium itself is not needed. Everything but the reward is as in the environment without the prefix.
"""

from collections.abc import Mapping, Sequence
from functools import wraps
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from impact_gym.envs.batch import Batch
from impact_gym.envs.single import ImpactApproachEnv
from impact_gym.envs.state import require, taken
from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.task import Task

Rewards = NDArray[np.float64]


class Objectives:
    """What each control step of a batch adds to the objectives: -T (s), -V_p (m/s) and, where it counts, -force (N).

    T is the time that the task charges. V_p comes at the end, with what a miss costs; so does the largest contact force
    of an environment with a `force_weight`. With w the episode's time weight, the scalar reward is
    w * (-T) - V_p - force_weight * force.
    """

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        self._forced = np.resize([task.force_weight > 0.0 for task in batch.tasks], batch.size)
        count = 3 if self._forced.any() else 2
        self.before = np.zeros((batch.size, count))
        self.space = Box(-np.inf, 0.0, (count,), np.float64)

    def added(self) -> Rewards:
        """Return the rewards of the last step (rows, objectives); to be asked once after each."""
        terms = self._batch.episodes["terms"]
        force = [terms["force"] * self._forced] if self._forced.any() else []
        now = np.stack([terms["time"], terms["speed"] + terms["miss"], *force], axis=1)
        new = self._batch.episodes["control_steps"] <= 1  # an episode that has just begun
        rewards = np.where(new[:, None], 0.0, self.before) - now
        self.before = now
        return rewards


def soonest(task: Task, distance: float) -> float:
    """Return the time (s) after which a rigid tool can have come so far (m) from rest: at the arm's limits."""
    velocity, acceleration = task.velocity_range[1], task.acceleration_range[1]
    ramp = 0.5 * velocity**2 / acceleration  # m
    if distance < ramp:
        return float(np.sqrt(2.0 * distance / acceleration))
    return float(velocity / acceleration + (distance - ramp) / velocity)


def points(tasks: Sequence[Task]) -> tuple[Rewards, Rewards]:
    """Return what no episode falls below, where nothing is touched until the end, and what none exceeds.

    Sums of the rewards, for hypervolumes: the reference point and the utopia point, which is at the nearest place as
    soon as a rigid tool can be and leaves the object at rest. Nothing limits a force: -inf. Of several tasks the ends.
    """
    worst = [max(task.horizon for task in tasks), max(task.missed_cost for task in tasks)]
    worst += [np.inf] if any(task.force_weight > 0.0 for task in tasks) else []
    best = np.zeros(len(worst))
    best[0] = min(soonest(task, task.scenario.distance[0]) for task in tasks)
    return -np.array(worst), -best


class MOImpactApproachEnv(ImpactApproachEnv):
    """`ImpactApproach` with a vector reward; `info["original_reward"]` has the scalar one.

    ## Rewards
    `reward_space` is `Box(-inf, 0, (reward_dim,), float64)`: -T (s, in each step) and -V_p (m/s, at the end, with
    `missed_cost`), and as a third one, with a `force_weight`, -(largest contact force) (N, at the end). With an
    operator T runs until the task is done.
    `reference_point` and `utopia_point` (reward_dim,) bound the sums of an episode's rewards, see `points`.

    ## Version History
    * v0: first version
    """

    @wraps(ImpactApproachEnv.__init__)  # type: ignore[misc]  # whose arguments they are
    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)
        self._objectives = Objectives(self._batch)
        self.reference_point, self.utopia_point = points(self._batch.tasks)
        self.reward_space, self.reward_dim = self._objectives.space, len(self._objectives.space.low)

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], Any, bool, bool, dict[str, Any]]:
        """Play one control step; the reward is (reward_dim,)."""
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, self._objectives.added()[0], terminated, truncated, info | {"original_reward": reward}


class MOImpactApproachVectorEnv(ImpactApproachVectorEnv):
    """The native batch with vector rewards (num_envs, reward_dim); slot i seeded s + i equals the single one."""

    @wraps(ImpactApproachVectorEnv.__init__)  # type: ignore[misc]  # likewise
    def __init__(self, num_envs: int = 1, **arguments: Any) -> None:
        super().__init__(num_envs, **arguments)
        self._objectives = Objectives(self.batch)
        self.reference_point, self.utopia_point = points(self.batch.tasks)
        self.reward_space, self.reward_dim = self._objectives.space, len(self._objectives.space.low)

    def _rewards(self) -> tuple[Rewards, dict[str, Any]]:
        """Return the rewards of the last step, and the scalar ones as an info."""
        return self._objectives.added(), {"original_reward": self.batch.rewards.copy()}

    def get_state(self) -> dict[str, Any]:
        """Return a copy of all that `reset` and `step` go on from."""
        return super().get_state() | {"objectives": self._objectives.before.copy()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go on from what `get_state` returned, see `ImpactApproachVectorEnv`."""
        before = taken(state, "objectives", self._objectives.before)
        require("objectives", before, np.isfinite(before), "finite")
        super().set_state(state)
        self._objectives.before = before.copy()
