"""Designs judged by one policy that is told of them, instead of each by a controller searched for it: within a minute.

A candidate is a design and the time weight at which the policy flies it, so a search over both has few numbers to find,
where a controller has sixteen of its own.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from agents.baselines.cmaes import minimise
from agents.baselines.rule import Floats, Parameter
from agents.design.free import Free, own
from agents.design.limits import Limits, Travel
from agents.design.search import PENALTY, RTOL, released
from agents.evaluate import TUNING_SEED, Episodes, Stage
from agents.jobs import Result
from agents.policies import Policy, load_policy
from agents.setups import Setup
from agents.setups.evaluation import arguments_of_task
from impact_gym.envs.task import Task

BUDGET, POPULATION = 800, 16
OWN_TO_IT = {"scenario", "time_weight", "rtol", "holder_told", "deflection_sensor", "past_readings"}
"""Arguments of the environment in which the policy's may differ from the set-up's: nothing else is played then."""


class Flown(NamedTuple):
    """What a policy does with designs: as many episodes of each, one after the other."""

    played: Episodes
    travel: Travel
    velocity: Floats  # m/s (designs,), mean of V_p and what a miss costs
    time: Floats  # s (designs,), mean of the approach


def flown(policy: Policy, stage: Stage, design: Mapping[str, Floats], weights: Floats) -> Flown:
    """Play each design, its numbers (designs,) by name, at a time weight of its own (designs,), m/s per s.

    The stage has as many copies of its scenarios, in the policy's `environment`.
    """
    record = {name: np.repeat(values, stage.count) for name, values in {**design, "time_weight": weights}.items()}
    travel = Travel(len(weights) * stage.count)
    played = stage.play(policy, record, travel)
    means = (each.reshape(len(weights), -1).mean(axis=1) for each in (played.loss(0.0), played.approach_time))
    return Flown(played, travel, *means)


def environment(policy: Policy) -> dict[str, Any]:
    """Return the arguments of the environment that a policy sees designs in, but for the time weight."""
    return {name: value for name, value in policy.environment.items() if name != "time_weight"}


def told_policy(name: str, setup: Setup, free: Sequence[Free]) -> Policy:
    """Return a policy that judges these designs of a set-up.

    Raises:
        ValueError: it is not told of designs, of other ones, or was trained for another arm.
    """
    policy = load_policy(name)
    task, there = Task(**environment(policy)), Task(**setup.environment)
    if not task.holder_told:
        raise ValueError(f"--inner {name}: it is not told of the design, its environment has no holder_told")
    if type(task.coupling) is not type(there.coupling):
        raise ValueError(f"--inner {name}: it is told of a {type(task.coupling).__name__}, {setup.called} has another")
    for one in free:
        low, high = task.drawn.get(one.name, (np.nan, np.nan))
        if not low <= one.low < one.high <= high:
            known = f"from {low:g} to {high:g}" if one.name in task.drawn else "as one number"
            raise ValueError(f"--inner {name} knows {one.name} {known}, got {one.low:g}:{one.high:g}")
    alike = task.at(fixed(policy, setup))
    other = [one for one in arguments_of_task() if one not in OWN_TO_IT and getattr(alike, one) != getattr(there, one)]
    if other:
        raise ValueError(f"--inner {name} was trained for another {', '.join(other)} than {setup.called} has")
    return policy


def fixed(policy: Policy, setup: Setup) -> dict[str, float]:
    """Return what the set-up has for each number that the policy is told of."""
    drawn = [Free(name, *pair) for name, pair in Task(**environment(policy)).drawn.items()]
    return dict(zip([one.name for one in drawn], own(setup, drawn), strict=True))


def best(
    policy: str, free: Sequence[Sequence[Any]], start: Mapping[str, float], approach_time: float,
    limits: Sequence[float | None], scenarios: int, seed: int,
) -> Result:  # fmt: skip
    """Return the `design` (d,) with which the policy leaves the object slowest, its `weight` (1,) and `loss` (1,), m/s.

    Args:
        policy: a name or a file.
        free: name, low and high of each number.
        start: each number that the policy is told of, before the search; what is not free stays.
        approach_time: s, that the mean over the scenarios may take.
        limits: see `Limits`.
        scenarios: training scenarios that each candidate is played through.
        seed: of the search.
    """
    judge, numbers, within = load_policy(policy), [Free(*one) for one in free], Limits(*limits)
    options = {"scenario": "train", **environment(judge), "rtol": RTOL, "threads": 1, "quiet": True}
    stage, task = Stage(TUNING_SEED, scenarios, POPULATION, **options), Task(**judge.environment)
    low, high = np.log(task.weights)
    parameters = (
        *(number.parameter(start[number.name]) for number in numbers),
        Parameter("time weight", "m/s per s, as log", low, high, 0.5 * (low + high)),
    )

    def losses(candidates: Floats) -> Floats:
        *columns, weights = candidates[:, 0].T
        design = {name: np.full(POPULATION, value) for name, value in start.items()}
        design |= {one.name: one.value(column) for one, column in zip(numbers, columns, strict=True)}
        found = flown(judge, stage, design, np.exp(weights))
        late = np.maximum(found.time / approach_time - 1.0, 0.0)
        over = late + within.excess(found.played, found.travel, released(task.coupling, design, POPULATION))
        return (found.velocity + PENALTY * over)[:, None]

    found = minimise(losses, parameters, 1, POPULATION, BUDGET // POPULATION, seed)
    *columns, weight = found.parameters[0]
    design = [float(one.value(column)) for one, column in zip(numbers, columns, strict=True)]
    return {"design": np.array(design), "weight": np.exp([weight]), "loss": found.loss}
