"""The jobs of a report: functions whose arguments are plain data, and their results for each matchup."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.baselines import PaperTrapezoid
from agents.evaluate.controllers import controller_of
from agents.evaluate.play import play, scenario_batch_of
from agents.evaluate.scenario_batch import Travel
from agents.jobs import cached
from agents.policies import Controller
from experiments.lab import grid
from experiments.lab.player.films import play as replay
from experiments.report import choice, holds
from experiments.report.matchups import Matchup
from experiments.report.played import Arrays, Played, Run
from impact_gym.scene import SpringDamper
from impact_gym.task import Task

JSON = Mapping[str, Any]
PLAYING = (*grid.PLAYED, __name__, "experiments.lab.player.films", grid.__name__)
"""Modules that results depend on, besides the arguments of the jobs: set-ups, policies and tuned baselines."""
FAR = 0.36  # m, just beyond the farthest object: the approach figure shows no contact
NEAR = 0.25  # m, distance of the object in the approach figure of controllers with an estimate
FEWER = 500  # scenarios for each change of the environment, and for deflections
HALVINGS = 9  # of the range of weights, on a logarithmic scale, by a bisection: it finds a weight to 1 %
CALIBRATION_SCENARIOS = 500  # largest number that is played to find a weight


class ReportJob(NamedTuple):
    """A call of `measured`, and the place of its result in `Played`."""

    where: str  # field of `Played`, which also selects the measurement
    key: Any  # key in that field; None if the field holds a single result
    arguments: Mapping[str, Any]


def play_matchups(
    matchups: Sequence[Matchup], folder: Path, depends: str, processes: int | None, cluster: str | None
) -> list[Played]:
    """Play the jobs whose results are not in `folder`, and return the results of each matchup.

    `depends` is a digest of the sources; kept results of another digest are not used.
    """
    jobs = [(number, job) for number, matchup in enumerate(matchups) for job in jobs_of(matchup)]
    calls = [{"where": job.where, "arguments": dict(job.arguments)} for _, job in jobs]
    print(f"results are kept in {folder}", flush=True)
    calls.reverse()  # the jobs of the last set-up take longest, so they begin first
    results = cached(measured, calls, folder, depends=depends, title="playing", processes=processes, cluster=cluster)
    played = [Played(matchup) for matchup in matchups]
    for (number, job), result in zip(jobs, reversed(results), strict=True):
        if job.where == "varied":
            played[number].varied.append((job.key, result))
            continue
        weights = result["weight"].tolist() if "weight" in result else job.arguments["weights"]
        run = Run(tuple(weights), result, grid.missed_cost(matchups[number].environment))
        if job.key is None:
            setattr(played[number], job.where, run)
        else:
            getattr(played[number], job.where)[job.key] = run
    return played


def watched_at(matchup: Matchup) -> float:
    """Return the object's distance (m) in the approach figure: mid-range if estimated, else beyond all objects."""
    estimated = matchup.environment.get("range_noise") is not None
    if "ranges" not in matchup.scenarios:
        return NEAR if estimated else FAR
    low, high = matchup.scenarios["ranges"]["distance"]
    return float(0.5 * (low + high) if estimated else high + 0.01)


