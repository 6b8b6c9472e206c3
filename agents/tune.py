"""The command `impact-gym tune`: tune the parameters of baselines by CMA-ES."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from agents.baselines import RULES, Clairvoyant, PaperTrapezoid
from agents.baselines.cmaes import Jittery, minimise
from agents.baselines.rule import Floats, Rule, ranges_for
from agents.evaluate.scenario_batch import TUNING_SEED, ScenarioBatch
from agents.jobs import cached
from agents.setups import Setup, load_setup, shipped, tuned
from agents.setups.evaluation import Weights
from impact_gym.parameters import SI, Index, Options
from impact_gym.quantities import QUANTITIES
from impact_gym.support.command_line import command_of, run_command
from impact_gym.support.files import locked
from impact_gym.support.provenance import digest_of, machine_and_versions
from impact_gym.support.validation import distinct, nearest
from impact_gym.task import Task

SETUPS = shipped()
BOUND_SCENARIOS, BOUND_POPULATION, BOUND_SEED = 64, 16, 1
BOUND_RTOL = 1e-5  # default relative tolerance in `search_bound`; the error of V_p is then below 1e-6 m/s
NEAR = 0.005  # s; `next_weight` stops when a mean approach time on each side of the target is this near
MOST_TRIED = 8  # largest number of time weights that `tune_at_rule_time` adds to a baseline
LEAST_WEIGHT, LARGEST_WEIGHT = QUANTITIES["time_weight"].scale[:2]  # m/s per s, limits of the search
LEAST_LIMITED = 0.02  # m/s per s, smallest time weight of `tune_beyond`
LOCK = ".lock"
CLEAN_ALARM = {"alarm": "force", "force_noise": 0.0, "force_bias": 0.0}
SEARCHED = ("impact_gym", "agents.baselines", "agents.evaluate", "agents.tune")
"""Sources on which the result of a search depends."""


@dataclass(frozen=True)
class Tune(Options):
    """Tune the baselines (controllers that are not learned) of set-ups, each baseline for several time weights."""

    setups: tyro.conf.Positional[tuple[str, ...]] = SETUPS
    """Names of shipped set-ups, or files of set-ups."""
    names: tuple[str, ...] = ()
    """Baselines to tune. Without this option, the command tunes all baselines of the set-ups."""
    weights: Weights = ()
    """Time weights, m/s per s. A time weight is the cost of a second until the touch. Without this option, the weights
    are `evaluation.weights` of the set-up."""
    scenarios: Annotated[int | None, SI("-", at_least=1)] = None
    """Number of scenarios in which the search tries each candidate (a set of parameters). Without this option, the
    number comes from the set-up."""
    budget: Annotated[int | None, SI("-", at_least=1)] = None
    """Largest number of candidates for each time weight, rounded up to a multiple of --population. Without this option,
    the number is `baselines.budget` of the set-up."""
    population: Annotated[int, SI("-", at_least=4)] = 16
    """Number of candidates in each generation of the search (CMA-ES)."""
    seed: Index = 1
    """Seed of the random numbers in the search."""
    bound: bool = False
    """Also search for the bound: the lowest cost found for a controller that knows the scenario. A set-up that
    uses the bound of another set-up gets no search for it."""
    at_rule_time: bool = False
    """Also tune each baseline for at most eight more time weights. The aim is a mean approach time at most 5 ms
    below that of the paper's rule, and another at most 5 ms above."""
    processes: Index = 2
    """Number of searches at the same time on this machine, each on one core. 0: the searches run in this process."""
    cluster: str | None = None
    """Address of a Ray cluster. "ray": the address in RAY_ADDRESS, or else the cluster of this machine."""
    out: Path | None = None
    """Folder for the files of the tuned baselines. The default is the folder of the shipped baselines for a shipped
    set-up, and runs/NAME/tuned for another set-up."""
    jobs: Path | None = None
    """Folder in which the command stores finished searches. The default is OUT/searches with --out, else runs/tune."""

    def __post_init__(self) -> None:
        super().__post_init__()
        distinct("weights", [f"{weight:g}" for weight in self.weights])
        distinct("setups", self.setups)
        distinct("names", self.names)
        known = {name for setup in self.setups for name in load_setup(setup).tuned}
        if unknown := [name for name in self.names if name not in known]:
            raise ValueError(nearest("baseline to tune", unknown[0], known))

    def baselines(self) -> dict[str, Setup]:
        """Return the set-up of each baseline to tune, by the name of the baseline."""
        wanted: dict[str, Setup] = {}
        for setup in map(load_setup, self.setups):
            for name in setup.tuned:
                if name in wanted:
                    raise ValueError(f"two set-ups have a baseline {name!r}: tune the set-ups one after the other")
                if name in self.names or not self.names:
                    wanted[name] = setup
        return wanted

    def search(self, name: str, setup: Setup) -> dict[str, Any]:
        """Return the settings of the search for a baseline; the baseline's file records these settings."""
        baseline = setup.tuned[name]
        budget = math.ceil(baseline.effort * (setup.budget if self.budget is None else self.budget))
        scenarios = baseline.scenarios if self.scenarios is None else self.scenarios
        settings = {"scenarios": scenarios, "budget": budget, "population": self.population, "seed": self.seed}
        more = {"clean_alarm": baseline.clean_alarm, "jitter": baseline.jitter}
        return settings | {setting: value for setting, value in more.items() if value}

    def folder(self, setup: Setup) -> Path:
        """Return the folder of a set-up's tuned baselines."""
        return setup.folder / "tuned" if self.out is None else self.out

    def search_all(
        self, search: Callable[..., Any], arguments: list[dict[str, Any]], title: str, depends: str,
        done: Callable[[int, Any], None] | None = None,
    ) -> list[Any]:  # fmt: skip
        """Return the results of `search` for each of `arguments`; for `depends` and `done` see `cached`."""
        jobs = self.jobs or (self.out / "searches" if self.out else Path("runs/tune"))
        return cached(search, arguments, jobs, depends=depends, title=title, processes=self.processes,
                      cluster=self.cluster, done=done)  # fmt: skip


