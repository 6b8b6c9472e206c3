"""From matchups to arrays: the list of jobs behind the page, and what came of them."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from agents.evaluate import RESULTS, Episodes
from agents.jobs import Job, digest_of, gather
from agents.setups import load_setup
from agents.setups.evaluation import nominally
from experiments.lab.statistics import Floats, Resamples
from experiments.reference.task import SERVED
from experiments.report.matchups import BOUND, PAPER, Contestant, Matchup
from experiments.report.shield import shielded
from impact_gym.task import Task, evaluation_sets
from impact_gym.task.scenario import FIELDS

Arrays = Mapping[str, NDArray[Any]]
PLAY = "agents.evaluate.play:play"
MEASURES = "experiments.report.measures"
PLAYER = "experiments.lab.player.films"  # plays what `MEASURES` watches
SPEEDS = (0.4, 0.5, 0.6, 0.8, 1.0, 1.25, 1.5)  # m/s, of the family of constant speeds
SHARES = (0.4, 0.6, 0.8, 1.0)  # of the largest speed of an arm that is slower than all of these
FAR = 0.36  # m, just beyond the farthest object: where an approach that meets nothing is watched
NEAR = 0.25  # m, where one is watched that knows the distance
LESS = 500  # scenarios where many variants are played
EXACTLY = 200  # scenarios that every policy plays once more at a hundredth of the tolerance
IN_SCIPY = 100  # scenarios in the independent solver
ANSWER = ("seeds", "as_late", "baselines", "family", "bound")  # what of `Played` a first page needs
AS_IT_IS = "as it is"
EXACT: dict[str, dict[str, Any]] = {
    AS_IT_IS: {},
    "a hundredth of the tolerance": {"rtol": Task.rtol / 100},
    "exact dissipation": {"dissipation": "exact"},
}
CLAMP = {AS_IT_IS: True, "clamp off": False}
FAMILY = "any constant speed"


@dataclass
class Run:
    """Results of one contestant in one matchup."""

    weights: tuple[float, ...]
    arrays: Arrays  # (weights, scenarios) each, and the fields of the scenarios (scenarios,)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.arrays[name]

    def at(self, weight: float) -> Episodes:
        """Return the results at a weight (m/s per s), or at the only one."""
        if len(self.weights) > 1 and weight not in self.weights:
            raise ValueError(f"it was not played at a weight of {weight:g}, only at {self.weights}")
        place = self.weights.index(weight) if weight in self.weights else 0
        return Episodes(**{name: self[name][place] for name in RESULTS}, scenario=self.scenario)

    def loss(self, weight: float) -> Floats:
        """V_p + weight * approach time and what misses cost (scenarios,), m/s."""
        return self.at(weight).loss(weight)

    def means(self, weight: float) -> dict[str, Any]:
        """Mean approach time T (s), V_p (m/s) and loss (m/s) at a weight, and how many objects it missed."""
        one = self.at(weight)
        means = {"T": one.approach_time, "V": one.object_velocity, "loss": one.loss(weight)}
        return {name: float(values.mean()) for name, values in means.items()} | {"missed": int(one.missed.sum())}

    @property
    def scenario(self) -> dict[str, Floats]:
        """The scenarios."""
        return {name: self[name] for name in FIELDS}


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
    nominal: dict[str, Run] = field(default_factory=dict)  # each seed with nothing drawn, and whom it is measured by
    exactly: dict[tuple[str, str], Run] = field(default_factory=dict)  # change, seed or baseline
    shielded: dict[tuple[float, str], Run] = field(default_factory=dict)  # limit (N), around whom
    scipy: dict[tuple[str, str], Arrays] = field(default_factory=dict)  # with the clamp or not, contestant
    reactions: Arrays = field(default_factory=dict)
    profiles: dict[str, Run] = field(default_factory=dict)

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

    @property
    def count(self) -> int:
        """How many scenarios each contestant met."""
        return self.paper["missed"].shape[1]

    @property
    def resamples(self) -> Resamples:
        """The resamples of these scenarios, the same for all contestants."""
        return Resamples(self.count)

    def of_seeds(self, name: str, weights: Iterable[float]) -> Floats:
        """Return a result of all seeds (seeds, weights, scenarios)."""
        return np.array([[getattr(run.at(weight), name) for weight in weights] for run in self.seeds.values()], float)

    def of_seeds_as_late(self, name: str) -> Floats:
        """Return a result of all seeds, as late as the paper's rule (seeds, scenarios)."""
        return np.array([run[name][0] for run in self.as_late.values()], float)

    def losses(self, weight: float) -> Floats:
        """Return the loss of all seeds at a weight (seeds, scenarios), m/s."""
        return np.array([run.loss(weight) for run in self.seeds.values()])


