"""PPO that first imitates a baseline, in states that the policy itself visits.

S. Ross, G. Gordon, D. Bagnell, A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning, AISTATS 2011.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from torch.nn.functional import mse_loss

from agents.baselines import FIXED, tuned_rule
from agents.setups import Setup
from agents.setups.tuned import read_tuned
from impact_gym.task import ObservationSpec


class Teacher:
    """A baseline to imitate, with the tuned parameters that have the lowest cost at each episode's time weight."""

    def __init__(self, setup: Setup, name: str, privileged: bool = True) -> None:
        """Make a teacher from one of FIXED, a tuned baseline of `setup`, or a shipped one; `privileged`: see `Task`."""
        rules, means, self.checksum = [FIXED[name]()] if name in FIXED else [], [(0.0, 0.0)], name
        if not rules:
            content = read_tuned(name, setup=setup)
            rules = [tuned_rule(content).at(float(weight)) for weight in content["weights"]]
            scores = [tuned["validation"] for tuned in content["weights"].values()]
            means = [(score["object_velocity"], score["approach_time"]) for score in scores]
            self.checksum = content["sha256"]
        self.rules, self.means = [rule.for_task(setup.task) for rule in rules], np.array(means)
        mixed = [{}, *(changes for _, changes in setup.mixed)]
        tasks = [setup.task.changed({**changes, "privileged": privileged}) for changes in mixed]
        self.spec, self.action_size = ObservationSpec.of_rows(tasks), len(tasks[0].action)

    def actions(self, observations: NDArray[Any], episode_starts: NDArray[Any]) -> NDArray[np.float32]:
        """Return the teacher's actions (steps, envs, k) for `observations` (steps, envs, n_obs).

        With `privileged` and `alarm="reading"`, the observations contain the time since the alarm that `alarm="force"`
        would raise. The teacher then gets that alarm. At the first step, the teacher has no memory.
        """
        spec, time_weight = self.spec, self.spec.decode(observations, "time_weight")
        if "time_since_touch" in spec.ids:
            touched = observations[..., spec.index("time_since_touch")]
            observations = observations.copy()
            observations[..., spec.index("alarm")] = touched > 0.0
            observations[..., spec.index("time_since_alarm")] = touched
        velocity, time = self.means.T  # mean object velocity (m/s) and approach time (s) of each rule in the validation
        best = (velocity + time_weight[..., None] * time).argmin(axis=-1)
        chosen = np.zeros((*best.shape, self.action_size), np.float32)
        for place, rule in enumerate(self.rules):
            state = None
            for step, (seen, start) in enumerate(zip(observations, episode_starts, strict=True)):
                actions, state = rule.predict(seen, state, start > 0.5)
                chosen[step] = np.where(best[step, :, None] == place, actions, chosen[step])
        return chosen


class PPOWithImitation(PPO):
    """PPO whose actor imitates a teacher in the first `imitation_steps` steps, while the critic learns from rewards."""

    def __init__(self, *arguments: Any, teacher: Teacher, imitation_steps: int, **options: Any) -> None:
        """Make a model; `arguments` and `options` are those of PPO."""
        self.teacher, self.imitation_steps = teacher, imitation_steps
        super().__init__(*arguments, **options)

    def train(self) -> None:
        """Learn from the last rollout."""
        if self.num_timesteps > self.imitation_steps:
            super().train()
            return
        policy, buffer = self.policy, self.rollout_buffer
        policy.set_training_mode(True)
        self._update_learning_rate(policy.optimizer)  # stable-baselines3 2.9: `PPO.train` begins like this
        actions = self.teacher.actions(buffer.observations, buffer.episode_starts)
        arrays = (buffer.observations, actions, buffer.returns[..., None])
        columns = [torch.from_numpy(array.reshape(-1, array.shape[-1])) for array in arrays]
        losses = []
        for _ in range(self.n_epochs):
            order = torch.from_numpy(np.random.permutation(len(columns[0])))  # noqa: NPY002 - as in PPO
            for part in torch.split(order, self.batch_size):
                observations, wanted, returns = (column[part] for column in columns)
                loss = mse_loss(policy.get_distribution(observations).mode(), wanted)
                losses.append(loss.item())
                policy.optimizer.zero_grad()
                value_loss = mse_loss(policy.predict_values(observations), returns)
                torch.autograd.backward(loss + self.vf_coef * value_loss)
                torch.nn.utils.clip_grad_norm_(policy.parameters(), self.max_grad_norm)
                policy.optimizer.step()
            self._n_updates += 1  # as in `PPO.train`
        self.logger.record("train/imitation_loss", float(np.mean(losses)))