def tune(options: Tune) -> list[Path]:
    """Tune baselines for the time weights that lack a result with these settings; return the paths of the files."""
    setups, missing, arguments = options.baselines(), [], []
    for name, setup in setups.items():
        known, baseline = _tuned_before(name, setup, options), setup.tuned[name]
        for weight in options.weights or setup.evaluation.weights:
            if f"{weight:g}" not in known:
                missing.append((name, setup, weight))
                what = {"rule": baseline.rule.__name__, "environment": setup.task.arguments(), "weight": weight}
                arguments.append(what | {"rtol": baseline.rtol} | options.search(name, setup))

    def write(place: int, result: dict[str, Any]) -> None:
        name, setup, weight = missing[place]
        numbers = zip(setup.tuned[name].rule.names(), result["parameters"], strict=True)
        search, where = options.search(name, setup), ((setup.cli_name,), (name,), (weight,))
        budget = setup.budget if options.budget is None else options.budget
        alone = Tune(*where, search["scenarios"], budget, options.population, options.seed)
        made = {"search": search, "command": command_of("tune", alone)}
        made |= {"versions": machine_and_versions("impact-gym", "cma", "numpy", "scipy")["versions"]}
        with locked(options.folder(setup) / LOCK):  # meanwhile another process may have tuned other weights
            found = _tuned_before(name, setup, options, say=lambda _: None)
            found |= {f"{weight:g}": result | {"parameters": dict(numbers)} | made}
            tuned.write_tuned(name, found, setup, options.folder(setup))

    options.search_all(tune_one, arguments, "tuning", digest_of(*SEARCHED), write)
    return [options.folder(setup) / f"{name}.json" for name, setup in setups.items()]


