"""Make controllers from plain data, which a job can send to another machine.

The data is a mapping with one key. `{"policy": text}`: a policy's file in base 64. `{"baseline": name}`: a shipped
baseline. `{"tuned": content}`: the content of a tuned baseline's file. `{"clairvoyant": {weight: parameters}}`: a
`Clairvoyant` for the scenarios of a set-up. `{"object": "module:name"}`: an object with `predict`, or a function or
class that returns one.
"""

import base64
import importlib
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.archive import unpacked
from agents.baselines import Clairvoyant
from agents.baselines.random import RandomActions
from agents.baselines.rule import Rule
from agents.baselines.tuned import load_baseline, tuned_rule
from agents.policies import Controller, Ensemble, Policy
from agents.policies.policy import FORMAT
from impact_gym.task import Task


def controller_of(spec: Mapping[str, Any], time_weight: float, task: Task | None = None) -> Controller:
    """Return the controller that `spec` describes, for a time weight (m/s per s) and a task.

    A tuned baseline keeps the arguments in its class's KNOWS as they were when it was tuned. In a task with the default
    scenario, it also keeps the range of distances for which it was tuned.
    """
    ((kind, value),) = spec.items()
    if kind not in KINDS:
        raise ValueError(f"no controller of the kind {kind!r}")
    controller = KINDS[kind](value, time_weight)
    if task is None or not isinstance(controller, (Rule, RandomActions)):
        return controller
    if isinstance(controller, Rule):
        known = controller.task.by_path() if kind == "tuned" else {}
        kept = {name: known[name] for name in controller.KNOWS if name in known}
        task = task.changed(kept | {"scenario": task.arguments().get("scenario", controller.task.scenario)})
    return controller.for_task(task)


@lru_cache(maxsize=64)
def _policy(content: str) -> Policy:
    return Ensemble.unpacked(*unpacked(base64.b64decode(content), FORMAT))[None]


def _object(name: str) -> Controller:
    module, colon, attribute = name.partition(":")
    if not (module and colon and attribute):
        raise ValueError(f"no controller {name!r}: name it as module:object")
    try:
        attached = getattr(importlib.import_module(module), attribute)
        controller = attached() if isinstance(attached, type) or not hasattr(attached, "predict") else attached
    except Exception as error:
        raise ValueError(f"no controller {name!r}: {error!r}") from error
    if not callable(getattr(controller, "predict", None)):
        raise ValueError(f"{name!r} is no controller: it has no method `predict`")
    return controller


KINDS: Mapping[str, Callable[[Any, float], Controller]] = {
    "policy": lambda content, _: _policy(content),
    "baseline": load_baseline,
    "tuned": lambda content, weight: tuned_rule(content).at(weight),
    "clairvoyant": lambda by_weight, weight: Clairvoyant(by_weight[f"{weight:g}"]),
    "object": lambda name, _: _object(name),
}
"""Constructors of controllers from their plain data and a time weight, m/s per s."""


def try_out(name: str, controller: Controller, observations: NDArray[np.float32], action_size: int) -> None:
    """Call a controller once with a batch of observations (n, n_obs), as the evaluation does."""
    start = np.ones(len(observations), np.bool_)
    try:
        actions, _ = controller.predict(observations.copy(), state=None, episode_start=start, deterministic=True)
        actions = np.asarray(actions, np.float64)
    except Exception as error:
        raise ValueError(f"{name!r} fails on a batch of observations: {error!r}") from error
    if actions.shape != (shape := (len(observations), action_size)) or not np.isfinite(actions).all():
        raise ValueError(f"{name!r} must return actions of shape {shape}, all finite; got {actions!r}")
