"""From matchups to arrays: the list of jobs behind the page, and what came of them."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from agents.evaluate import RESULTS
from agents.jobs import Job, digest_of, gather_all
from agents.setups import load_setup
from experiments.reference.task import SERVED
from experiments.report.matchups import Contestant, Matchup
from experiments.report.played import Arrays, Played, Run
from experiments.report.shield import shielded
from impact_gym.scene import SpringDamper
from impact_gym.sources import compiled_from
from impact_gym.task import Task, evaluation_sets
from impact_gym.task.scenario import FIELDS
from impact_gym.task.task import MISSED_COST

PLAY = "agents.evaluate.play:play"
MEASURES = "experiments.report.measures"
PLAYING = (
    "impact_gym", "agents.baselines", "agents.evaluate", "agents.policies.networks", "agents.policies.policy",
    "agents.setups.evaluation", MEASURES, "experiments.lab.player.films", "experiments.reference",
)  # fmt: skip
"""Sources that results depend on; set-ups, policies and what was tuned are arguments."""
SPEEDS = (0.4, 0.5, 0.6, 0.8, 1.0, 1.25, 1.5)  # m/s, of the family of constant speeds
SHARES = (0.4, 0.6, 0.8, 1.0)  # of the largest speed of an arm that is slower than all of these
FAR = 0.36  # m, just beyond the farthest object: where an approach that meets nothing is watched
NEAR = 0.25  # m, where one is watched that knows the distance
LESS = 500  # scenarios where many variants are played
EXACTLY = 200  # scenarios that every policy plays once more at a hundredth of the tolerance
IN_SCIPY = 50  # scenarios in the independent solver
EXACT: dict[str, dict[str, Any]] = {
    "a hundredth of the tolerance": {"rtol": Task.rtol / 100},
    "exact dissipation": {"dissipation": "exact"},
}
AROUND = 3500  # bytes of a result beside its numbers
FAMILY = "any constant speed"


class Asked(NamedTuple):
    """A job and where its result goes."""

    matchup: int
    where: str  # in `Played`
    key: Any  # there; None if the matchup has only one such result
    job: Job


def sources() -> str:
    """Return a digest of what plays, the compiled solver included."""
    return hashlib.sha256(f"{compiled_from()} {digest_of(*PLAYING)}".encode()).hexdigest()


def all_asked(matchups: Sequence[Matchup]) -> list[Asked]:
    """Return all jobs. What they depend on beside their arguments: what plays, a user's own baselines among it."""
    specs = [baseline.controller for matchup in matchups for baseline in matchup.baselines]
    modules = {spec["object"].partition(":")[0] for spec in specs if "object" in spec}
    depends = f"{sources()} {digest_of(*modules)}"
    return [
        Asked(number, where, key, Job(function, arguments, depends))
        for number, matchup in enumerate(matchups)
        for where, key, function, arguments in _asked(matchup)
    ]


def gather_matchups(
    matchups: Sequence[Matchup], asked: Sequence[Asked], folder: Path, processes: int | None, cluster: str | None
) -> list[Played]:
    """Play everything that is not in `folder` yet, and return what came of each matchup."""
    played = [Played(matchup) for matchup in matchups]
    jobs = [request.job for request in reversed(asked)]  # those of the last set-up are the slowest: they begin first
    results = gather_all(jobs, folder, processes=processes, cluster=cluster, title="playing")
    for (number, where, key, job), arrays in zip(asked, reversed(results), strict=True):
        value: Run | Arrays = arrays
        if "weights" in job.arguments:
            weights = arrays["weight"].tolist() if where == "as_late" else job.arguments["weights"]
            cost = job.arguments["environment"].get("missed_cost", MISSED_COST)
            value = Run(tuple(weights), arrays, cost)
        if key is None:
            setattr(played[number], where, value)
        else:
            getattr(played[number], where)[key] = value
    return played


def room_for(asked: Sequence[Asked]) -> int:
    """Return about how many bytes the results of all jobs take."""
    scenarios, results = 8 * len(FIELDS), 8 * len(RESULTS)  # bytes for each scenario
    given = [job.arguments for job in {request.job.key: request.job for request in asked}.values()]
    rows = [(len(each.get("weights", [])), each.get("scenarios", {}).get("count", 0)) for each in given]
    return sum(AROUND + count * (scenarios + results * weights) for weights, count in rows)


def watched_at(matchup: Matchup) -> float:
    """Return where the object stands when an approach is watched, m: where it is known, as usual, or just too far."""
    estimated = matchup.environment.get("range_noise") is not None
    if "ranges" not in matchup.scenarios:
        return NEAR if estimated else FAR
    low, high = matchup.scenarios["ranges"]["distance"]
    return float(0.5 * (low + high) if estimated else high + 0.01)


