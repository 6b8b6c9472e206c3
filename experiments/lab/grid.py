"""Cells (see `study.Cell`) that play a controller in scenarios, and functions that evaluate the rows of cells."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from agents.evaluate.scenario_batch import MEASURED, Episodes
from agents.evaluate.specs import controller_of, environment_and_scenarios, scenario_batch_of
from experiments.lab.statistics import Floats, Front, Resamples
from experiments.lab.study import Cell, Row
from impact_gym.task import Task

# modules on which the result of `play` depends
PLAYED = ("impact_gym", "agents.baselines", "agents.evaluate", "agents.policies.networks", "agents.policies.policy",
          "agents.setups.evaluation", "agents.setups.tuned")  # fmt: skip


def cell(
    labels: Row, controller: Mapping[str, Any], environment: Mapping[str, Any], scenarios: Mapping[str, Any],
    weights: Sequence[float], **more: Any,
) -> Cell:  # fmt: skip
    """Return a cell for `play`; the arguments after `labels` are passed to `play`."""
    environment, where = environment_and_scenarios(environment, scenarios)
    arguments = {"controller": controller, "environment": environment, "scenarios": where, "weights": list(weights)}
    return Cell(labels, {**arguments, **more})


def play(
    controller: Mapping[str, Any], environment: Mapping[str, Any], scenarios: Mapping[str, Any],
    weights: Sequence[float], lenient: bool = False,
) -> pl.DataFrame:  # fmt: skip
    """Let a controller play at each weight (m/s per s); return `rows_of` all. For `lenient` see `ScenarioBatch`.

    `environment` must hold no scenario and no time weight.
    """
    with warnings.catch_warnings(action="ignore", category=UserWarning):  # hard scenarios are intended
        task, frames = Task(**environment), []
        for weight in weights:
            batch = scenario_batch_of(scenarios, weight, task, lenient)
            frames.append(rows_of(batch.play(controller_of(controller, weight, task)), weight))
    return pl.concat(frames)


def rows_of(played: Episodes, weight: float) -> pl.DataFrame:
    """Return a row for each episode: weight (m/s per s), index and fields of the scenario, results and cost (m/s)."""
    results = {name: getattr(played, name) for name in MEASURED if getattr(played, name) is not None}
    about = {"weight": weight, "episode": np.arange(len(played.missed)), **played.scenario}
    return pl.DataFrame({**about, **results, "cost": played.loss(weight)})


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
