"""The grid of most studies: set-ups x changes x contestants, every contestant in the same scenarios.

`cells` names who plays where, `play` gives a row for each episode, `sample` turns rows back into arrays for statistics.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from agents.evaluate import play as jobs
from agents.evaluate.scenario_batch import MEASURED
from experiments.lab.statistics import Floats
from experiments.lab.study import Cell

PLAYED = ("impact_gym", "agents.baselines", "agents.evaluate", "agents.policies.networks", "agents.policies.policy",
          "agents.setups.evaluation")  # fmt: skip
"""Modules that the result of an episode depends on; set-ups, policies and what was tuned are arguments."""


class Contestant(NamedTuple):
    """A controller by name; seeds of one recipe of training share it."""

    name: str
    controller: Mapping[str, Any]  # plain data, see `agents.evaluate.controllers`
    seed: int = 0


class Place(NamedTuple):
    """A set-up with one change of its environment, such as friction: where contestants meet."""

    setup: str
    change: str  # in words
    environment: Mapping[str, Any]  # arguments of the environment, without scenario and time weight


def cells(
    places: Iterable[Place], contestants: Iterable[Contestant], scenarios: Mapping[str, Any], weights: Sequence[float]
) -> Iterator[Cell]:
    """Yield a cell for each contestant in each place.

    Scenarios are plain data, see `agents.evaluate.play`; weights are in m/s per s.
    """
    for place, contestant in product(places, contestants):
        labels = {"setup": place.setup, "change": place.change, "contestant": contestant.name, "seed": contestant.seed}
        arguments = {"controller": contestant.controller, "environment": place.environment}
        yield Cell(labels, {**arguments, "scenarios": scenarios, "weights": list(weights)})


def play(
    controller: Mapping[str, Any],
    environment: Mapping[str, Any],
    scenarios: Mapping[str, Any],
    weights: Sequence[float],
) -> pl.DataFrame:
    """Return a row for each episode: its weight (m/s per s), number, and the results that are known of it."""
    results = jobs.play(controller, scenarios, weights, environment)
    measured = {name: results[name] for name in MEASURED if name in results}
    shape = next(iter(measured.values())).shape
    columns = {"weight": np.broadcast_to(np.array(weights)[:, None], shape), "episode": np.indices(shape)[1]}
    return pl.DataFrame({name: np.ravel(values) for name, values in (columns | measured).items()})


def sample(frame: pl.DataFrame, name: str) -> Floats:
    """Return a column (seeds, episodes) of the rows of one contestant in one place at one weight."""
    ordered = frame.sort("seed", "episode")
    return ordered[name].to_numpy().astype(np.float64).reshape(ordered["seed"].n_unique(), -1)


def cost(weight: float, missed_cost: float) -> pl.Expr:
    """Return the cost of an episode, m/s: V_p + w T, and what a miss costs."""
    return pl.col("object_velocity") + weight * pl.col("approach_time") + missed_cost * pl.col("missed")