def next_weight(times: Mapping[float, float], target: float) -> float | None:
    """Return the next time weight (m/s per s) of a search for approach times on both sides of `target` (s).

    `times` holds the mean approach time (s) at each tuned weight; a larger weight usually has a shorter time. None: a
    time on each side is within NEAR of the target, or there is no further weight to try.
    """
    sooner, later = ({w: t for w, t in times.items() if (t > target) == side} for side in (False, True))
    if not (sooner and later):
        weight = 1.5 * max(later) if later else min(sooner) / 1.5
    else:
        low, above = max(later), [weight for weight in sooner if weight > max(later)]
        enclosed = target - max(sooner.values()) <= NEAR and min(later.values()) - target <= NEAR
        if enclosed or not above:
            return None
        weight = math.sqrt(low * min(above))
    weight = float(f"{weight:.3g}")
    return weight if LEAST_WEIGHT <= weight <= LARGEST_WEIGHT and weight not in times else None


def tune_at_rule_time(options: Tune) -> None:
    """Tune each baseline for more time weights, see `Tune.at_rule_time`."""
    for name, setup in options.baselines().items():
        batch = ScenarioBatch.of("validation", task=setup.task, threads=1)
        target = float(batch.play(PaperTrapezoid().for_task(setup.task)).approach_time.mean())
        for _ in range(MOST_TRIED):
            weights = tuned.read_tuned(name, options.folder(setup), setup)["weights"]
            times = {float(weight): found["validation"]["approach_time"] for weight, found in weights.items()}
            if (weight := next_weight(times, target)) is None:
                break
            tune(replace(options, setups=(setup.cli_name,), names=(name,), weights=(weight,)))


def tune_beyond(options: Tune, keeps: Callable[[dict[str, Any], float], bool]) -> None:
    """Tune each baseline for further time weights, until it keeps a limit at the lowest and not at the largest.

    `keeps` tells this for the content of a baseline's file and a weight, LEAST_LIMITED to LARGEST_WEIGHT (m/s per s).
    """
    names = options.baselines()
    while names:
        wanted = dict[float, list[str]]()
        for name, setup in names.items():
            content = tuned.read_tuned(name, options.folder(setup), setup)
            low, high = (end(map(float, content["weights"])) for end in (min, max))
            further = 2.0 * high if (gentle := keeps(content, low)) else low / 2.0
            if LEAST_LIMITED <= further <= LARGEST_WEIGHT and not (gentle and not keeps(content, high)):
                wanted.setdefault(further, []).append(name)
        for weight, some in wanted.items():
            tune(replace(options, names=tuple(some), weights=(float(f"{weight:.3g}"),)))
        names = {name: names[name] for some in wanted.values() for name in some}


def _tuned_before(name: str, setup: Setup, options: Tune, say: Callable[[str], None] = print) -> dict[str, Any]:
    """Return a baseline's stored results by time weight, from searches with the present settings and environment."""
    if not (options.folder(setup) / f"{name}.json").is_file():
        return {}
    try:
        weights = tuned.read_tuned(name, options.folder(setup), setup)["weights"]
    except ValueError as reason:
        say(f"{name} is tuned again: {reason}")
        return {}
    same = {weight: found for weight, found in weights.items() if found["search"] == options.search(name, setup)}
    if same != weights:
        say(f"{name}: the results at {sorted(set(weights) - set(same))} have other settings, and are not reused")
    return same


