"""From matchups to arrays: the list of jobs behind the page, and what came of them."""

import copy
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from agents.evaluate import RESULTS
from agents.jobs import Job, digest_of, gather
from experiments.reference.task import SERVED
from experiments.report.matchups import BOUND, PAPER, Contestant, Matchup
from impact_gym.envs import evaluation_sets
from impact_gym.envs.scenario import FIELDS
from impact_gym.envs.task import MISSED_COST, Task

Arrays = Mapping[str, NDArray[Any]]
PLAYS = {"play": "agents.evaluate.play"}
HERE = "experiments.report.measures"
SPEEDS = (0.4, 0.5, 0.6, 0.8, 1.0, 1.25, 1.5)  # m/s, of the family of constant speeds
FAR = 0.36  # m, just beyond the farthest object: where an approach that meets nothing is watched
NEAR = 0.25  # m, where one is watched that knows the distance
LESS = 500  # scenarios where many variants are played
EXACTLY = 200  # scenarios that every policy plays once more at a hundredth of the tolerance
IN_SCIPY = 100  # scenarios in the independent solver
ANSWER = ("seeds", "as_late", "baselines", "family")  # what of `Played` a first page needs
CLAMP = {"as it is": True, "clamp off": False}
FAMILY = "any constant speed"


@dataclass
class Run:
    """Results of one contestant in one matchup."""

    weights: tuple[float, ...]
    arrays: Arrays  # (weights, scenarios) each

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.arrays[name]

    def at(self, weight: float) -> dict[str, NDArray[Any]]:
        """Return the results (scenarios,) at a weight, or at the only one."""
        if len(self.weights) > 1 and weight not in self.weights:
            raise ValueError(f"it was not played at a weight of {weight:g}, only at {self.weights}")
        place = self.weights.index(weight) if weight in self.weights else 0
        return {name: self.arrays[name][place] for name in RESULTS}

    def loss(self, weight: float) -> NDArray[np.float64]:
        """V_p + weight * approach time and what misses cost (scenarios,), m/s."""
        one = self.at(weight)
        return one["object_velocity"] + weight * one["approach_time"] + MISSED_COST * one["missed"]

    @property
    def scenario(self) -> dict[str, NDArray[np.float64]]:
        """The scenarios."""
        return {name: self.arrays[name] for name in FIELDS}


@dataclass
class Played:
    """All that came of one matchup."""

    matchup: Matchup
    seeds: dict[str, Run] = field(default_factory=dict)
    as_late: dict[str, Run] = field(default_factory=dict)  # each seed at the weight that makes it as late as the paper
    baselines: dict[str, Run] = field(default_factory=dict)
    family: dict[str, Run] = field(default_factory=dict)
    bound: Run | None = None
    varied: dict[tuple[str, str, str], Run] = field(default_factory=dict)  # argument, label, contestant
    exactly: dict[tuple[str, str], Run] = field(default_factory=dict)  # change, seed or baseline
    scipy: dict[tuple[str, str], Arrays] = field(default_factory=dict)  # with the clamp or not, contestant
    reactions: Arrays = field(default_factory=dict)
    profiles: dict[str, Arrays] = field(default_factory=dict)

    @property
    def paper(self) -> Run:
        """The paper's rule."""
        return self.baselines[PAPER]

    @property
    def rival(self) -> Run:
        """The baseline to beat."""
        return self.baselines[self.matchup.rival.name]

    @property
    def policy(self) -> Run:
        """The median seed."""
        return self.seeds[self.matchup.chosen]

    @property
    def policy_as_late(self) -> Run:
        """The median seed at the weight that makes it as late as the paper's rule."""
        return self.as_late[self.matchup.chosen]


@dataclass(frozen=True)
class _Asked:
    """A job and where its result goes."""

    matchup: int
    where: str
    key: Any
    weights: tuple[float, ...]
    job: Job


