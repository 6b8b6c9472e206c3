"""Policies as plain arrays, the results of trainings, which run without torch.

A policy file is an archive of arrays and JSON: the weights of a small network, or of one for each seed of a training,
the scales of observation and action, and their provenance. Reading one runs no code.
"""

import io
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from agents import archive
from agents.policies.networks import Network, from_arrays, to_arrays
from impact_gym.files import named_file, reason
from impact_gym.task import ActionSpec, ObservationSpec, Task
from impact_gym.teleop.channels import without_files
from impact_gym.validation import array, shown, whole

SHIPPED = Path(__file__).parent
FORMAT = "impact_gym policies 3"
MAY_DIFFER = ("scenario", "time_weight", "privileged", "rtol", "max_episode_steps")
"""Arguments of an environment that may differ from those of the training."""


class Controller(Protocol):
    """Anything that acts as a policy of stable-baselines3 does."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Return actions and the controller's next state."""


class Policy:
    """A network with the environment it was trained for, called as a policy of stable-baselines3 is."""

    def __init__(self, network: Network, task: Task, provenance: Mapping[str, Any]) -> None:
        """Make a policy.

        Args:
            network: from the scaled observation to the action in [-1, 1].
            task: of the environment; it says what the observation holds.
            provenance: origin of the policy: command, seed, versions, anything that JSON holds.

        Raises:
            ValueError: the network does not fit the environment.
        """
        self.network, self.task, self.provenance = network, task, dict(provenance)
        self.spec, self.inputs, self.actions = ObservationSpec(task), network.inputs, len(ActionSpec(task))
        if self.inputs != len(self.spec):
            raise ValueError(f"the network takes {self.inputs} numbers, the environment shows {len(self.spec)}")
        if network.mean.outputs != self.actions:
            raise ValueError(f"the network gives {network.mean.outputs} numbers, an action has {self.actions}")
        self._noise = np.random.default_rng()
        self._warned = False

    @property
    def environment(self) -> dict[str, Any]:
        """Arguments of the environment that it was trained for."""
        return self.task.arguments()

    @property
    def seed(self) -> int:
        """Seed of its training; 0 where nothing says so."""
        return int(self.provenance.get("settings", {}).get("seed", 0))

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the action for an observation (n_obs,) or the actions for a batch of them (n, n_obs), and `state`.

        A policy has no memory: `state` and `episode_start` have no effect. Unlike in stable-baselines3, deterministic
        is the default, as in its evaluation.
        """
        with np.errstate(over="ignore"):  # beyond float32 is not finite
            seen = array("observation", observation).astype(np.float32, copy=False)
        if seen.ndim == 0 or seen.shape[-1] != self.inputs:
            raise ValueError(f"the policy takes {self.inputs} numbers, the observation has the shape {seen.shape}")
        if not np.isfinite(seen).all():
            raise ValueError("the observation must be finite")
        action = self.network.read(self.network.mean, seen)
        if not deterministic:
            sigma = np.exp(self.network.read(self.network.log_std, seen))
            noise = sigma * self._noise.standard_normal(action.shape, np.float32)
            action = (action + noise).astype(np.float32)
        return np.clip(action, np.float32(-1.0), np.float32(1.0)), state

    def differs_in(self, task: Task) -> list[str]:
        """Return the arguments in which a task differs from the one that the policy was trained for."""
        return [name for name in self.task.differs_in(task) if name not in MAY_DIFFER]

    def warn_if_elsewhere(self, task: Task) -> None:
        """Warn, once, if a task differs from the one that the policy was trained for."""
        other = [] if self._warned else self.differs_in(task)
        if other:
            self._warned = True
            differs = f"which differs in {', '.join(other)}"
            warnings.warn(f"the policy was trained for another environment, {differs}", stacklevel=3)

    def save(self, path: Path | str) -> Path:
        """Write the policy to `path` atomically."""
        return Ensemble([self], self.seed).save(path)

    def to_bytes(self) -> bytes:
        """Return the file that `save` writes."""
        file = io.BytesIO()
        archive.save(file, FORMAT, *Ensemble([self], self.seed).packed())
        return file.getvalue()


@dataclass(frozen=True)
class Ensemble:
    """The policies of a set-up's seeds, all for the same environment; one of them represents the set-up."""

    policies: Sequence[Policy]
    chosen: int  # seed of the policy that represents them

    def __post_init__(self) -> None:
        seeds = [policy.seed for policy in self.policies]
        if self.chosen not in seeds or len(set(seeds)) < len(seeds):
            raise ValueError(f"policies must have different seeds, {shown(self.chosen)} among them, got {seeds}")
        kinds = [(policy.task, policy.network.description()) for policy in self.policies]
        if any(kind != kinds[0] for kind in kinds):
            raise ValueError("policies of an ensemble must have one environment and one kind of network")

    def __getitem__(self, seed: int | None) -> Policy:
        """The policy of a seed, or the chosen one."""
        by_seed = {policy.seed: policy for policy in self.policies}
        if (wanted := self.chosen if seed is None else whole("seed", seed, at_least=0)) not in by_seed:
            raise ValueError(f"seed must be one of {[*by_seed]}, got {seed!r}")
        return by_seed[wanted]

    def save(self, path: Path | str) -> Path:
        """Write all policies to `path` atomically."""
        archive.write_archive(Path(path), FORMAT, *self.packed())
        return Path(path)

    def packed(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return content and arrays of an archive."""
        chosen = self[None]
        content = {
            "network": chosen.network.description(),
            "environment": chosen.environment,
            "observation": observation_table(chosen.task),
            "action": action_table(chosen.task),
            "provenance": {str(policy.seed): policy.provenance for policy in self.policies},
            "chosen": self.chosen,
        }
        weights = {policy.seed: to_arrays(policy.network) for policy in self.policies}
        return content, {f"{seed}/{name}": array for seed, own in weights.items() for name, array in own.items()}

    @classmethod
    def unpacked(cls, content: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> "Ensemble":
        """Return the ensemble that was packed.

        Raises:
            ValueError, LookupError, TypeError: it is no ensemble, or was made for other scales than this version has.
        """
        task = Task(**without_files(content["environment"]))
        tables = observation_table(task), action_table(task)
        if (content["observation"], content["action"]) != tables:
            raise ValueError("it was made for other scales of observation or action than this version's environment")
        weights: dict[str, dict[str, NDArray[Any]]] = {seed: {} for seed in content["provenance"]}
        for name, weight in arrays.items():
            seed, _, part = name.partition("/")
            weights[seed][part] = weight
        networks = {seed: from_arrays(content["network"], own) for seed, own in weights.items()}
        policies = [Policy(networks[seed], task, how) for seed, how in content["provenance"].items()]
        return cls(policies, content["chosen"])


def observation_table(task: Task) -> list[dict[str, Any]]:
    """Return id, unit and scale of each number of the observation."""
    scale = ("low", "high", "scaled_low", "curve")
    return [
        {"id": entry.id, "unit": entry.unit, **{name: getattr(entry.scale, name) for name in scale}}
        for entry in ObservationSpec(task).entries
    ]


def action_table(task: Task) -> list[dict[str, Any]]:
    """Return id, unit and range of each number of the action."""
    fields = ("id", "unit", "low", "high")
    return [{name: getattr(entry, name) for name in fields} for entry in ActionSpec(task).entries]


def load_ensemble(name: str | Path) -> Ensemble:
    """Return the policies of all seeds of a set-up that is shipped, by name, or those in a file or a run folder.

    Raises:
        TypeError, ValueError: neither a shipped policy, which it lists, nor a file; or the file is no policy, or is
            damaged, or was made for other scales than the environment has.
    """
    path = named_file("policy", name, SHIPPED, ".npz", "best.npz")
    content, arrays = archive.read_archive(path, FORMAT)
    try:
        return Ensemble.unpacked(content, arrays)
    except (ArithmeticError, LookupError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{path} is no policy of this version: {reason(error)}") from error


def load_policy(name: str | Path, seed: int | None = None) -> Policy:
    """Return a policy shipped with the project, by name, or from a file, or the best one of a run folder.

    Args:
        name: of what is shipped, or a path.
        seed: of its training, if there are several; None: the chosen one.

    Raises:
        ValueError: as `load_ensemble`, or there is no such seed.
    """
    return load_ensemble(name)[seed]


def policy_from_bytes(content: bytes) -> Policy:
    """Return the policy in the bytes of `Policy.to_bytes`."""
    return Ensemble.unpacked(*archive.load(io.BytesIO(content), FORMAT))[None]
