"""Cells (see `study.Cell`) that play a controller in scenarios, and functions that evaluate the rows of cells."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from agents.evaluate import play as jobs
from agents.evaluate.scenario_batch import MEASURED
from experiments.lab.statistics import Floats, Front, Resamples
from experiments.lab.study import Cell, Row
from impact_gym.task import Task
from impact_gym.task.scenario import FIELDS

# modules on which the result of `play` depends
PLAYED = ("impact_gym", "agents.baselines", "agents.evaluate", "agents.policies.networks", "agents.policies.policy",
          "agents.setups.evaluation", "agents.setups.tuned")  # fmt: skip


def cell(
    labels: Row, controller: Mapping[str, Any], environment: Mapping[str, Any], scenarios: Mapping[str, Any],
    weights: Sequence[float], **more: Any,
) -> Cell:  # fmt: skip
    """Return a cell for `play`; the arguments after `labels` are passed to `play`."""
    environment, where = jobs.environment_and_scenarios(environment, scenarios)
    arguments = {"controller": controller, "environment": environment, "scenarios": where, "weights": list(weights)}
    return Cell(labels, {**arguments, **more})


def play(
    controller: Mapping[str, Any], environment: Mapping[str, Any], scenarios: Mapping[str, Any],
    weights: Sequence[float], lenient: bool = False,
) -> pl.DataFrame:  # fmt: skip
    """Return a row for each episode: weight (m/s per s), index and fields of the scenario, results and cost (m/s)."""
    results = jobs.play(controller, scenarios, weights, environment, lenient)
    shape, weight = results["missed"].shape, np.array(weights)[:, None]
    columns: dict[str, Any] = {"weight": weight, "episode": np.arange(shape[1])}
    columns |= {name: results[name] for name in (*FIELDS, *MEASURED) if name in results}
    columns["cost"] = results["object_velocity"] + weight * results["approach_time"]
    # misses last, to round as `Episodes.loss` does
    columns["cost"] += environment.get("missed_cost", Task.missed_cost) * results["missed"]
    return pl.DataFrame({name: np.broadcast_to(values, shape).ravel() for name, values in columns.items()})


def groups(frame: pl.DataFrame, *by: str) -> Iterator[tuple[tuple[Any, ...], pl.DataFrame]]:
    """Yield each combination of values in the columns `by` with its rows; combinations are in order of appearance."""
    yield from frame.group_by(by, maintain_order=True)


def sample(frame: pl.DataFrame, name: str) -> Floats:
    """Return a column as an array (seeds, episodes); `frame` has one contestant in one environment at one weight."""
    ordered = frame.sort("seed", "episode")
    return ordered[name].to_numpy().astype(np.float64).reshape(ordered["seed"].n_unique(), -1)


def front_of(frame: pl.DataFrame, resamples: Resamples) -> Front:
    """Return the front of one contestant in one environment; V_p is the mean over the touched objects."""
    each = [rows for _, rows in groups(frame.sort("weight"), "weight")]
    names = ("approach_time", "object_velocity", "missed")
    times, velocities, missed = (np.stack([sample(rows, name) for rows in each], axis=1) for name in names)
    return resamples.means(times), resamples.means_where(velocities, missed == 0.0)
