"""Policies as plain arrays: what training leaves behind, and what runs without torch.

A policy file is an archive of arrays and JSON: the weights of a small network, what it sees and commands in which
units, and how it came about. Reading one runs no code.
"""

import warnings
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from agents.archive import read_archive, write_archive
from agents.policies.networks import Network, from_arrays, to_arrays
from impact_gym.envs import observation as observations
from impact_gym.envs.task import Task

SHIPPED = Path(__file__).parent
FORMAT = "impact_gym policy 2"
ACTIONS = 2  # numbers of an action
MAY_DIFFER = ("scenario", "time_weight", "privileged", "rtol", "max_episode_steps")
"""Arguments of an environment that a policy may meet otherwise than in training."""


class Controller(Protocol):
    """Anything that acts as a policy of stable-baselines3 does."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Return actions and the controller's next state."""


class Policy:
    """A network with the environment it was trained for, called as a policy of stable-baselines3 is."""

    def __init__(self, network: Network, environment: Mapping[str, Any], provenance: Mapping[str, Any]) -> None:
        """Make a policy.

        Args:
            network: from the scaled observation to the action in [-1, 1].
            environment: arguments of the environment; they say what the observation holds.
            provenance: how the policy came about: command, seed, versions, anything that JSON holds.

        Raises:
            ValueError: the network does not fit the environment.
        """
        self.network, self.environment, self.provenance = network, dict(environment), dict(provenance)
        self.observation_table, self.action_table = observation_table(environment), action_table(environment)
        self.inputs, shown = network.inputs, len(self.observation_table)
        """Length of the observation."""
        if self.inputs != shown:
            raise ValueError(f"the network takes {self.inputs} numbers, the environment shows {shown}")
        if network.mean.outputs != ACTIONS:
            raise ValueError(f"the network gives {network.mean.outputs} numbers, an action has {ACTIONS}")
        self._noise = np.random.default_rng()
        self._warned = False

    def predict(
        self,
        observation: NDArray[np.float32],
        state: Any = None,
        episode_start: NDArray[np.bool_] | bool | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the action for an observation (n_obs,) or the actions for a batch of them (n, n_obs), and `state`.

        It remembers nothing, so that `state` and `episode_start` change nothing. Unlike in stable-baselines3,
        deterministic is the default: it is what the policy was judged by.
        """
        seen = np.asarray(observation, np.float32)
        if seen.ndim == 0 or seen.shape[-1] != self.inputs:
            raise ValueError(f"the policy takes {self.inputs} numbers, the observation has the shape {seen.shape}")
        if not np.isfinite(seen).all():
            raise ValueError("the observation must be finite")
        latent = self.network.latent(seen)
        action = self.network.mean(latent)
        if not deterministic:
            sigma = np.exp(self.network.log_std(latent))
            noise = sigma * self._noise.standard_normal(action.shape, np.float32)
            action = (action + noise).astype(np.float32)
        return np.clip(action, np.float32(-1.0), np.float32(1.0)), state

    def differs_in(self, task: Task) -> list[str]:
        """Return the arguments in which a task is another than the one that the policy was trained for."""
        own = Task(**self.environment)
        names = {argument.name for argument in fields(Task) if argument.init} - {*MAY_DIFFER}
        other = {name for name in names if getattr(own, name) != getattr(task, name)}
        ranges = {name for name in {*own.drawn, *task.drawn} if own.drawn.get(name) != task.drawn.get(name)}
        return sorted(other | {name.partition(".")[0] for name in ranges})

    def warn_if_elsewhere(self, task: Task) -> None:
        """Warn, once, if a task is another than the one that the policy was trained for."""
        other = [] if self._warned else self.differs_in(task)
        if other:
            self._warned = True
            differs = f"which differs in {', '.join(other)}"
            warnings.warn(f"the policy was trained for another environment, {differs}", stacklevel=3)

    def save(self, path: Path | str) -> Path:
        """Write the policy to `path`, whole or not at all."""
        content = {
            "network": self.network.description(),
            "environment": self.environment,
            "observation": self.observation_table,
            "action": self.action_table,
            "provenance": self.provenance,
        }
        write_archive(Path(path), FORMAT, content, to_arrays(self.network))
        return Path(path)


def observation_table(environment: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return name, unit and scale of each entry of the observation."""
    columns = ("name", "unit", "low", "high", "scaled_low")
    shown = observations.entries(Task(**environment))
    return [{column: getattr(entry, column) for column in columns} for entry in shown]


def action_table(environment: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return what the action's entries in [-1, 1] mean."""
    task = Task(**environment)
    rows = [
        ("velocity to go to", "m/s", *task.velocity_range),
        ("acceleration to use for it", "m/s^2", *task.acceleration_range),
    ]
    return [dict(zip(("name", "unit", "low", "high"), row, strict=True)) for row in rows]


def load_policy(name: str | Path) -> Policy:
    """Return a policy shipped with the project, by name, or from a file, or the best one of a run folder.

    Raises:
        FileNotFoundError: neither a shipped policy nor a file; lists what is shipped.
        ValueError: the file is not a policy, or is damaged, or was made for other scales than the environment has.
    """
    places = (SHIPPED / f"{name}.npz", Path(name), Path(name) / "best.npz")
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        shipped = sorted(file.stem for file in SHIPPED.glob("*.npz"))
        raise FileNotFoundError(f"no policy {str(name)!r}: it is no file, and shipped are {shipped}")
    content, arrays = read_archive(path, FORMAT)
    try:
        policy = Policy(from_arrays(content["network"], arrays), content["environment"], content["provenance"])
        tables = content["observation"], content["action"]
    except (LookupError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{path} is no policy: {error}") from error
    if tables != (policy.observation_table, policy.action_table):
        raise ValueError(f"{path} was made for other scales of observation or action than this version's environment")
    return policy
