"""Numbered scenarios, the same for every controller, and the results of a controller that plays them."""

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
from impact_gym.task.evaluation_sets import EvaluationSet
from impact_gym.task.task import MISSED_COST

VALIDATION_SEED = 1_000_000
TEST_SEED = 2_000_000
TUNING_SEED = 4_000_000
"""Scenario k of a set is the first draw of an environment seeded with the set's seed + k. Baselines are tuned with
TUNING_SEED. Trainings have larger seeds, from `agents.train.ppo.FIRST_SEED` on."""
RESULTS = tuple(row.id for row in quantities.RESULTS)
MEASURED = (*RESULTS, *SLIDE, *LINKED)
"""Names of the results of an episode, see `Episodes`. SLIDE exists only with friction, LINKED only with an operator."""


@dataclass(frozen=True)
class Episodes:
    """Results of one controller; each array has an entry for each row of the batch."""

    object_velocity: NDArray[np.float64]  # m/s, V_p: the object's final velocity; with friction, its largest velocity
    approach_time: NDArray[np.float64]  # s, time until the touch, else the horizon; with an operator, `done_time`
    peak_force: NDArray[np.float64]  # N, largest contact force
    contact_count: NDArray[np.int64]
    missed: NDArray[np.bool_]
    scenario: dict[str, NDArray[np.float64]]
    missed_cost: float = MISSED_COST  # m/s, charge for a missed object
    slide: NDArray[np.float64] | None = None  # m, distance that the object slides; None: no friction
    rest_time: NDArray[np.float64] | None = None  # s, time when the object comes to rest; None: no friction
    done_time: NDArray[np.float64] | None = None  # s, end of the last control step; None: no operator
    withheld_share: NDArray[np.float64] | None = None  # -, of the operator's motion before the touch
    touch_time: NDArray[np.float64] | None = None  # s, time of the first contact, else the horizon; None: no operator
    stop_delay: NDArray[np.float64] | None = None  # s, mean time from a touch until the operator's stop reaches the arm

    def loss(self, time_weight: float | NDArray[np.float64]) -> NDArray[np.float64]:
        """Return V_p + time_weight * approach time, plus the charge for a missed object, m/s, for each row."""
        return self.object_velocity + time_weight * self.approach_time + self.missed_cost * self.missed


