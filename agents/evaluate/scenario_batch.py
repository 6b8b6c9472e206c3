"""Numbered scenarios, the same for every controller, and the results of playing one through them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.policies import Controller, Policy
from impact_gym import quantities
from impact_gym.envs.batch import Batch, Bodies
from impact_gym.envs.infos import LINKED, SLIDE
from impact_gym.simulation import MAX_STEPS
from impact_gym.task import Task, evaluation_sets
from impact_gym.task.scenario import FIELDS
from impact_gym.task.task import MISSED_COST

VALIDATION_SEED = 1_000_000
TEST_SEED = 2_000_000
TUNING_SEED = 4_000_000
"""Scenario k of a set is the first one of an environment seeded with the set's seed + k. Baselines are tuned on the
third set; agents are trained with seeds above all of these, from `agents.train.ppo.FIRST_SEED` on."""


RESULTS = tuple(row.id for row in quantities.RESULTS)
MEASURED = (*RESULTS, *SLIDE, *LINKED)
"""Measured quantities of an episode, see `Episodes`; the last ones need friction or an operator."""


@dataclass(frozen=True)
class Episodes:
    """Results of one controller, an array entry per scenario."""

    object_velocity: NDArray[np.float64]  # m/s, V_p
    approach_time: NDArray[np.float64]  # s, the time that is charged: with an operator until it is done
    peak_force: NDArray[np.float64]  # N
    contact_count: NDArray[np.int64]
    missed: NDArray[np.bool_]
    scenario: dict[str, NDArray[np.float64]]
    missed_cost: float = MISSED_COST  # m/s
    slide: NDArray[np.float64] | None = None  # m, where there is friction
    rest_time: NDArray[np.float64] | None = None  # s, likewise
    done_time: NDArray[np.float64] | None = None  # s, where an operator commands; also the approach time then
    taken: NDArray[np.float64] | None = None  # -, likewise
    touch_time: NDArray[np.float64] | None = None  # s, likewise
    late: NDArray[np.float64] | None = None  # s, likewise, from a touch until the operator's stop reaches the arm

    def cost(self, time_weight: float | NDArray[np.float64]) -> NDArray[np.float64]:
        """V_p + time_weight * approach time, m/s, per scenario."""
        return self.object_velocity + time_weight * self.approach_time

    def loss(self, time_weight: float | NDArray[np.float64]) -> NDArray[np.float64]:
        """Cost and the environment's charge for a miss, m/s: minus the return."""
        return self.cost(time_weight) + self.missed_cost * self.missed

    def first(self, count: int) -> "Episodes":
        """Return the first `count` of them."""
        scenario = {name: values[:count] for name, values in self.scenario.items()}
        cut = {name: values[:count] for name in MEASURED if (values := getattr(self, name)) is not None}
        return Episodes(**cut, scenario=scenario, missed_cost=self.missed_cost)


