"""From matchups to results: the jobs behind the page, and what came of them."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from agents.jobs import cached, digest_of
from experiments.lab import grid
from experiments.lab.study import frame_of
from experiments.report import holds, measures
from experiments.report.matchups import Contestant, Matchup
from experiments.report.played import Played, Run
from impact_gym.scene import SpringDamper
from impact_gym.sources import compiled_from
from impact_gym.task import Task

PLAYING = (*grid.PLAYED, measures.__name__, "experiments.lab.player.films", grid.__name__)
"""Sources that results depend on; set-ups, policies and what was tuned are arguments."""
FAR = 0.36  # m, just beyond the farthest object: where an approach that meets nothing is watched
NEAR = 0.25  # m, where one is watched that knows the distance
FEWER = 500  # scenarios where many variants are played


class ReportJob(NamedTuple):
    """A call of `measures.measured`, and where its result goes."""

    where: str  # in `Played`
    key: Any  # there; None if the matchup has only one such result
    measure: str
    arguments: Mapping[str, Any]


def sources() -> str:
    """Return a digest of what plays, the compiled solver included."""
    return hashlib.sha256(f"{compiled_from()} {digest_of(*PLAYING)}".encode()).hexdigest()


def play_matchups(
    matchups: Sequence[Matchup], folder: Path, processes: int | None, cluster: str | None
) -> list[Played]:
    """Play everything that is not in `folder` yet, and return what came of each matchup."""
    asked = [(number, job) for number, matchup in enumerate(matchups) for job in jobs_of(matchup)]
    calls = [{"measure": job.measure, "arguments": dict(job.arguments)} for _, job in asked]
    print(f"results are kept in {folder}", flush=True)
    own = {module for matchup in matchups for module in matchup.modules}
    results = cached(
        measures.measured,
        calls[::-1],  # those of the last set-up are the slowest: they begin first
        folder,
        depends=f"{sources()} {digest_of(*own)}",
        title="playing",
        processes=processes,
        cluster=cluster,
    )
    played = [Played(matchup) for matchup in matchups]
    frames = [list[Any]() for _ in matchups]
    for (number, job), result in zip(asked, reversed(results), strict=True):
        if job.measure == "holds":
            frames[number].append((job.key, result))
            continue
        weights = result["weight"].tolist() if "weight" in result else job.arguments["weights"]
        run = Run(tuple(weights), result, grid.missed_cost(matchups[number].environment))
        if job.key is None:
            setattr(played[number], job.where, run)
        else:
            getattr(played[number], job.where)[job.key] = run
    for each, measured in zip(played, frames, strict=True):
        each.varied = frame_of(measured)
    return played


def watched_at(matchup: Matchup) -> float:
    """Return where the object stands when an approach is watched, m: where it is known, as usual, or just too far."""
    estimated = matchup.environment.get("range_noise") is not None
    if "ranges" not in matchup.scenarios:
        return NEAR if estimated else FAR
    low, high = matchup.scenarios["ranges"]["distance"]
    return float(0.5 * (low + high) if estimated else high + 0.01)


def jobs_of(matchup: Matchup) -> Iterator[ReportJob]:
    """Yield the jobs of a matchup."""
    scenarios, environment, typical = matchup.scenarios, matchup.environment, matchup.typical
    task, some = Task(**environment), first(scenarios, FEWER)

    def of(contestant: Contestant, **arguments: Any) -> dict[str, Any]:
        return {"controller": contestant.controller, "environment": environment, **arguments}

    for seed in matchup.seeds:
        everything = of(seed, scenarios=scenarios, weights=list(seed.weights))
        yield ReportJob("seeds", seed.name, "play", everything)
        yield ReportJob("as_late", seed.name, "play as late", everything)
    for baseline in matchup.baselines:
        tuned = len(baseline.weights) > 1  # each weight is played at what was tuned for the nearest
        weights = sorted({*baseline.weights, *matchup.weights, typical}) if tuned else list(baseline.weights)
        yield ReportJob("baselines", baseline.name, "play", of(baseline, scenarios=scenarios, weights=weights))
    if (bound := matchup.bound) is not None:
        searched = first(scenarios, len(bound.controller["clairvoyant"][f"{bound.weights[0]:g}"]))
        knowing = {**environment, "privileged": True}
        arguments = of(bound, scenarios=searched, weights=list(bound.weights), environment=knowing)
        yield ReportJob("bound", None, "play", arguments)
    for cell in holds.cells(matchup, some):
        yield ReportJob("varied", cell.labels, "holds", cell.arguments)
    shown = dict.fromkeys((matchup.weights[0], typical, matchup.weights[-1]))
    for rival in matchup.rivals:
        weights = [weight for weight in shown if weight in rival.weights] or [rival.weights[0]]
        yield ReportJob("profiles", rival.name, "profile", of(rival, weights=weights, distance=watched_at(matchup)))
        if isinstance(task.coupling, SpringDamper):
            yield ReportJob("travelled", rival.name, "travelled", of(rival, scenarios=some, weights=[typical]))


def first(scenarios: Mapping[str, Any], count: int) -> dict[str, Any]:
    """Return the first of some scenarios, or all where there are no more."""
    return {**scenarios, "count": min(count, scenarios["count"])}