class ScenarioBatch:
    """Numbered scenarios that a controller plays at the same time."""

    def __init__(
        self, scenarios: EvaluationSet | int, count: int, task: Task | None = None, *, copies: int = 1,
        time_weight: Sequence[float] | None = None, threads: int | None = None, quiet: bool = False,
        lenient: bool = False, max_steps: int = MAX_STEPS, trace_points: int = 0,
    ) -> None:  # fmt: skip
        """Make a batch of `copies * count` rows: row k plays scenario `k % count`.

        Args:
            scenarios: an evaluation set. Or a seed: scenario k is the first draw of an environment seeded `seed + k`.
            count: number of scenarios.
            task: task of all rows; None: the default task.
            copies: number of copies of each scenario.
            time_weight: time weight of each copy, m/s per s; None: as in the task.
            threads: number of threads, without effect on the results.
            quiet: do not warn if a policy was trained for another environment.
            lenient: raise no error for a scenario whose status is not "ok", but count it as missed.
            max_steps: number of integration steps after which the solver gives up a scenario.
            trace_points: largest number of points in the time histories of a row.
        """
        frozen = scenarios if isinstance(scenarios, EvaluationSet) else EvaluationSet(scenarios, count, {})
        self.seed, self.count, self.quiet, self.lenient = frozen.seed, count, quiet, lenient
        self._task, self._copies = task or Task(), copies
        self.batch = Batch(copies * count, self._task, threads, trace_points, max_steps)
        if frozen.count < count:
            raise ValueError(f"count must be at most the {frozen.count} scenarios of the set, got {count}")
        self._fixed = {name: np.tile(values[:count], copies) for name, values in frozen.scenario.items()}
        if time_weight is not None:
            self._fixed["time_weight"] = np.repeat(time_weight, count)

    @classmethod
    def of(cls, name: str, count: int | None = None, task: Task | None = None, **options: Any) -> "ScenarioBatch":
        """Return a batch of the evaluation set `name`, or its first `count` scenarios. `options` go to `ScenarioBatch`.

        If the task has its own `scenario` ranges, the scenarios are drawn from these ranges, with the seeds of the set.
        """
        frozen = evaluation_sets.load(name)
        own = task is not None and "scenario" in task.arguments()
        count = frozen.count if count is None else count
        return cls(frozen.seed if own else frozen, count, task, **options)

    def play(
        self, controller: Controller, record: Mapping[str, ArrayLike] | None = None,
        watch: Callable[[Bodies], None] | None = None,
    ) -> Episodes:  # fmt: skip
        """Play the episode of every row to its end.

        Args:
            controller: controller that plays.
            record: arrays (copies * count,) that replace drawn numbers, by the name in an episode's record. A number
                of tool, coupling or robot can only be replaced if the task has a range for this number.
            watch: function that gets the motion of the bodies before each control step.

        Raises:
            RuntimeError: the status of a scenario is not "ok", and `lenient` is false.
        """
        batch = self.batch
        if isinstance(controller, Policy) and not self.quiet:
            controller.warn_if_elsewhere(self._task)
        batch.begin_seeded(self.seed, {**self._fixed, **(record or {})}, self._copies)
        start, state = np.ones(batch.size, np.bool_), None
        actions = np.zeros((batch.size, len(batch.action_spec)))
        while not (ended := batch.ended).all():
            if watch is not None:
                watch(batch.bodies())
            if isinstance(controller, Policy):  # a policy has no memory, so ended rows can be left out
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
            raise RuntimeError(f"scenario with seed {self.seed + row % self.count}: {info['status'][row]}")
        scenario = {name: values.copy() for name, values in info["scenario"].items()}
        results = {name: np.array(info[name]) for name in MEASURED if name in info}
        results["missed"] |= failed
        results["approach_time"] = results.get("done_time", results["approach_time"])
        return Episodes(**results, scenario=scenario, missed_cost=self._task.missed_cost)


class Validation:
    """Scenarios of the evaluation set `validation`, at several time weights."""

    def __init__(self, task: Task, weights: Sequence[float], scenarios: int, **options: Any) -> None:
        """Take the first `scenarios` of the set, each at all `weights` (m/s per s). `options` go to `ScenarioBatch`."""
        self.weights, count = tuple(weights), min(scenarios, evaluation_sets.load("validation").count)
        options |= {"copies": len(self.weights), "time_weight": self.weights, "lenient": True}
        self.batch = ScenarioBatch.of("validation", count, task, **options)

    def score(self, controller: Controller) -> dict[str, Any]:
        """Return the means over the scenarios at each time weight; `score` (m/s) is the mean loss over all weights."""
        played = self.batch.play(controller)
        columns = {"cost": played.loss(np.repeat(self.weights, self.batch.count))}
        columns |= {name: getattr(played, name) for name in ("object_velocity", "approach_time", "missed")}
        means = {name: values.reshape(len(self.weights), -1).mean(axis=1) for name, values in columns.items()}
        table = {name: values.tolist() for name, values in means.items()}
        return {"score": float(means["cost"].mean()), "time_weight": list(self.weights), **table}


WITHIN_STEP = (0.25, 0.5, 0.75, 1.0)
"""Fractions of a control step at which `Travel` evaluates a cubic interpolation of the deflection."""


class Travel:
    """Largest change (m) of each row's deflection since the start: `deflection` until the touch, `stroke` until now."""

    def __init__(self, rows: int) -> None:
        self.deflection, self.stroke = np.zeros(rows), np.zeros(rows)
        self._rest = np.zeros(rows)
        self._before: Bodies | None = None

    def __call__(self, now: Bodies) -> None:
        """Update with the present motion. Pass this object as `watch` to `ScenarioBatch.play`."""
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