def tune_one(
    rule: str, environment: Mapping[str, Any], weight: float, rtol: float, jitter: float = 0.0,
    clean_alarm: bool = False, *, scenarios: int, budget: int, population: int, seed: int,
) -> dict[str, Any]:  # fmt: skip
    """Return the best parameters (k,) of a rule at one time weight, with scores and the number of generations."""
    task = Task(**{**environment, **(CLEAN_ALARM if clean_alarm else {})})
    kind, rng, ranges = RULES[rule], np.random.default_rng((seed, 1)), ranges_for(task)
    options: Any = {"copies": population, "time_weight": [weight] * population, "threads": 1, "lenient": True}
    batch = ScenarioBatch(TUNING_SEED, scenarios, task.changed({"rtol": rtol}), **options)

    def losses(candidates: Floats) -> Floats:
        controller = kind.of(np.repeat(candidates[:, 0], scenarios, axis=0), ranges).for_task(task)
        played = batch.play(Jittery(controller, jitter, scenarios, rng) if jitter else controller)
        return played.loss(weight).reshape(population, scenarios).mean(axis=1)[:, None]

    best = minimise(losses, kind.limited(ranges), 1, population, -(-budget // population), seed)
    validation = scores(kind.of(best.parameters[0], ranges).for_task(task), weight)
    parameters, train = best.parameters[0].tolist(), float(best.loss[0])
    return {"parameters": parameters, "train": train, "validation": validation, "generations": best.generations}


def scores(rule: Rule, weight: float) -> dict[str, float]:
    """Return a rule's mean loss, V_p and approach time on the validation set, and the number of missed objects."""
    played = ScenarioBatch.of("validation", task=rule.task, time_weight=[weight], threads=1).play(rule)
    means = {name: float(getattr(played, name).mean()) for name in ("object_velocity", "approach_time")}
    return {"loss": float(played.loss(weight).mean()), **means, "missed": int(played.missed.sum())}


def search_bounds(
    options: Tune, scenarios: int = BOUND_SCENARIOS, generations: int = tuned.BOUND_GENERATIONS
) -> list[Path]:
    """Search for missing bounds in the first `scenarios` test scenarios; return the paths of the set-ups' bounds."""
    setups = [setup for setup in map(load_setup, options.setups) if setup.bound == setup.name]
    missing = list[tuple[Setup, float]]()

    def known(setup: Setup) -> dict[float, Floats]:
        try:
            return tuned.read_bound(setup, options.folder(setup), generations)
        except ValueError as reason:
            print(f"the bound of {setup.name} is searched again: {reason}")
            return {}

    def write(place: int, parameters: Floats) -> None:
        setup, weight = missing[place]
        with locked(options.folder(setup) / LOCK):
            tuned.write_bound(setup, known(setup) | {weight: parameters}, options.folder(setup), generations)

    for setup in setups:
        weights = {*(options.weights or setup.evaluation.weights)} - {*known(setup)}
        missing += [(setup, weight) for weight in sorted(weights)]
    budget = {"scenarios": scenarios, "generations": generations}
    arguments = [{"environment": setup.environment, "time_weight": weight, **budget} for setup, weight in missing]
    options.search_all(search_bound, arguments, "bound", digest_of(*SEARCHED), write)
    return [tuned.bound_path(setup, options.folder(setup)) for setup in setups]


def search_bound(environment: Mapping[str, Any], time_weight: float, scenarios: int, generations: int) -> Floats:
    """Return the best parameters (scenarios, k) of `Clairvoyant` in each scenario at a time weight (m/s per s)."""
    task, population = Task(**{"rtol": BOUND_RTOL, **environment, "privileged": True}), BOUND_POPULATION
    weights, ranges = [time_weight] * population, ranges_for(task)
    batch = ScenarioBatch.of(tuned.BOUND_SET, scenarios, task, copies=population, time_weight=weights, threads=1)

    def losses(candidates: Floats) -> Floats:
        rule = Clairvoyant.of(candidates.reshape(population * scenarios, -1), ranges).for_task(task)
        return batch.play(rule).loss(time_weight).reshape(population, scenarios)

    best = minimise(losses, Clairvoyant.limited(ranges), scenarios, population, generations, BOUND_SEED)
    return np.ascontiguousarray(best.parameters)


def run(options: Tune) -> None:
    """Tune the baselines, print their scores, and search the bounds if `options.bound`."""
    paths = tune(options)
    if options.at_rule_time:
        tune_at_rule_time(options)
    for (name, setup), path in zip(options.baselines().items(), paths, strict=True):
        print(path)
        for weight, found in tuned.read_tuned(name, path.parent, setup)["weights"].items():
            means = found["validation"]
            print(
                f"  {name} at {weight}: {found['train']:.4f} m/s on train, {means['loss']:.4f} on validation "
                f"(V_p {means['object_velocity']:.4f} m/s, T {means['approach_time']:.4f} s, missed {means['missed']})"
            )
    for path in search_bounds(options) if options.bound else ():
        print(path)


if __name__ == "__main__":
    run_command("tune", Tune, run)