def _shown_weights(matchup: Matchup, contestant: Contestant) -> list[float]:
    """Return the weights (m/s per s) at which an approach is watched: the least, the typical, the largest compared."""
    shown = dict.fromkeys((matchup.weights[0], matchup.typical, matchup.weights[-1]))
    return [weight for weight in shown if weight in contestant.weights] or [contestant.weights[0]]


def _asked(matchup: Matchup) -> Iterator[tuple[str, Any, str, dict[str, Any]]]:
    """Yield for each job of a matchup where its result goes, under which key, the function and its arguments."""
    scenarios, environment, typical = matchup.scenarios, matchup.environment, matchup.typical
    task = Task(**environment)
    some = scenarios if matchup.evaluation.nominal else _first(scenarios, LESS)

    def of(contestant: Contestant, **arguments: Any) -> dict[str, Any]:
        return {"controller": contestant.controller, "environment": environment, **arguments}

    for seed in matchup.seeds:
        everything = of(seed, scenarios=scenarios, weights=list(seed.weights))
        yield "seeds", seed.name, PLAY, everything
        yield "as_late", seed.name, f"{MEASURES}:play_as_late", everything
    for baseline in matchup.baselines:
        tuned = len(baseline.weights) > 1  # each weight is played at what was tuned for the nearest
        weights = sorted({*baseline.weights, *matchup.weights, typical}) if tuned else list(baseline.weights)
        yield "baselines", baseline.name, PLAY, of(baseline, scenarios=scenarios, weights=weights)
    fastest = task.velocity_range[1]
    for speed in [speed for speed in SPEEDS if speed <= fastest] or [share * fastest for share in SHARES]:
        constant = Contestant(f"{speed:g} m/s", {"speed": speed}, (typical,), "")
        yield "family", constant.name, PLAY, of(constant, scenarios=scenarios, weights=[typical])
    if (bound := matchup.bound) is not None:
        searched = _first(scenarios, len(bound.controller["clairvoyant"][f"{bound.weights[0]:g}"]))
        knowing = {**environment, "privileged": True}
        yield "bound", None, PLAY, of(bound, scenarios=searched, weights=list(bound.weights), environment=knowing)
    rivals = {rival.name: rival for rival in (matchup.baselines[0], matchup.rival, matchup.policy)}
    for change in matchup.changes:
        other = evaluation_sets.load(change.scenarios).count if change.scenarios else 0
        where = {"set": change.scenarios, "count": min(LESS, other)} if change.scenarios else some
        for rival in rivals.values():
            changed = of(rival, scenarios=where, weights=[typical], environment=change.environment)
            yield "varied", (change.argument, change.label, rival.name), PLAY, changed
    if isinstance(task.coupling, SpringDamper):
        for rival in rivals.values():
            yield "travelled", rival.name, f"{MEASURES}:travelled", of(rival, scenarios=some, weight=typical)
    if matchup.evaluation.nominal:
        nominal, weights = {**environment, **matchup.evaluation.nominal}, list(matchup.weights)
        if (measure := matchup.measure) is not None:
            its_own = load_setup(measure.name).environment
            nominal["alarm"] = its_own.get("alarm", Task.alarm)  # that which it is used to
            yield "nominal", measure.name, PLAY, of(measure, scenarios=scenarios, weights=weights, environment=its_own)
        for seed in matchup.seeds:
            yield "nominal", seed.name, PLAY, of(seed, scenarios=scenarios, weights=weights, environment=nominal)
    few = _first(scenarios, EXACTLY)
    for label, options in EXACT.items():
        for contestant in {**{seed.name: seed for seed in matchup.seeds}, **rivals}.values():
            exact = of(contestant, scenarios=few, weights=[typical], environment={**environment, **options})
            yield "exactly", (label, contestant.name), PLAY, exact
    drawn = "ranges" in scenarios or task.drawn or isinstance(task.reaction_delay, tuple)
    if not drawn and set(environment) <= set(SERVED):
        few = _first(scenarios, IN_SCIPY)
        for rival in rivals.values():
            yield "scipy", rival.name, f"{MEASURES}:in_scipy", of(rival, scenarios=few, weight=typical)
    for limit, contestant in shielded(matchup):
        yield "shielded", (limit, contestant.name), PLAY, of(contestant, scenarios=scenarios, weights=[typical])
    for rival in rivals.values():
        watched = of(rival, weights=_shown_weights(matchup, rival), distance=watched_at(matchup))
        yield "profiles", rival.name, f"{MEASURES}:profile", watched


def _first(scenarios: Mapping[str, Any], count: int) -> dict[str, Any]:
    return {**scenarios, "count": min(count, scenarios["count"])}
