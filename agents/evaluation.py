"""Playing a controller through numbered scenarios, the same for every controller."""

from dataclasses import dataclass
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import impact_gym  # noqa: F401  # registers the environment

VALIDATION_SEED = 1_000_000
TEST_SEED = 2_000_000
"""Scenario k of a set is what an environment seeded with the set's seed + k draws first. Training seeds stay below."""


class Controller(Protocol):
    """Anything that acts as a policy of stable-baselines3 does."""

    def predict(self, observation: Any, state: Any = None, **options: Any) -> tuple[Any, Any]:
        """Return actions and the controller's next state."""


@dataclass(frozen=True)
class Episodes:
    """Results of one controller, an array entry per scenario."""

    object_velocity: NDArray[np.float64]  # m/s, V_p
    approach_time: NDArray[np.float64]  # s
    peak_force: NDArray[np.float64]  # N
    contact_count: NDArray[np.int64]
    missed: NDArray[np.bool_]
    scenario: dict[str, NDArray[np.float64]]

    def cost(self, time_weight: float) -> NDArray[np.float64]:
        """V_p + time_weight * approach time, m/s, per scenario."""
        return self.object_velocity + time_weight * self.approach_time


def evaluate(controller: Controller, seed: int, count: int, **options: Any) -> Episodes:
    """Play `controller` through scenarios `seed` ... `seed + count - 1`, all at once.

    `options` go to the environment. The result for a scenario depends on its seed and the controller alone, as long
    as the controller's action for an observation does not depend on those beside it (`Policy` sees to that; a matrix
    product of BLAS rounds differently in batches of different size).

    Raises:
        RuntimeError: the solver failed in a scenario; names it.
    """
    envs = gym.make_vec("ImpactApproach-v0", num_envs=count, **{"scenario": "test", **options})
    observations, _ = envs.reset(seed=seed)
    results: dict[str, Any] = {}
    open_rows = np.ones(count, np.bool_)
    state, start = None, np.ones(count, np.bool_)
    while open_rows.any():
        actions, state = controller.predict(observations, state=state, episode_start=start, deterministic=True)
        observations, _, terminated, truncated, infos = envs.step(actions)
        start = terminated | truncated
        first_end = start & open_rows
        if first_end.any():
            _keep(results, infos, first_end)
            open_rows &= ~first_end
    failed = np.flatnonzero(results["status"] != "ok")
    if failed.size:
        raise RuntimeError(f"scenario seeded {seed + int(failed[0])}: {results['status'][failed[0]]}")
    fields = ("object_velocity", "approach_time", "peak_force", "contact_count", "missed", "scenario")
    return Episodes(**{name: results[name] for name in fields})


def _keep(results: dict[str, Any], infos: dict[str, Any], rows: NDArray[np.bool_]) -> None:
    """Copy `rows` of the final infos into `results`."""
    for name, value in infos.items():
        if name.startswith("_"):
            continue
        if isinstance(value, dict):
            _keep(results.setdefault(name, {}), value, rows)
        else:
            results.setdefault(name, np.zeros_like(value))[rows] = value[rows]
