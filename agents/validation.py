"""The frozen validation set, played at several time weights: the number that training is judged and chosen by.

It is never the test set of the report. The score is the cost of the environment, V_p + w T, and the missed cost.
"""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from impact_gym.envs import evaluation_sets
from impact_gym.envs.batch import Batch
from impact_gym.envs.records import free_record
from impact_gym.envs.scenario import FIELDS
from impact_gym.envs.task import MISSED_COST, Task

WEIGHTS = (0.7, 1.0, 2.0, 4.0)  # m/s per s
SCENARIOS = 1000


class Controller(Protocol):
    """Anything that acts as a policy of stable-baselines3 does."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Return actions and the controller's next state."""


class Validation:
    """Plays controllers through the validation set, each scenario at each of WEIGHTS, all at once."""

    def __init__(self, environment: Mapping[str, Any], scenarios: int = SCENARIOS, threads: int | None = None) -> None:
        """Make a validation.

        Args:
            environment: arguments of the environment but for its time weight. With a `scenario` of its own it draws
                its own ones from the seeds of the set.
            scenarios: how many of the set, from its first on.
            threads: of the simulation; they change no result.
        """
        frozen = evaluation_sets.load("validation")
        scenarios = min(scenarios, frozen.count)
        rows = scenarios * len(WEIGHTS)
        fixed = free_record(rows)
        for name in () if "scenario" in environment else FIELDS:
            fixed[name] = np.tile(frozen.scenario[name][:scenarios], len(WEIGHTS))
        fixed["time_weight"] = np.repeat(WEIGHTS, scenarios)
        self._fixed, self._scenarios, self._seed = fixed, scenarios, frozen.seed
        self._batch = Batch(rows, Task(**environment), threads)

    def play(self, controller: Controller) -> dict[str, Any]:
        """Return the means over the scenarios at each time weight, and their mean cost, the `score` (m/s)."""
        batch = self._batch
        generators = [seeding.np_random(self._seed + row % self._scenarios)[0] for row in range(batch.size)]
        batch.draw_and_begin(np.arange(batch.size), generators, self._fixed)
        ended, start = np.zeros(batch.size, np.bool_), np.ones(batch.size, np.bool_)
        actions = np.zeros((batch.size, 2), np.float32)
        state: Any = None
        while not ended.all():
            actions[:], state = controller.predict(batch.observations, state=state, episode_start=start)
            batch.step(actions, ended)
            ended = (batch.episodes["terminated"] == 1) | (batch.episodes["truncated"] == 1)
            start[:] = False
        info = batch.info()
        if (info["status"] != "ok").any():
            raise RuntimeError(f"the solver failed on the validation set: {set(info['status'])}")
        return _means(info, self._scenarios)


def _means(info: Mapping[str, NDArray[Any]], scenarios: int) -> dict[str, Any]:
    table = {
        name: np.reshape(info[name], (len(WEIGHTS), scenarios)).mean(axis=1)
        for name in ("object_velocity", "approach_time", "missed")
    }
    costs = table["object_velocity"] + np.array(WEIGHTS) * table["approach_time"] + MISSED_COST * table["missed"]
    means: dict[str, Any] = {name: values.tolist() for name, values in table.items()}
    return {"score": float(costs.mean()), "time_weight": list(WEIGHTS), "cost": costs.tolist(), **means}


def velocity_at(result: Mapping[str, Any], approach_time: float) -> float:
    """Return V_p (m/s) at `approach_time` (s) on the straight lines between the points of a validation; nan outside."""
    order = np.argsort(result["approach_time"])
    times, velocities = np.array(result["approach_time"])[order], np.array(result["object_velocity"])[order]
    return float(np.interp(approach_time, times, velocities, left=np.nan, right=np.nan))
