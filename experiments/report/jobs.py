"""The jobs of a report. Each job plays one controller of a `Matchup`; its arguments are JSON."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.baselines import PaperTrapezoid
from agents.evaluate.play import controller_of, play, scenario_batch_of
from agents.evaluate.scenario_batch import Travel
from agents.jobs import cached
from agents.policies import Controller
from experiments.lab import grid
from experiments.report import choice, holds
from experiments.report.matchups import Matchup
from experiments.report.played import Arrays, Played, Run
from impact_gym.scene import SpringDamper
from impact_gym.task import Task

JSON = Mapping[str, Any]
PLAYING = (*grid.PLAYED, __name__, grid.__name__)  # modules on which results depend
FEWER = 500  # largest number of scenarios of a job for `varied` (changed environments) or `travelled` (deflections)
HALVINGS = 9  # number of bisections of the logarithmic range of weights; enough for an error of 1 % in the weight
CALIBRATION_SCENARIOS = 500  # largest number of scenarios on which `play_as_late` finds a weight; a table is used whole


def play_matchups(
    matchups: Sequence[Matchup], folder: Path, depends: str, processes: int | None, cluster: str | None
) -> list[Played]:
    """Return the results of each matchup; results in `folder` are reused if they have the same text `depends`."""
    played = [Played(matchup) for matchup in matchups]
    # the last default set-up has the longest jobs, so its jobs start first
    jobs = [(each, *job) for each in reversed(played) for job in jobs_of(each.matchup)]
    calls = [{"where": where, "arguments": arguments} for _, where, _, arguments in jobs]
    print(f"results are kept in {folder}", flush=True)
    results = cached(measured, calls, folder, depends=depends, title="playing", processes=processes, cluster=cluster)
    for (each, where, key, arguments), result in zip(jobs, results, strict=True):
        if where == "varied":
            each.varied.append((key, result))
            continue
        weights = result["weight"].tolist() if "weight" in result else arguments["weights"]
        run = Run(tuple(weights), result, grid.missed_cost(each.matchup.environment))
        if where == "bound":
            each.bound = run
        else:
            getattr(each, where)[key] = run
    return played


def jobs_of(matchup: Matchup) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Yield (field, key, arguments) of each job; its result goes into this field of `Played`, under this key."""
    scenarios, environment, typical = matchup.scenarios, matchup.environment, matchup.typical
    some = {**scenarios, "count": min(FEWER, scenarios["count"])}
    jobs: list[tuple[str, Any, JSON]] = [
        (where, seed, {"scenarios": scenarios, "weights": list(seed.weights)})
        for seed in matchup.seeds
        for where in ("seeds", "as_late")
    ]
    for baseline in matchup.baselines:
        tuned = len(baseline.weights) > 1  # a tuned baseline can play at any weight
        weights = sorted({*baseline.weights, *matchup.weights, typical}) if tuned else list(baseline.weights)
        jobs.append(("baselines", baseline, {"scenarios": scenarios, "weights": weights}))
    chosen_on = {"scenarios": choice.scenarios(scenarios), "weights": [typical]}
    jobs += [("choosing", contestant, chosen_on) for contestant in (*matchup.baselines, matchup.policy)]
    if (bound := matchup.bound) is not None:
        searched = min(scenarios["count"], len(bound.controller["clairvoyant"][f"{bound.weights[0]:g}"]))
        jobs.append(("bound", bound, {
            "scenarios": {**scenarios, "count": searched}, "weights": list(bound.weights),
            "environment": {**environment, "privileged": True},
        }))  # fmt: skip
    if isinstance(Task(**environment).coupling, SpringDamper):
        jobs += [("travelled", rival, {"scenarios": some, "weights": [typical]}) for rival in matchup.rivals]
    for where, contestant, arguments in jobs:
        yield where, contestant.name, {"controller": contestant.controller, "environment": environment, **arguments}
    for cell in holds.cells(matchup, some):
        yield "varied", cell.labels, dict(cell.arguments)


def measured(where: str, arguments: JSON) -> Any:
    """Return the result of a job: arrays by name, or a frame."""
    measure: Callable[..., Any] = MEASURES.get(where, play)
    return measure(**arguments)


def play_as_late(controller: JSON, environment: JSON, scenarios: JSON, weights: Sequence[float]) -> Arrays:
    """Find the weight that gives about the rule's mean approach time; return results (1, scenarios) and `weight`."""
    choosing, task = calibration_scenarios(scenarios), Task(**environment)

    def mean_time(weight: float, player: Controller) -> float:
        return float(scenario_batch_of(choosing, weight, task).play(player).approach_time.mean())

    low, high = weights[0], weights[-1]
    target = mean_time(low, PaperTrapezoid().for_task(task))
    for _ in range(HALVINGS if high > low else 0):
        middle = math.sqrt(low * high)
        if mean_time(middle, controller_of(controller, middle, task)) > target:
            low = middle
        else:
            high = middle
    return play(controller, scenarios, [high], environment) | {"weight": np.array([high])}


def calibration_scenarios(scenarios: JSON) -> dict[str, Any]:
    """Return other scenarios for `play_as_late`: the set `validation`, or ranges with new seeds; a table is kept."""
    count = min(CALIBRATION_SCENARIOS, scenarios["count"])
    if "set" in scenarios:
        return {"set": "validation", "count": count}
    if "ranges" in scenarios:
        return {**scenarios, "seed": scenarios["seed"] + 50_000_000, "count": count}
    return dict(scenarios)


def travelled(controller: JSON, environment: JSON, scenarios: JSON, weights: Sequence[float]) -> Arrays:
    """Return arrays (1, scenarios), the largest deflections (m): `before` the first touch, `in_all` in the episode."""
    (weight,), task = weights, Task(**environment)
    batch = scenario_batch_of(scenarios, weight, task)
    travel = Travel(batch.count)
    batch.play(controller_of(controller, weight, task), watch=travel)
    return {"before": travel.deflection[None], "in_all": travel.stroke[None]}


MEASURES: Mapping[str, Callable[..., Any]] = {  # function that plays, by field of `Played`; for other fields: `play`
    "as_late": play_as_late, "varied": grid.play, "travelled": travelled,
}  # fmt: skip
