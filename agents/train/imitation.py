"""PPO that begins as a pupil: for its first steps it is told what a tuned baseline would do where it is itself.

S. Ross, G. Gordon, D. Bagnell, A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning, AISTATS 2011. PPO explores around what it does; what lies far from that, such as an approach in pulses, it
does not find, but it improves on it once it is there.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from agents.baselines.rule import ALARM, SINCE_ALARM
from agents.baselines.tuned import read_tuned, tuned_rule
from agents.setups import load_setup
from agents.train.closed_form import ClosedFormPPO, Layers
from impact_gym.envs.observation import ENTRIES, TOUCH, entries
from impact_gym.envs.task import Task

TIME_WEIGHT = 7
"""Place of the time weight in the observation."""


def time_weights(observations: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the time weights (...), m/s per s, in `observations` (..., n_obs)."""
    low, high = ENTRIES[TIME_WEIGHT].low, ENTRIES[TIME_WEIGHT].high
    return np.asarray(low * np.float32(high / low) ** (0.5 * (observations[..., TIME_WEIGHT] + 1.0)))


class Teacher:
    """A tuned baseline of a set-up, in each episode as it was tuned for the time weight at which it does best there."""

    def __init__(self, setup: str, name: str) -> None:
        """Read a baseline of the set-up itself, or one that is shipped.

        Raises:
            ValueError: there is no such baseline, or it does not fit what the set-up shows.
        """
        loaded = load_setup(setup)
        its_own = name in loaded.tuned
        content = read_tuned(name, loaded.folder / "tuned", loaded) if its_own else read_tuned(name)
        rules = [tuned_rule(content, float(weight)) for weight in content["weights"]]
        self.rules = [rule.for_environment(loaded.environment) for rule in rules]
        self.told = [entry.sensor for entry in entries(Task(**loaded.environment, privileged=True))]
        means = [found["validation"] for found in content["weights"].values()]
        self.means = np.array([(one["object_velocity"], one["approach_time"]) for one in means])
        self.checksum: str = content["sha256"]

    def actions(self, observations: NDArray[Any], episode_starts: NDArray[Any]) -> NDArray[np.float32]:
        """Return what it would do (steps, envs, 2) at `observations` (steps, envs, n_obs), which follow each other.

        Where readings raise the alarm it is told when a switch would have, which the pupil has to find out. What it
        remembers of before the first of them is lost.
        """
        if TOUCH.sensor in self.told:
            touched = observations[..., self.told.index(TOUCH.sensor)]
            observations = observations.copy()
            observations[..., ALARM], observations[..., SINCE_ALARM] = touched > 0.0, touched
        velocity, time = self.means.T  # on the validation set
        best = (velocity + time_weights(observations)[..., None] * time).argmin(axis=-1)
        found = np.zeros((*best.shape, 2), np.float32)
        for place, rule in enumerate(self.rules):
            state = None
            for step, (seen, start) in enumerate(zip(observations, episode_starts, strict=True)):
                actions, state = rule.predict(seen, state, start > 0.5)
                found[step] = np.where(best[step, :, None] == place, actions, found[step])
        return found


class Pupil(ClosedFormPPO):
    """PPO that does as its teacher says for its first steps; its critic learns from the beginning."""

    def __init__(self, *arguments: Any, teacher: Teacher, until: int, **options: Any) -> None:
        """Make one; for so many steps, `until`, the teacher speaks."""
        self._teacher, self._until = teacher, until
        super().__init__(*arguments, **options)

    def train(self) -> None:
        """Learn from the last rollout."""
        if self.num_timesteps <= self._until:
            self._imitate()
        else:
            super().train()

    @torch.no_grad()
    def _imitate(self) -> None:
        """Reduce the mean squared error of the mean action, and of the values, on the last rollout."""
        policy, buffer, hidden = self.policy, self.rollout_buffer, self.policy.mlp_extractor
        self._update_learning_rate(policy.optimizer)
        actor, critic = Layers(hidden.policy_net, policy.action_net), Layers(hidden.value_net, policy.value_net)
        told = self._teacher.actions(buffer.observations, buffer.episode_starts)
        arrays = (buffer.observations, told, buffer.returns[..., None])
        seen, told, returns = (torch.from_numpy(array.reshape(-1, array.shape[-1])) for array in arrays)
        features, parameters, losses = policy.features_extractor(seen), [*policy.parameters()], []
        for _ in range(self.n_epochs):
            order = torch.from_numpy(np.random.permutation(len(seen)))  # noqa: NPY002 - as stable-baselines3 draws it
            for part in order.split(self.batch_size):
                error = actor.forward(features[part, : policy.seen]) - told[part]
                value_error = critic.forward(features[part]) - returns[part]
                actor.backward(2.0 / error.numel() * error)
                critic.backward(2.0 * self.vf_coef / len(part) * value_error)
                policy.log_std.grad = torch.zeros_like(policy.log_std)
                torch.nn.utils.clip_grad_norm_(parameters, self.max_grad_norm)
                policy.optimizer.step()
                losses.append(error.square().mean().item())
            self._n_updates += 1
        self.logger.record("train/imitation_loss", float(np.mean(losses)))
