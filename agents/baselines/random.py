"""Random actions, and random errors on a rule's actions."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policies import Controller
from impact_gym.task import ActionSpec, Task


class RandomActions:
    """Draw every action uniformly from the action space of a task."""

    def __init__(self, seed: int = 0, task: Task | None = None) -> None:
        """Make a controller; default task: that of `ImpactApproach-v0`."""
        self._rng, self._size = np.random.default_rng(seed), len(ActionSpec(task or Task()))

    def for_task(self, task: Task) -> "RandomActions":
        """Return a new controller for another task, with seed 0."""
        return RandomActions(task=task)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Return an action (k,), or the actions (n, k) of a batch."""
        return self._rng.uniform(-1.0, 1.0, (*np.shape(observation)[:-1], self._size)).astype(np.float32), state


class Jittery:
    """A rule with random errors on its actions, the same for all candidates of a search in a scenario.

    With these errors the search avoids parameters that work only if the arm follows commands exactly.
    """

    def __init__(self, rule: Controller, jitter: float, scenarios: int, rng: np.random.Generator) -> None:
        """Wrap a rule; `jitter` is the standard deviation of the errors, as a fraction of an action's range of 2."""
        self._rule, self._scale, self._scenarios, self._rng = rule, 2.0 * jitter, scenarios, rng

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Return the rule's actions (n, k) with errors, and its next state."""
        actions, state = self._rule.predict(observation, state, episode_start, deterministic)
        off = self._rng.normal(0.0, self._scale, (self._scenarios, actions.shape[-1]))
        return actions + np.tile(off, (len(actions) // self._scenarios, 1)), state