class _Asked(NamedTuple):
    """A job and where its result goes."""

    matchup: int
    where: str  # in `Played`
    key: Any  # there; None if the matchup has only one such result
    job: Job


def gather_matchups(
    matchups: list[Matchup],
    folder: Path,
    processes: int | None = None,
    cluster: str | None = None,
    first: int = 0,
    show_first: Callable[[list[Played]], None] = lambda played: None,
) -> list[Played]:
    """Play everything that is not in `folder` yet, and return what came of each matchup.

    With `first`, what the answer needs on so many scenarios is played before all else and given to `show_first`.
    """
    few = [replace(matchup, scenarios=_first(matchup.scenarios, first)) for matchup in matchups if first]
    asked, asked_first = _all_asked(matchups), [one for one in _all_asked(few) if one.where in ANSWER]
    # the last begin first: those of the first page, then those of the last recipe, which is the slowest
    jobs = [one.job for one in reversed([*asked, *asked_first])]
    came: list[Arrays] = [{}] * len(jobs)
    missing = len(asked_first)
    for place, arrays in gather(jobs, folder, processes=processes, cluster=cluster, title="playing"):
        came[-1 - place] = arrays
        if place < len(asked_first):
            missing -= 1
            if not missing:
                show_first(_played(few, asked_first, came[len(asked) :]))
    return _played(matchups, asked, came[: len(asked)])


def _played(matchups: list[Matchup], asked: list[_Asked], results: list[Arrays]) -> list[Played]:
    """Return what came of each matchup, every result in its place."""
    played = [Played(matchup) for matchup in matchups]
    for (number, where, key, job), arrays in zip(asked, results, strict=True):
        value: Run | Arrays = arrays
        if "weights" in job.arguments:
            weights = arrays["weight"].tolist() if where == "as_late" else job.arguments["weights"]
            value = Run(tuple(weights), arrays)
        if key is None:
            setattr(played[number], where, value)
        else:
            getattr(played[number], where)[key] = value
    return played


def _all_asked(matchups: list[Matchup]) -> list[_Asked]:
    """Return all jobs; they depend on sources, too, those of a user's baselines among them."""
    named = {one.controller.get("object", "").partition(":")[0] for matchup in matchups for one in matchup.baselines}
    depends = digest_of("impact_gym", "agents", MEASURES, PLAYER, "experiments.reference", *(named - {""}))
    return [
        _Asked(number, where, key, Job(function, arguments, depends))
        for number, matchup in enumerate(matchups)
        for where, key, function, arguments in _asked(matchup)
    ]


def watched_at(matchup: Matchup) -> float:
    """Return where the object stands when an approach is watched, m: where it is known, as usual, or just too far."""
    known = matchup.environment.get("range_noise") is not None
    if "ranges" not in matchup.scenarios:
        return NEAR if known else FAR
    low, high = matchup.scenarios["ranges"]["distance"]
    return float(0.5 * (low + high) if known else high + 0.01)


def _shown_weights(matchup: Matchup, one: Contestant) -> list[float]:
    """Return the weights (m/s per s) at which an approach is watched: the least, the typical, the largest compared."""
    shown = dict.fromkeys((matchup.weights[0], matchup.typical, matchup.weights[-1]))
    return [weight for weight in shown if weight in one.weights] or [one.weights[0]]


