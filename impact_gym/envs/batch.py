"""The batch behind every front end: arrays of rows and the two kernels that move them."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.envs import observation
from impact_gym.envs.episode import begin_rows, step_rows
from impact_gym.envs.records import DRAWS, RECORD
from impact_gym.envs.rows import EPISODE
from impact_gym.envs.scenario import FIELDS, ScenarioRanges
from impact_gym.envs.task import Task
from impact_gym.kernel import require_compiled
from impact_gym.solver.state import CHAIN, SENTENCES, Status, recorder
from impact_gym.threads import cores, over_rows
from impact_gym.validation import WrongTypeError, whole

ROWS_PER_THREAD = 256
"""A batch is cut for several threads only into pieces of at least this many rows: smaller ones do not pay."""

REWARD_TERMS = {"time": "time_cost", "velocity": "velocity_cost", "force": "force_cost", "missed": "missed_cost"}
"""Names in `info["reward_terms"]`, each the negative of a cost summed over the episode."""

_STATE = ("chains", "episodes", "readings", "observations", "rewards")


class Batch:
    """`size` environments of one task, each a row that no other row can touch.

    The results of a row do not depend on the size of the batch, on its place in it or on the number of threads.
    """

    def __init__(self, size: int, task: Task, threads: int | None = None) -> None:
        require_compiled()
        self.size = size
        self.task = task
        self.law = task.law()
        self.constants = task.constants()
        self.threads = cores() if threads is None else whole("threads", threads, at_least=1)
        self.recorder = recorder()  # records nothing; a batch of one may be given another
        self.observation_space = observation.space(self.constants)
        self.chains = np.zeros(size, CHAIN)
        self.episodes = np.zeros(size, EPISODE)
        self.readings = np.zeros((size, task.readings_under_way() + 4, 4))
        self.observations = np.zeros((size, observation.length(self.constants)), np.float32)
        self.rewards = np.zeros(size)
        self.set_scenario(task.ranges)

    def set_scenario(self, ranges: ScenarioRanges) -> None:
        """Draw from `ranges` from the next episode on."""
        self.ranges = ranges
        self._table = self.task.draw_table(ranges)

    def begin(self, rows: NDArray[np.int64], uniforms: NDArray[np.float64], fixed: NDArray[np.float64]) -> None:
        """Begin an episode in each of `rows` (k,) with `uniforms` (k, DRAWS) in [0, 1) and `fixed` (k, 9) or nan."""
        begin_rows(
            self.law,
            self.constants,
            self._table,
            uniforms,
            fixed,
            rows,
            self.chains,
            self.episodes,
            self.readings,
            self.observations,
        )

    def draw_and_begin(
        self, rows: NDArray[np.int64], generators: list[np.random.Generator], fixed: NDArray[np.float64] | None = None
    ) -> None:
        """Begin an episode in each of `rows`, each with its own generator; `fixed` (9,) or one of these per row."""
        uniforms = np.empty((len(rows), DRAWS))
        for uniform, row in zip(uniforms, rows.tolist(), strict=True):
            generators[row].random(out=uniform)
        table = np.full((len(rows), len(RECORD)), math.nan)
        if fixed is not None:
            table[:] = fixed
        self.begin(rows, uniforms, table)

    def step(self, actions: NDArray[Any], skip: NDArray[np.bool_]) -> None:
        """Play a control step with `actions` (size, 2), but where `skip` (size,) is set.

        Leaves `observations`, `rewards` and the fields of `episodes` as they are after it.
        """

        def run(first: int, last: int) -> None:
            step_rows(
                self.law,
                self.constants,
                actions,
                skip,
                first,
                last,
                self.chains,
                self.episodes,
                self.readings,
                self.recorder,
                self.observations,
                self.rewards,
            )

        over_rows(run, self.size, self.threads, ROWS_PER_THREAD)

    def commands(self, actions: Any, shape: tuple[int, ...]) -> NDArray[Any]:
        """Return `actions`, which must have `shape`, as a float array (size, 2), or raise before anything is stepped.

        Raises:
            TypeError, ValueError: not numbers, another shape, or not finite.
        """
        array = np.asarray(actions)
        if array.dtype != np.float32:
            if array.dtype.kind not in "fiu":
                raise WrongTypeError(f"action must hold numbers, got dtype {array.dtype}")
            array = array.astype(np.float64)
        if array.shape != shape:
            raise ValueError(f"action must have shape {shape}, got {array.shape}")
        array = array.reshape(self.size, 2)
        if not np.isfinite(array).all():
            raise ValueError(f"action must be finite, got {array[~np.isfinite(array).all(axis=1)][0]}")
        return array

    def get_state(self) -> dict[str, Any]:
        """Return a copy of all that `step` and `begin` go on from: arrays, and the ranges as plain numbers."""
        return {"ranges": self.ranges.table().tolist(), **{name: getattr(self, name).copy() for name in _STATE}}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go on from what `get_state` of a batch of this size and task returned, to the bit.

        Raises:
            ValueError: an array is not what this batch has.
        """
        for name in _STATE:
            here, there = getattr(self, name), state[name]
            if there.shape != here.shape or there.dtype != here.dtype:
                raise ValueError(
                    f"{name} of another batch: {there.dtype}{there.shape}, this one has {here.dtype}{here.shape}"
                )
        self.set_scenario(ScenarioRanges(*map(tuple, state["ranges"])))
        for name in _STATE:
            getattr(self, name)[:] = state[name]

    def info(self, row: int | None = None) -> dict[str, Any]:
        """Return what an episode has come to so far: plain numbers of one row, or arrays (size,) of all.

        The arrays share memory with the batch; copy what is to last.
        """
        episodes: Any = self.episodes
        chains: Any = self.chains
        if row is not None:
            episodes = dict(zip(EPISODE.names or (), self.episodes.item(row), strict=True))
            chains = dict(zip(CHAIN.names or (), self.chains.item(row), strict=True))
        return {
            "object_velocity": episodes["object_velocity"],
            "approach_time": episodes["approach_time"],
            "peak_force": chains["peak_force"],
            "contact_count": chains["contacts"],
            "missed": (episodes["terminated"] == 1) & (chains["contacts"] == 0),
            "time_weight": episodes["time_weight"],
            "reward_terms": {name: -episodes[cost] for name, cost in REWARD_TERMS.items()},
            "scenario": {name: episodes[name] for name in FIELDS},
            "record": {name: episodes[name] for name in RECORD},
            "status": _sentences(episodes["status"]),
        }


def _sentences(status: Any) -> Any:
    if np.ndim(status) == 0:
        return SENTENCES[Status(status)] if status < 0 else "ok"
    if (status >= 0).all():
        return np.full(status.shape, "ok", object)
    return np.array([_sentences(one) for one in status.tolist()], object)