class ScenarioBatch:
    """Numbered scenarios that controllers play, all at once."""

    def __init__(
        self, seed: int, count: int, task: Task | None = None, *, copies: int = 1,
        time_weight: Sequence[float] | None = None, frozen: evaluation_sets.EvaluationSet | None = None,
        threads: int | None = None, quiet: bool = False, lenient: bool = False, max_steps: int = MAX_STEPS,
    ) -> None:  # fmt: skip
        """Make a batch of `copies * count` rows: row k holds scenario `k % count` of its copy.

        Args:
            seed: of the first scenario; scenario k is what an environment seeded `seed + k` draws first.
            count: how many scenarios.
            task: of all rows; None: that of the environment without arguments.
            copies: how often each is there.
            time_weight: one for each copy, m/s per s; None: what the task says.
            frozen: the set that the scenarios are taken from, not drawn; its seed must be `seed`.
            threads: of the simulation; they change no result.
            quiet: do not warn of policies that were trained for another environment.
            lenient: a scenario whose status is not ok is missed, and no error: for a search that tries anything.
            max_steps: integration steps after which the solver gives up a scenario.
        """
        self.seed, self.count, self.quiet, self.lenient = seed, count, quiet, lenient
        self._task, self._copies, self._fixed = task or Task(), copies, {}
        self._batch = Batch(copies * count, self._task, threads, max_steps=max_steps)
        if frozen is not None:
            if frozen.seed != seed or frozen.count < count:
                raise ValueError(f"the set has {frozen.count} scenarios from {frozen.seed} on, not {count} from {seed}")
            self._fixed = {name: np.tile(frozen.scenario[name][:count], copies) for name in FIELDS}
        if time_weight is not None:
            self._fixed["time_weight"] = np.repeat(time_weight, count)

    @classmethod
    def of(cls, name: str, count: int | None = None, task: Task | None = None, **options: Any) -> "ScenarioBatch":
        """Return a batch of the frozen set `name`, or of its first `count` scenarios; `options` as above.

        A task with a `scenario` of its own draws its own ones instead, from the seeds of the set.
        """
        frozen = evaluation_sets.load(name)
        own = task is not None and "scenario" in task.arguments()
        return cls(
            frozen.seed, frozen.count if count is None else count, task, frozen=None if own else frozen, **options
        )

    def play(
        self,
        controller: Controller,
        record: Mapping[str, ArrayLike] | None = None,
        watch: Callable[[Bodies], None] | None = None,
    ) -> Episodes:
        """Play every row to its end.

        The result of a row depends on its scenario and the controller alone, as long as the controller's action for an
        observation does not depend on the other rows (that of a `Policy` does not; a matrix product of BLAS rounds
        differently in batches of different size). A policy that was trained for another environment warns once.

        Args:
            controller: what is played.
            record: numbers (copies * count,) that rows have instead of drawing them, by the name in an episode's
                record, such as `coupling.stiffness`; of the set-up only those that are drawn from a range.
            watch: called with the motion of the bodies before each control step.

        Raises:
            RuntimeError: the solver failed in a scenario, or it did not settle, unless the batch is `lenient`.
        """
        batch = self._batch
        if isinstance(controller, Policy) and not self.quiet:
            controller.warn_if_elsewhere(self._task)
        batch.begin_seeded(self.seed, {**self._fixed, **(record or {})}, self._copies)
        start, state = np.ones(batch.size, np.bool_), None
        actions = np.zeros((batch.size, len(batch.action_spec)))
        while not (ended := batch.ended).all():
            if watch is not None:
                watch(batch.bodies())
            if isinstance(controller, Policy):  # it remembers nothing: rows that have ended need no action
                actions[~ended], _ = controller.predict(batch.observations[~ended])
            else:
                seen = batch.observations.copy()
                actions, state = controller.predict(seen, state=state, episode_start=start, deterministic=True)
            batch.step(actions, ended)
            start = np.zeros(batch.size, np.bool_)
        info = batch.info()
        failed = info["status"] != "ok"
        if failed.any() and not self.lenient:
            row = int(failed.argmax())
            raise RuntimeError(f"scenario seeded {self.seed + row % self.count}: {info['status'][row]}")
        scenario = {name: values.copy() for name, values in info["scenario"].items()}
        results = {name: np.array(info[name]) for name in MEASURED if name in info}
        results["missed"] |= failed
        results["approach_time"] = results.get("done_time", results["approach_time"])
        return Episodes(**results, scenario=scenario, missed_cost=self._task.missed_cost)


class Validation(ScenarioBatch):
    """The frozen validation set at several time weights: its score judges trainings and selects the best policy.

    It is never the test set of the report. The score is the cost of the environment, V_p + w T, and the missed cost.
    Episodes that do not settle, as with half-trained policies, count as missed and end no training.
    """

    def __init__(self, task: Task, weights: Sequence[float], scenarios: int, **options: Any) -> None:
        """Make one of the first `scenarios`, each played at each of the time `weights` (m/s per s).

        A `task` with a scenario of its own draws its own ones from the seeds of the set; `options` as above.
        """
        frozen, own = evaluation_sets.load("validation"), "scenario" in task.arguments()
        self.weights, count = tuple(weights), min(scenarios, frozen.count)
        options |= {"frozen": None if own else frozen, "copies": len(self.weights), "time_weight": self.weights}
        super().__init__(frozen.seed, count, task, lenient=True, **options)

    def score(self, controller: Controller) -> dict[str, Any]:
        """Return the means over the scenarios at each time weight, and their mean cost, the `score` (m/s)."""
        played = self.play(controller)
        columns = {"cost": played.loss(np.repeat(self.weights, self.count))}
        columns |= {name: getattr(played, name) for name in ("object_velocity", "approach_time", "missed")}
        means = {name: values.reshape(len(self.weights), -1).mean(axis=1) for name, values in columns.items()}
        table = {name: values.tolist() for name, values in means.items()}
        return {"score": float(means["cost"].mean()), "time_weight": list(self.weights), **table}


WITHIN_STEP = (0.25, 0.5, 0.75, 1.0)
"""Shares of a control step at which `Travel` evaluates the tool's deflection, on the cubic through both ends."""


class Travel:
    """Largest deflection of the tool of each row, m: before the first touch, and in all, `stroke`."""

    def __init__(self, rows: int) -> None:
        self.deflection, self.stroke = np.zeros(rows), np.zeros(rows)
        self._rest = np.zeros(rows)
        self._before: Bodies | None = None

    def __call__(self, now: Bodies) -> None:
        """Take the present motion of the tools into account; see `watch` of `ScenarioBatch.play`."""
        before, self._before = self._before, now
        if before is None:
            self._rest = now.deflection
            return
        step = now.time - before.time
        for u in WITHIN_STEP:
            deflection = (
                (1.0 + 2.0 * u) * (1.0 - u) ** 2 * before.deflection
                + u * (1.0 - u) ** 2 * step * before.deflection_rate
                + u**2 * (3.0 - 2.0 * u) * now.deflection
                - u**2 * (1.0 - u) * step * now.deflection_rate
            )
            away = np.abs(deflection - self._rest)
            self.stroke = np.maximum(self.stroke, away)
            self.deflection = np.where(now.touched, self.deflection, np.maximum(self.deflection, away))