def _asked(matchup: Matchup) -> Iterator[tuple[str, Any, str, dict[str, Any]]]:
    """Yield for each job of a matchup where its result goes, under which key, the function and its arguments."""
    scenarios, environment, typical = matchup.scenarios, matchup.environment, matchup.typical
    task = Task(**environment)
    some = scenarios if matchup.evaluation.nominal else _first(scenarios, LESS)

    def of(one: Contestant, **arguments: Any) -> dict[str, Any]:
        return {"controller": one.controller, "environment": environment, **arguments}

    for one in matchup.seeds:
        everything = of(one, scenarios=scenarios, weights=list(one.weights))
        yield "seeds", one.name, PLAY, everything
        yield "as_late", one.name, f"{MEASURES}:play_as_late", everything
    for one in matchup.baselines:
        tuned = len(one.weights) > 1  # each weight is played at what was tuned for the nearest
        weights = sorted({*one.weights, *matchup.weights, typical}) if tuned else list(one.weights)
        yield "baselines", one.name, PLAY, of(one, scenarios=scenarios, weights=weights)
    fastest = task.velocity_range[1]
    for speed in [one for one in SPEEDS if one <= fastest] or [share * fastest for share in SHARES]:
        constant = Contestant(f"{speed:g} m/s", {"speed": speed}, (typical,), "")
        yield "family", constant.name, PLAY, of(constant, scenarios=scenarios, weights=[typical])
    if (bound := matchup.bound) is not None:
        searched = _first(scenarios, len(bound.controller["clairvoyant"][f"{bound.weights[0]:g}"]))
        knowing = {**environment, "privileged": True}
        yield "bound", None, PLAY, of(bound, scenarios=searched, weights=list(bound.weights), environment=knowing)
    rivals = {one.name: one for one in (matchup.baselines[0], matchup.rival, matchup.policy)}
    for change in matchup.changes:
        other = evaluation_sets.load(change.scenarios).count if change.scenarios else 0
        where = {"set": change.scenarios, "count": min(LESS, other)} if change.scenarios else some
        for one in rivals.values():
            changed = of(one, scenarios=where, weights=[typical], environment=change.environment)
            yield "varied", (change.argument, change.label, one.name), PLAY, changed
    if matchup.evaluation.nominal:
        nominal, weights = nominally(matchup.evaluation.nominal, environment), list(matchup.weights)
        if (measure := matchup.measure) is not None:
            its_own = load_setup(measure.name).environment
            nominal["alarm"] = its_own.get("alarm", Task.alarm)  # that which it is used to
            yield "nominal", measure.name, PLAY, of(measure, scenarios=scenarios, weights=weights, environment=its_own)
        for one in matchup.seeds:
            yield "nominal", one.name, PLAY, of(one, scenarios=scenarios, weights=weights, environment=nominal)
    few = _first(scenarios, EXACTLY)
    for label, options in EXACT.items():
        for one in {**{seed.name: seed for seed in matchup.seeds}, **rivals}.values():
            exact = of(one, scenarios=few, weights=[typical], environment={**environment, **options})
            yield "exactly", (label, one.name), PLAY, exact
    drawn = "ranges" in scenarios or task.drawn or isinstance(task.reaction_delay, tuple)
    if not drawn and set(environment) <= set(SERVED):
        hundred = _first(scenarios, IN_SCIPY)
        for label, clamp in CLAMP.items():
            for one in rivals.values() if clamp else (matchup.baselines[0], matchup.policy):
                solved = of(one, scenarios=hundred, weight=typical, clamp=clamp)
                yield "scipy", (label, one.name), f"{MEASURES}:in_scipy", solved
    for limit, one in shielded(matchup):
        yield "shielded", (limit, one.name), PLAY, of(one, scenarios=scenarios, weights=[typical])
    yield "reactions", None, f"{MEASURES}:reactions", of(matchup.policy, scenarios=some, weight=typical)
    for one in rivals.values():
        watched = of(one, weights=_shown_weights(matchup, one), distance=watched_at(matchup))
        yield "profiles", one.name, f"{MEASURES}:profile", watched


def _first(scenarios: Mapping[str, Any], count: int) -> dict[str, Any]:
    return {**scenarios, "count": min(count, scenarios["count"])}


def episodes(played: list[Played]) -> pl.DataFrame:
    """Return all episodes of the seeds, the baselines and the bound, a row each."""
    frames = []
    for one in played:
        runs = {**one.seeds, **one.baselines, **({BOUND: one.bound} if one.bound else {})}
        runs |= {f"{name}, as late as the paper's rule": run for name, run in one.as_late.items()}
        for name, run in runs.items():
            for place, weight in enumerate(run.weights):
                results = {field: run[field][place] for field in RESULTS}
                numbers = np.arange(len(results["missed"]), dtype=np.int32)
                about = {"matchup": one.matchup.name, "contestant": name, "time_weight": weight, "scenario": numbers}
                frames.append(pl.DataFrame({**about, **results, **run.scenario}))
    return pl.concat(frames)
