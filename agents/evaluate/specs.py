"""Scenarios and controllers as plain data that can be sent to another machine, and what is made of them.

Scenarios have one of three forms. `{"set": name, "count": n}`: the first n of a shipped set. `{"table":
{field: values}, "seed": s, "count": n}`: the first n of the table, with the seeds s, s + 1, ... `{"ranges": ranges,
"seed": s, "count": n}`: the first draws of environments with these seeds; `ranges` is `{field: pair}` or a set's name.

A controller is a mapping with one key. `{"policy": text}`: a policy's file in base 64. `{"baseline": name}`: a shipped
baseline. `{"tuned": content}`: the content of a tuned baseline's file. `{"clairvoyant": {weight: parameters}}`: a
`Clairvoyant` with parameters for each scenario. `{"object": "module:name"}`: a controller, or a function or class that
returns a controller.
"""

import base64
from collections.abc import Callable, Mapping
from functools import lru_cache
from pkgutil import resolve_name
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.baselines import Clairvoyant, RandomActions, Rule, tuned_rule
from agents.baselines.rule import ANY
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.policies import Controller, Ensemble
from agents.policies.policy import FORMAT
from agents.setups import load_baseline
from impact_gym.support.archive import unpacked
from impact_gym.support.validation import shown
from impact_gym.task import ScenarioRanges, Task, evaluation_sets
from impact_gym.task.evaluation_sets import EvaluationSet
from impact_gym.task.scenario import FIELDS


def environment_and_scenarios(
    environment: Mapping[str, Any], scenarios: Mapping[str, Any]
) -> tuple[dict[str, Any], Mapping[str, Any]]:
    """Return the arguments of an environment without its scenario, and the scenarios to play.

    If the environment has its own `scenario` ranges, the scenarios are drawn from these ranges, with the seed of the
    set in `scenarios`. The set `hard`, and scenarios from a table or from ranges, stay unchanged.
    """
    arguments = {name: value for name, value in environment.items() if name != "scenario"}
    if "scenario" not in environment or scenarios.get("set", "hard") == "hard":
        return arguments, scenarios
    seed = evaluation_sets.load(scenarios["set"]).seed
    return arguments, {"ranges": pairs(environment["scenario"]), "seed": seed, "count": scenarios["count"]}


def pairs(ranges: Any) -> dict[str, list[float]]:
    """Return ranges of scenarios (a mapping or a name) as plain data: [low, high] by field."""
    return {name: list(pair) for name, pair in ScenarioRanges.of(ranges).by_id().items()}


def scenario_batch_of(scenarios: Mapping[str, Any], weight: float, task: Task, lenient: bool = False) -> ScenarioBatch:
    """Return a batch that plays `scenarios` at a time weight (m/s per s)."""
    frozen = frozen_of(scenarios)
    if frozen is None:
        task = task.changed({"scenario": scenarios["ranges"]})
    options: Any = {"time_weight": [weight], "threads": 1, "lenient": lenient}
    return ScenarioBatch(frozen or scenarios["seed"], scenarios["count"], task, **options)


def frozen_of(scenarios: Mapping[str, Any]) -> EvaluationSet | None:
    """Return scenarios as an evaluation set; None: the scenarios are drawn from ranges."""
    if "table" in scenarios:
        table = {name: np.asarray(scenarios["table"][name], np.float64) for name in FIELDS}
        return EvaluationSet(scenarios["seed"], len(table[FIELDS[0]]), table)
    return _shipped(scenarios["set"]) if "set" in scenarios else None


_shipped = lru_cache(maxsize=4)(evaluation_sets.load)  # the four sets used last stay in memory


def controller_of(spec: Mapping[str, Any], time_weight: float, task: Task | None = None) -> Controller:
    """Return the controller that `spec` describes, for a time weight (m/s per s) and a task.

    A tuned baseline keeps the arguments in its KNOWS as they were in its tuning. If `task` does not set the argument
    `scenario`, a rule keeps the scenario ranges of its own task.
    """
    ((kind, value),) = spec.items()
    if kind not in KINDS:
        raise ValueError(f"no controller of the kind {kind!r}")
    controller = KINDS[kind](value, time_weight)
    if task and isinstance(controller, RandomActions):
        return controller.for_task(task)
    if task and isinstance(controller, Rule):
        known = controller.task.by_path() if kind == "tuned" else {}
        kept = {name: known[name] for name in controller.KNOWS if name in known}
        own = {"scenario": task.arguments().get("scenario", controller.task.scenario)}
        return controller.for_task(task.changed(kept | own))
    return controller


_policy = lru_cache(maxsize=64)(lambda content: Ensemble.unpacked(*unpacked(base64.b64decode(content), FORMAT))[None])


def _object(name: str) -> Controller:
    try:
        attached = resolve_name(name)
        controller = attached() if isinstance(attached, type) or not hasattr(attached, "predict") else attached
    except Exception as error:
        raise ValueError(f"no controller {name!r} as module:object: {error!r}") from error
    if not callable(getattr(controller, "predict", None)):
        raise ValueError(f"{name!r} is no controller: it has no method `predict`")
    return controller


KINDS: Mapping[str, Callable[[Any, float], Controller]] = {
    "policy": lambda content, _: _policy(content),
    "baseline": load_baseline,
    "tuned": lambda content, weight: tuned_rule(content).at(weight),
    "clairvoyant": lambda by_weight, weight: Clairvoyant.of(by_weight[f"{weight:g}"], ANY),
    "object": lambda name, _: _object(name),
}
"""Functions that make a controller from plain data and a time weight, m/s per s."""


def try_out(name: str, controller: Controller, observations: NDArray[np.float32], action_size: int) -> None:
    """Call a controller on a batch of observations (n, n_obs); ValueError: the call fails, or its result is wrong."""
    start = np.ones(len(observations), np.bool_)
    try:
        actions, _ = controller.predict(observations.copy(), state=None, episode_start=start, deterministic=True)
        actions = np.asarray(actions, np.float64)
    except Exception as error:
        raise ValueError(f"{name!r} fails on a batch of observations: {error!r}") from error
    if actions.shape != (shape := (len(observations), action_size)) or not np.isfinite(actions).all():
        raise ValueError(f"{name!r} must return actions of shape {shape}, all finite; got {shown(actions)}")