def gather_matchups(
    matchups: list[Matchup],
    folder: Path,
    processes: int | None = None,
    cluster: str | None = None,
    first: int = 0,
    told: Callable[[list[Played]], None] = lambda played: None,
) -> list[Played]:
    """Play everything that is not in `folder` yet, and return what came of each matchup.

    With `first`, what the answer needs on so many scenarios is played before all else, and `told` while others play.
    """
    depends = _sources(matchups)
    few = [replace(matchup, scenarios=_first(matchup.scenarios, first)) for matchup in matchups if first]
    asked_first = [one for one in _all_asked(few, depends) if one.where in ANSWER]
    asked = _all_asked(matchups, depends)
    # the last recipe is the slowest: what is long begins first
    jobs = [one.job for one in (*reversed(asked_first), *reversed(asked))]
    missing, came = set(range(len(asked_first))), {}
    for place, arrays in gather(jobs, folder, processes=processes, cluster=cluster, title="playing"):
        came[place] = arrays
        if missing and not (missing := missing - {place}):
            told(_played(few, asked_first, [came[k] for k in reversed(range(len(asked_first)))]))
    return _played(matchups, asked, [came[k] for k in reversed(range(len(asked_first), len(jobs)))])


def _played(matchups: list[Matchup], asked: list[_Asked], results: list[Arrays]) -> list[Played]:
    """Return what came of each matchup, every result in its place."""
    played = [Played(matchup) for matchup in matchups]
    for one, arrays in zip(asked, results, strict=True):
        target = played[one.matchup]
        weights = tuple(arrays["weight"].tolist()) if one.where == "as_late" else one.weights
        value = Run(weights, arrays) if one.weights else arrays
        if one.where in ("bound", "reactions"):
            setattr(target, one.where, value)
        else:
            getattr(target, one.where)[one.key] = value
    return played


def _all_asked(matchups: list[Matchup], depends: str) -> list[_Asked]:
    return [one for number, matchup in enumerate(matchups) for one in _asked(number, matchup, depends)]


def _sources(matchups: list[Matchup]) -> str:
    """Digest of what determines results beside a job's arguments: sources, those of a user's baselines too."""
    named = [one.controller.get("object", "") for matchup in matchups for one in matchup.baselines]
    modules = sorted({name.partition(":")[0] for name in named if name})
    return digest_of("impact_gym", "agents", "experiments.report.measures", "experiments.reference", *modules)


def watched_at(matchup: Matchup) -> float:
    """Return where the object stands when an approach is watched, m: where it is known, as usual, or just too far."""
    known = matchup.environment.get("range_noise") is not None
    if "ranges" not in matchup.scenarios:
        return NEAR if known else FAR
    low, high = matchup.scenarios["ranges"]["distance"]
    return float(0.5 * (low + high) if known else high + 0.01)


def shown_weights(matchup: Matchup, one: Contestant) -> list[float]:
    """Return the weights (m/s per s) at which an approach is watched: the least, the typical, the largest compared."""
    shown = dict.fromkeys((matchup.weights[0], matchup.typical, matchup.weights[-1]))
    return [weight for weight in shown if weight in one.weights] or [one.weights[0]]


def _fixed(environment: Mapping[str, Any]) -> bool:
    """Whether episodes draw nothing but their scenario."""
    task = Task(**environment)
    return not task.drawn and task.delays[0] == task.delays[1]