def jobs_of(matchup: Matchup) -> Iterator[ReportJob]:
    """Yield the jobs of a matchup."""
    scenarios, environment, typical = matchup.scenarios, matchup.environment, matchup.typical
    task, some = Task(**environment), {**scenarios, "count": min(FEWER, scenarios["count"])}
    jobs: list[tuple[str, Any, JSON]] = [
        (where, seed, {"scenarios": scenarios, "weights": list(seed.weights)})
        for seed in matchup.seeds
        for where in ("seeds", "as_late")
    ]
    for baseline in matchup.baselines:
        tuned = len(baseline.weights) > 1  # between its tuned weights, its parameters are interpolated
        weights = sorted({*baseline.weights, *matchup.weights, typical}) if tuned else list(baseline.weights)
        jobs.append(("baselines", baseline, {"scenarios": scenarios, "weights": weights}))
    for contestant in (*matchup.baselines, matchup.policy):
        jobs.append(("choosing", contestant, {"scenarios": choice.scenarios(scenarios), "weights": [typical]}))
    if (bound := matchup.bound) is not None:
        searched = min(scenarios["count"], len(bound.controller["clairvoyant"][f"{bound.weights[0]:g}"]))
        jobs.append(("bound", bound, {
            "scenarios": {**scenarios, "count": searched}, "weights": list(bound.weights),
            "environment": {**environment, "privileged": True},
        }))  # fmt: skip
    shown = dict.fromkeys((matchup.weights[0], typical, matchup.weights[-1]))
    for rival in matchup.rivals:
        weights = [weight for weight in shown if weight in rival.weights] or [rival.weights[0]]
        jobs.append(("profiles", rival, {"weights": weights, "distance": watched_at(matchup)}))
        if isinstance(task.coupling, SpringDamper):
            jobs.append(("travelled", rival, {"scenarios": some, "weights": [typical]}))
    for where, contestant, arguments in jobs:
        key = None if where == "bound" else contestant.name
        yield ReportJob(where, key, {"controller": contestant.controller, "environment": environment, **arguments})
    for cell in holds.cells(matchup, some):
        yield ReportJob("varied", cell.labels, cell.arguments)


def measured(where: str, arguments: JSON) -> Any:
    """Return the result of a job, arrays or a frame: one function for all jobs of a report."""
    return MEASURES[where](**arguments)


def play_as_late(controller: JSON, environment: JSON, scenarios: JSON, weights: Sequence[float]) -> Arrays:
    """Return the results (1, scenarios) at the weight that gives the mean approach time of the paper's rule.

    The weight is found by bisection between the ends of `weights`, on `calibration_scenarios`; it is also returned, as
    `weight` (1,).
    """
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
    """Return the scenarios on which a weight is chosen.

    In place of a frozen set, the validation set; in place of ranges, the same ranges with other seeds. A table of
    scenarios is returned unchanged.
    """
    count = min(CALIBRATION_SCENARIOS, scenarios["count"])
    if "set" in scenarios:
        return {"set": "validation", "count": count}
    if "ranges" in scenarios:
        return {**scenarios, "seed": scenarios["seed"] + 50_000_000, "count": count}
    return dict(scenarios)


def travelled(controller: JSON, environment: JSON, scenarios: JSON, weights: Sequence[float]) -> Arrays:
    """Return the largest deflection of the coupling at a single weight, m: until the first touch, and in the episode.

    Both results are arrays (1, scenarios).
    """
    (weight,), task = weights, Task(**environment)
    batch = scenario_batch_of(scenarios, weight, task)
    travel = Travel(batch.count)
    batch.play(controller_of(controller, weight, task), watch=travel)
    return {"before": travel.deflection[None], "in_all": travel.stroke[None]}


def profile(controller: JSON, environment: JSON, weights: Sequence[float], distance: float) -> Arrays:
    """Return the flange's velocity (weights, k) over even positions (k,) up to an object at `distance` (m).

    If the controller observes an estimate of the distance, the estimate has no error.
    """
    record = {"object_mass": 0.5, "contact_stiffness": 3e4, "restitution": 0.5, "distance": distance}
    if environment.get("range_noise") is not None:
        record["distance_estimate"] = distance
    position = np.linspace(0.0, distance, 141)
    curves = []
    for weight in weights:
        player, options = controller_of(controller, weight, Task(**environment)), {**environment, "time_weight": weight}
        run = replay(player, seed=0, number=0, record=record, options=options)
        approach = run.history.time <= run.info["approach_time"] + 1e-12
        place, velocity = (run.history.columns[f"flange_{name}"][approach] for name in ("position", "velocity"))
        forward = np.flatnonzero(place >= np.maximum.accumulate(place))  # the flange may move back
        curves.append(np.interp(position, place[forward], velocity[forward], right=np.nan))
    return {"position": position, "velocity": np.array(curves)}


MEASURES: Mapping[str, Callable[..., Any]] = {
    "seeds": play, "as_late": play_as_late, "baselines": play, "choosing": play, "bound": play, "varied": grid.play,
    "profiles": profile, "travelled": travelled,
}  # fmt: skip
"""The measurement of each field of `Played`."""
