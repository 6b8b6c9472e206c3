"""Policies: trained networks as plain arrays, without torch.

A policy file is an archive, see `impact_gym.support.archive`. It holds the weights of a small network for each
training seed, the scales of observation and action, and the provenance.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from agents.policies.networks import Network, from_arrays, to_arrays
from impact_gym.support.archive import archive_of, read_archive
from impact_gym.support.files import named_file, reason, write_file
from impact_gym.support.validation import array, shown, whole
from impact_gym.task import ObservationSpec, Task
from impact_gym.teleop.channels import without_files

SHIPPED = Path(__file__).parent
FORMAT = "impact_gym policies 3"
MAY_DIFFER = ("scenario", "time_weight", "privileged", "rtol", "max_episode_steps")
"""Arguments that may differ from those of the training without a warning."""


class Controller(Protocol):
    """Anything with the method `predict` of stable-baselines3."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Return the actions and the controller's next state."""


class Policy:
    """A network and the environment of its training, with the method `predict` of stable-baselines3."""

    def __init__(self, network: Network, task: Task, provenance: Mapping[str, Any]) -> None:
        """Make a policy.

        Args:
            network: network from the scaled observation to the action in [-1, 1].
            task: task of the environment.
            provenance: origin of the policy, as JSON: command, settings with the seed of the training, versions.

        Raises:
            ValueError: the network does not fit the environment.
        """
        self.network, self.task, self.provenance = network, task, dict(provenance)
        self.environment = task.arguments()
        self.seed = int(self.provenance.get("settings", {}).get("seed", 0))
        self.spec, self.inputs, self.actions = ObservationSpec(task), network.layers()[0].inputs, len(task.action)
        if self.inputs != len(self.spec):
            raise ValueError(f"the network takes {self.inputs} numbers, the observation has {len(self.spec)}")
        if network.mean.outputs != self.actions:
            raise ValueError(f"the network gives {network.mean.outputs} numbers, an action has {self.actions}")
        self._noise = np.random.default_rng()
        self._warned = False

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the action for an observation (n_obs,), or the actions for a batch (n, n_obs), and `state`.

        A policy has no memory: `state` and `episode_start` have no effect. Unlike in stable-baselines3, actions are
        deterministic by default.
        """
        with np.errstate(over="ignore"):  # a number too large for float32 becomes infinite
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

    def warn_if_elsewhere(self, task: Task) -> None:
        """Warn, once, if a task differs from the policy's task in arguments other than MAY_DIFFER."""
        other = [name for name in self.task.differs_in(task) if name not in MAY_DIFFER]
        if other and not self._warned:
            self._warned = True
            differs = f"which differs in {', '.join(other)}"
            warnings.warn(f"the policy was trained for another environment, {differs}", stacklevel=3)

    def save(self, path: Path | str) -> Path:
        """Write the policy to `path` atomically."""
        return write_file(Path(path), self.to_bytes())

    def to_bytes(self) -> bytes:
        """Return the content of the file that `save` writes."""
        return archive_of(FORMAT, *Ensemble([self], self.seed).packed())


@dataclass(frozen=True)
class Ensemble:
    """Policies for one environment, trained with different seeds; the policy with the seed `chosen` represents them."""

    policies: Sequence[Policy]
    chosen: int  # seed of the chosen policy

    def __post_init__(self) -> None:
        seeds = [policy.seed for policy in self.policies]
        if self.chosen not in seeds or len(set(seeds)) < len(seeds):
            raise ValueError(f"the policies' seeds must differ and include chosen = {shown(self.chosen)}, got {seeds}")
        kinds = [(policy.task, policy.network.description()) for policy in self.policies]
        if any(kind != kinds[0] for kind in kinds):
            raise ValueError("policies of an ensemble must have the same environment and the same kind of network")

    def __getitem__(self, seed: int | None) -> Policy:
        """Return the policy of a seed; None: the chosen policy."""
        by_seed = {policy.seed: policy for policy in self.policies}
        if (wanted := self.chosen if seed is None else whole("seed", seed, at_least=0)) not in by_seed:
            raise ValueError(f"seed must be one of {[*by_seed]}, got {seed!r}")
        return by_seed[wanted]

    def save(self, path: Path | str) -> Path:
        """Write all policies to `path` atomically."""
        return write_file(Path(path), archive_of(FORMAT, *self.packed()))

    def packed(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return content and arrays of the archive."""
        chosen = self[None]
        content = {
            "network": chosen.network.description(),
            "environment": chosen.environment,
            **scales(chosen.task),
            "provenance": {str(policy.seed): policy.provenance for policy in self.policies},
            "chosen": self.chosen,
        }
        weights = {policy.seed: to_arrays(policy.network) for policy in self.policies}
        return content, {f"{seed}/{name}": array for seed, own in weights.items() for name, array in own.items()}

    @classmethod
    def unpacked(cls, content: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> "Ensemble":
        """Return the ensemble from the content and arrays that `packed` returns."""
        task = Task.of_file(without_files(content["environment"]))
        if any(content[name] != table for name, table in scales(task).items()):
            raise ValueError("it was made for other scales of observation or action than those of this version")
        weights: dict[str, dict[str, NDArray[Any]]] = {seed: {} for seed in content["provenance"]}
        for name, weight in arrays.items():
            seed, _, part = name.partition("/")
            weights[seed][part] = weight
        networks = {seed: from_arrays(content["network"], own) for seed, own in weights.items()}
        policies = [Policy(networks[seed], task, how) for seed, how in content["provenance"].items()]
        return cls(policies, content["chosen"])


def scales(task: Task) -> dict[str, list[dict[str, Any]]]:
    """Return id, unit and scale of each number of `observation` and of `action`."""
    scale, action = ("low", "high", "scaled_low", "curve"), ("id", "unit", "low", "high")
    return {
        "observation": [
            {"id": entry.id, "unit": entry.unit, **{name: getattr(entry.scale, name) for name in scale}}
            for entry in ObservationSpec(task).entries
        ],
        "action": [{name: getattr(entry, name) for name in action} for entry in task.action.entries],
    }


def load_ensemble(name: str | Path) -> Ensemble:
    """Return all policies of a shipped set-up (by name) or of a file, or the best policy of a run folder.

    Raises:
        TypeError, ValueError: `name` is no shipped policy, file or run folder; or the file is no policy, is damaged, or
            has other scales of observation or action than this version.
    """
    path = named_file("policy", name, SHIPPED, ".npz", "best.npz")
    content, arrays = read_archive(path, FORMAT)
    try:
        return Ensemble.unpacked(content, arrays)
    except (ArithmeticError, LookupError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{path} is no policy of this version: {reason(error)}") from error


def load_policy(name: str | Path, seed: int | None = None) -> Policy:
    """Return a shipped policy (by name), a policy from a file, or the best policy of a run folder.

    Args:
        name: name of a shipped policy, or a path.
        seed: seed of the training; None: the chosen policy.

    Raises:
        TypeError, ValueError: as `load_ensemble`, or there is no policy with this seed.
    """
    return load_ensemble(name)[seed]