def _asked(number: int, matchup: Matchup, depends: str) -> Iterator[_Asked]:
    environment = copy.deepcopy(dict(matchup.environment))
    scenarios, task = dict(matchup.scenarios), Task(**matchup.environment)
    some = _first(scenarios, LESS)
    typical = matchup.typical

    def ask(where: str, key: Any, function: str, controller: Mapping[str, Any], **arguments: Any) -> _Asked:
        weights = tuple(arguments.get("weights", ())) if function in ("play", "play_as_late") else ()
        module = PLAYS.get(function, HERE)
        given = {"controller": dict(controller), "environment": environment, **arguments}
        return _Asked(number, where, key, weights, Job(f"{module}:{function}", given, depends))

    for one in (*matchup.seeds,):
        yield ask("seeds", one.name, "play", one.controller, scenarios=scenarios, weights=list(one.weights))
        yield ask("as_late", one.name, "play_as_late", one.controller, scenarios=scenarios, weights=list(one.weights))
    for one in matchup.baselines:
        weights = list(one.weights)
        if len(weights) > 1:  # it is tuned for weights: each is played at what was tuned for the nearest
            weights = sorted({*weights, *matchup.weights, typical})
        yield ask("baselines", one.name, "play", one.controller, scenarios=scenarios, weights=weights)
    for speed in (one for one in SPEEDS if one <= task.velocity_range[1]):
        yield ask("family", f"{speed:g} m/s", "play", {"speed": speed}, scenarios=scenarios, weights=[typical])
    if (bound := matchup.bound) is not None:
        searched = len(bound.controller["clairvoyant"][f"{bound.weights[0]:g}"])
        known: dict[str, Any] = {"scenarios": _first(scenarios, searched), "weights": list(bound.weights)}
        yield ask("bound", None, "play", bound.controller, **known, environment={**environment, "privileged": True})
    rivals = {one.name: one for one in (matchup.baselines[0], matchup.rival, matchup.policy)}.values()
    for change in matchup.changes:
        other = evaluation_sets.load(change.scenarios).count if change.scenarios else 0
        where = {"set": change.scenarios, "count": min(LESS, other)} if change.scenarios else some
        changed = copy.deepcopy(dict(change.environment))
        for one in rivals:
            arguments = {"environment": changed, "scenarios": where, "weights": [typical]}
            yield ask("varied", (change.argument, change.label, one.name), "play", one.controller, **arguments)
    few = _first(scenarios, EXACTLY)
    for label, options in EXACT.items():
        for one in {**{c.name: c for c in matchup.seeds}, **{c.name: c for c in rivals}}.values():
            arguments = {"environment": {**environment, **options}, "scenarios": few, "weights": [typical]}
            yield ask("exactly", (label, one.name), "play", one.controller, **arguments)
    if "ranges" not in scenarios and set(environment) <= set(SERVED) and _fixed(environment):
        hundred = _first(scenarios, IN_SCIPY)
        for label, clamp in CLAMP.items():
            arguments = {"scenarios": hundred, "weight": typical, "clamp": clamp}
            for one in rivals if clamp else (matchup.baselines[0], matchup.policy):
                yield ask("scipy", (label, one.name), "in_scipy", one.controller, **arguments)
    yield ask("reactions", None, "reactions", matchup.policy.controller, scenarios=some, weight=typical)
    distance = watched_at(matchup)
    for one in rivals:
        weights = shown_weights(matchup, one)
        yield ask("profiles", one.name, "profile", one.controller, weights=weights, distance=distance)


EXACT: dict[str, dict[str, Any]] = {
    "as it is": {},
    "a hundredth of the tolerance": {"rtol": Task.rtol / 100},
    "exact dissipation": {"dissipation": "exact"},
}


def _first(scenarios: Mapping[str, Any], count: int) -> dict[str, Any]:
    return {**scenarios, "count": min(count, scenarios["count"])}


def episodes(played: list[Played]) -> pl.DataFrame:
    """Return all episodes of the seeds, the baselines and the bound, a row each."""
    frames = []
    for one in played:
        runs = {**one.seeds, **one.baselines}
        if one.bound is not None:
            runs[BOUND] = one.bound
        runs |= {f"{name}, as late as the paper's rule": run for name, run in one.as_late.items()}
        for name, run in runs.items():
            for place, weight in enumerate(run.weights):
                count = run["missed"].shape[1]
                frames.append(
                    pl.DataFrame(
                        {
                            "matchup": [one.matchup.name] * count,
                            "contestant": [name] * count,
                            "time_weight": np.full(count, weight),
                            "scenario": np.arange(count, dtype=np.int32),
                            **{field: run[field][place] for field in RESULTS},
                            **run.scenario,
                        }
                    )
                )
    return pl.concat(frames)
