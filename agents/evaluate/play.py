"""Let a controller play scenarios; all arguments are plain data, so that a job can send them to another machine.

Scenarios are given in one of three forms. `{"set": name, "count": n}`: the first n of a shipped frozen set. `{"table":
{field: values}, "seed": s, "count": n}`: the scenarios in the table. `{"ranges": {field: pair}, "seed": s, "count":
n}`: the first draws of environments seeded s, s + 1, ...; "ranges" may also be the name of shipped ranges.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.evaluate.controllers import controller_of
from agents.evaluate.scenario_batch import MEASURED, ScenarioBatch
from impact_gym.task import ScenarioRanges, Task, evaluation_sets
from impact_gym.task.evaluation_sets import EvaluationSet
from impact_gym.task.scenario import FIELDS


def play(
    controller: Mapping[str, Any], scenarios: Mapping[str, Any], weights: Sequence[float] = (2.0,),
    environment: Mapping[str, Any] | None = None, lenient: bool = False,
) -> dict[str, NDArray[Any]]:  # fmt: skip
    """Return the results (weights, scenarios) at each time weight (m/s per s), and the scenarios' fields (scenarios,).

    `controller` is described as in `agents.evaluate.controllers`. `environment` must hold no scenario and no time
    weight. For `lenient` see `ScenarioBatch`.
    """
    with warnings.catch_warnings(action="ignore", category=UserWarning):  # about hard scenarios, which are intended
        task = Task(**(environment or {}))
        played = []
        for weight in weights:
            batch = scenario_batch_of(scenarios, weight, task, lenient)
            played.append(batch.play(controller_of(controller, weight, task)))
    measured = [name for name in MEASURED if getattr(played[0], name) is not None]
    return {name: np.array([getattr(each, name) for each in played]) for name in measured} | played[0].scenario


def environment_and_scenarios(
    environment: Mapping[str, Any], scenarios: Mapping[str, Any]
) -> tuple[dict[str, Any], Mapping[str, Any]]:
    """Return the arguments of an environment without its scenario, and the scenarios to play in it.

    If the environment has its own `scenario` ranges, the scenarios are drawn from these ranges, with the seed of the
    frozen set named in `scenarios`, and with the same count. The set `hard` is played unchanged.
    """
    arguments = {name: value for name, value in environment.items() if name != "scenario"}
    if "scenario" not in environment or scenarios.get("set", "hard") == "hard":
        return arguments, scenarios
    seed = evaluation_sets.load(scenarios["set"]).seed
    return arguments, {"ranges": pairs(environment["scenario"]), "seed": seed, "count": scenarios["count"]}


def pairs(ranges: Any) -> dict[str, list[float]]:
    """Return ranges of scenarios, given as a mapping or by name, as plain data: field to [low, high]."""
    return {name: list(pair) for name, pair in asdict(ScenarioRanges.of(ranges)).items()}


def scenario_batch_of(scenarios: Mapping[str, Any], weight: float, task: Task, lenient: bool = False) -> ScenarioBatch:
    """Return a batch that plays `scenarios` at a time weight (m/s per s)."""
    frozen = frozen_of(scenarios)
    if frozen is None:
        task = task.changed({"scenario": scenarios["ranges"]})
    seed = scenarios["seed"] if frozen is None else frozen.seed
    options: Any = {"time_weight": [weight], "frozen": frozen, "threads": 1, "quiet": True, "lenient": lenient}
    return ScenarioBatch(seed, scenarios["count"], task, **options)


def frozen_of(scenarios: Mapping[str, Any]) -> EvaluationSet | None:
    """Return scenarios as a frozen set; None if they are drawn from ranges."""
    if "table" in scenarios:
        table = {name: np.asarray(scenarios["table"][name], np.float64) for name in FIELDS}
        return EvaluationSet(scenarios["seed"], table)
    if "set" not in scenarios:
        return None
    return _shipped(scenarios["set"])


_shipped = lru_cache(maxsize=4)(evaluation_sets.load)  # a process reads each set once
