"""The grid of most studies: set-ups x changes x contestants, where all contestants play the same scenarios.

`cells` combines places and contestants, `play` returns a row for each episode, `sample` returns arrays for statistics.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from agents.evaluate import play as jobs
from agents.evaluate.scenario_batch import MEASURED
from experiments.lab.statistics import Floats, Front, Resamples
from experiments.lab.study import Cell
from impact_gym.task.scenario import FIELDS
from impact_gym.task.task import MISSED_COST

PLAYED = ("impact_gym", "agents.baselines", "agents.evaluate", "agents.policies.networks", "agents.policies.policy",
          "agents.setups.evaluation")  # fmt: skip
"""Modules on which the result of an episode depends. Set-ups, policies and baselines are arguments of the cells."""


class Contestant(NamedTuple):
    """A named controller; the seeds of one training share the name."""

    name: str
    controller: Mapping[str, Any]  # plain data, see `agents.evaluate.play`
    seed: int = 0


class Place(NamedTuple):
    """A set-up with one change of its environment, such as friction."""

    setup: str
    change: str  # in words
    environment: Mapping[str, Any]  # arguments of the environment, without time weight
    labels: Mapping[str, Any] = {}  # additional columns of the rows
    scenarios: Mapping[str, Any] | None = None  # scenarios to play here instead of the grid's


def cells(
    places: Iterable[Place], contestants: Iterable[Contestant], scenarios: Mapping[str, Any], weights: Sequence[float],
    **more: Any,
) -> Iterator[Cell]:  # fmt: skip
    """Yield a cell for each contestant in each place.

    Scenarios are plain data, see `agents.evaluate.play`. Weights are in m/s per s. `more` are arguments of `play`.
    """
    for place, contestant in product(places, contestants):
        labels = {"setup": place.setup, "change": place.change, **place.labels}
        labels |= {"contestant": contestant.name, "seed": contestant.seed}
        environment, where = jobs.environment_and_scenarios(place.environment, place.scenarios or scenarios)
        arguments = {"controller": contestant.controller, "environment": environment, "scenarios": where}
        yield Cell(labels, {**arguments, "weights": list(weights), **more})


def play(
    controller: Mapping[str, Any], environment: Mapping[str, Any], scenarios: Mapping[str, Any],
    weights: Sequence[float], lenient: bool = False,
) -> pl.DataFrame:  # fmt: skip
    """Return a row for each episode: its weight (m/s per s), number, scenario and results."""
    results = jobs.play(controller, scenarios, weights, environment, lenient)
    measured = {name: results[name] for name in MEASURED if name in results}
    shape = next(iter(measured.values())).shape
    columns: dict[str, Any] = {"weight": np.array(weights)[:, None], "episode": np.arange(shape[1])}
    columns |= {name: results[name] for name in FIELDS} | measured
    return pl.DataFrame({name: np.broadcast_to(values, shape).ravel() for name, values in columns.items()})


def groups(frame: pl.DataFrame, *by: str) -> Iterator[tuple[tuple[Any, ...], pl.DataFrame]]:
    """Yield each combination of values of the columns `by` with its rows, in the order of its first row."""
    yield from frame.group_by(by, maintain_order=True)


def sample(frame: pl.DataFrame, name: str) -> Floats:
    """Return a column as an array (seeds, episodes), for rows of one contestant in one place at one weight."""
    ordered = frame.sort("seed", "episode")
    return ordered[name].to_numpy().astype(np.float64).reshape(ordered["seed"].n_unique(), -1)


def front(
    frame: pl.DataFrame, resamples: Resamples, measures: Sequence[str] = ("approach_time", "object_velocity")
) -> Front:
    """Return the means (1 + n, weights) of two measures of one contestant in one place."""
    each = [rows for _, rows in groups(frame.sort("weight"), "weight")]
    first, second = (np.stack([resamples.means(sample(rows, name)) for rows in each], axis=1) for name in measures)
    return first, second


def missed_cost(environment: Mapping[str, Any]) -> float:
    """Return the cost of a miss in an environment, m/s."""
    return float(environment.get("missed_cost", MISSED_COST))


def cost(weight: float, missed_cost: float) -> pl.Expr:
    """Return the cost of an episode, m/s: V_p + w T + the cost of a miss."""
    return pl.col("object_velocity") + weight * pl.col("approach_time") + missed_cost * pl.col("missed")
