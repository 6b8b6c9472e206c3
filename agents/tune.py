"""Tune the baselines of set-ups: `python -m agents.tune my.toml`, or `make tune` for those that are shipped.

Each baseline is tuned for each time weight of the set-up's evaluation, by CMA-ES on training scenarios; `--bound` also
searches the clairvoyant bound. Each search is a job of `agents.jobs`: what is done is kept, and the same command goes
on where it was stopped.
"""

import platform
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from agents.baselines import Clairvoyant, bound
from agents.baselines.cmaes import minimise
from agents.baselines.profile import BlindProfile, constant_deceleration
from agents.baselines.rule import Floats
from agents.baselines.tuned import RULES, read_tuned, write_tuned
from agents.command_line import command_line
from agents.evaluate import TUNING_SEED, Stage
from agents.jobs import Job, Result, digest_of, gather
from agents.setups import Setup, load_setup, shipped
from impact_gym.validation import number, whole

SETUPS = shipped()
PACKAGES = ("impact-gym", "cma", "numpy", "scipy")
BOUND_SCENARIOS, BOUND_POPULATION, BOUND_SEED = 64, 16, 1
BOUND_RTOL = 1e-5  # of the simulation while searching: V_p is within 1e-6 m/s
SEARCHED = ("impact_gym", "agents.baselines", "agents.evaluate", "agents.tune")
"""Sources that what a search finds depends on."""


@dataclass(frozen=True)
class Tune:
    """Tune the baselines of set-ups for time weights."""

    setups: tyro.conf.Positional[tuple[str, ...]] = SETUPS
    """Names or files; all that are shipped unless some are named."""
    names: tuple[str, ...] = ()
    """Of their baselines only these."""
    weights: tuple[float, ...] = ()
    """What a second of approach costs, m/s per s; what the set-up says unless given."""
    scenarios: int = 300
    """Training scenarios that each candidate is played through."""
    budget: int | None = None
    """Candidates for each weight; what the set-up says unless given."""
    population: int = 16
    """Of these in a generation: they are played together."""
    seed: int = 1
    """Of the search."""
    bound: bool = False
    """Search the clairvoyant bound of each set-up as well, unless its file says that another's holds for it."""
    processes: int = 2
    """Searches at a time on this machine, each on one core; 0: none but this process."""
    cluster: str | None = None
    """Search on this Ray cluster instead: "ray" for the one that runs here, or its address."""
    out: Path | None = None
    """Folder of the files; that of the shipped ones unless given, for a set-up from a file runs/NAME/tuned."""
    jobs: Path = Path("runs/tune")
    """Folder where finished searches are kept."""

    def __post_init__(self) -> None:
        whole("scenarios", self.scenarios, at_least=1)
        whole("processes", self.processes, at_least=0)
        if self.budget is not None:
            whole("budget", self.budget, at_least=1)
        whole("population", self.population, at_least=4)
        whole("seed", self.seed, at_least=0)
        for weight in self.weights:
            number("weights", weight, "m/s per s", above=0)
        there = {name for setup in self.setups for name in load_setup(setup).tuned}
        for name in self.names:
            if name not in there:
                raise ValueError(f"no baseline {name!r} to tune: there are {sorted(there)}")

    def baselines(self) -> dict[str, Setup]:
        """Return the set-up of each baseline that is asked for."""
        found: dict[str, Setup] = {}
        for setup in map(load_setup, self.setups):
            for name in setup.tuned:
                if not self.names or name in self.names:
                    if name in found:
                        raise ValueError(f"two set-ups have a baseline {name!r}: tune them one after the other")
                    found[name] = setup
        return found

    def weights_of(self, setup: Setup) -> tuple[float, ...]:
        """Return the time weights, m/s per s."""
        return self.weights or setup.evaluation.weights

    def search(self, setup: Setup) -> dict[str, int]:
        """Return the settings of the search, on which its result depends."""
        budget = setup.budget if self.budget is None else self.budget
        return {"scenarios": self.scenarios, "budget": budget, "population": self.population, "seed": self.seed}

    def folder(self, setup: Setup) -> Path:
        """Return where the files of a set-up are."""
        return setup.folder / "tuned" if self.out is None else self.out

    def done(self, jobs: list[Job], title: str) -> Iterator[tuple[int, Result]]:
        """Do jobs; yield places and results as they come."""
        processes = None if self.cluster else self.processes
        return gather(jobs, self.jobs, processes=processes, cluster=self.cluster, title=title)


def tune(wanted: Tune) -> list[Path]:
    """Tune what is missing, and return the paths of the files."""
    setups = wanted.baselines()
    found = {name: _kept(name, setup, wanted) for name, setup in setups.items()}
    missing = [
        (name, weight)
        for name, setup in setups.items()
        for weight in wanted.weights_of(setup)
        if f"{weight:g}" not in found[name]
    ]
    depends = digest_of(*SEARCHED) if missing else ""
    jobs = [Job("agents.tune:tune_one", _arguments(setups[name], name, w, wanted), depends) for name, w in missing]
    for place, result in wanted.done(jobs, "tuning"):
        name, weight = missing[place]
        setup = setups[name]
        found[name][f"{weight:g}"] = as_json(name, setup, weight, wanted.search(setup), result)
        write_tuned(name, found[name], setup, wanted.folder(setup))
    return [wanted.folder(setup) / f"{name}.json" for name, setup in setups.items()]


def _kept(name: str, setup: Setup, wanted: Tune) -> dict[str, Any]:
    """Return what the file has for each weight, if it was tuned with these settings for this environment."""
    if not (wanted.folder(setup) / f"{name}.json").is_file():
        return {}
    try:
        weights = read_tuned(name, wanted.folder(setup), setup)["weights"]
    except ValueError as reason:
        print(f"{name} is tuned anew: {reason}")
        return {}
    same = {weight: found for weight, found in weights.items() if found["search"] == wanted.search(setup)}
    if same != weights:
        print(f"{name} is tuned anew at {sorted(set(weights) - set(same))}: it was tuned with other settings")
    return same


def _arguments(setup: Setup, name: str, weight: float, wanted: Tune) -> dict[str, Any]:
    rule, rtol = setup.tuned[name]
    return {
        "rule": rule, "environment": dict(setup.environment), "weight": weight, "rtol": rtol, **wanted.search(setup),
    }  # fmt: skip


def tune_one(
    rule: str,
    environment: Mapping[str, Any],
    weight: float,
    rtol: float,
    scenarios: int,
    budget: int,
    population: int,
    seed: int,
) -> Result:
    """Return the best parameters (k,) of a rule at one weight, its scores and how many generations that took."""
    kind = RULES[rule]
    options = {"scenario": "train", **environment, "rtol": rtol}
    stage = Stage(TUNING_SEED, scenarios, population, [weight] * population, threads=1, **options)

    def losses(candidates: Floats) -> Floats:
        played = stage.play(kind.of(np.repeat(candidates[:, 0], scenarios, axis=0)).for_environment(environment))
        return played.loss(weight).reshape(population, scenarios).mean(axis=1)[:, None]

    found = minimise(losses, kind.PARAMETERS, 1, population, -(-budget // population), seed)
    best = found.parameters[0]
    validation = scores(rule, environment, weight, best)
    return {
        "parameters": best,
        "train": found.loss,
        "generations": np.array([found.generations]),
        **{name: np.array([value]) for name, value in validation.items()},
    }


def scores(
    rule: str, environment: Mapping[str, Any], weight: float, parameters: Any, frozen: str = "validation"
) -> dict[str, float]:
    """Return the means over a frozen set."""
    stage = Stage.of(frozen, time_weight=[weight], threads=1, **environment)
    played = stage.play(RULES[rule].of(parameters).for_environment(environment))
    return {
        "loss": float(played.loss(weight).mean()),
        "object_velocity": float(played.object_velocity.mean()),
        "approach_time": float(played.approach_time.mean()),
        "missed": int(played.missed.sum()),
    }


def as_json(name: str, setup: Setup, weight: float, search: Mapping[str, int], result: Result) -> dict[str, Any]:
    """Return what a file keeps of what was found for one weight: its scores and how it came about."""
    rule = RULES[setup.tuned[name].rule]
    return {
        "parameters": {one.name: v for one, v in zip(rule.PARAMETERS, result["parameters"].tolist(), strict=True)},
        "train": result["train"].item(),
        "validation": {key: result[key].item() for key in ("loss", "object_velocity", "approach_time", "missed")},
        "generations": result["generations"].item(),
        "search": dict(search),
        "command": command(name, setup, weight, search),
        "versions": {"python": platform.python_version()} | {package: version(package) for package in PACKAGES},
    }


def search_bounds(wanted: Tune) -> list[Path]:
    """Search what is missing of the clairvoyant bounds, and return the paths of their files."""
    found: dict[str, dict[float, Floats]] = {}
    setups = {setup.name: setup for setup in map(load_setup, wanted.setups) if setup.bound == setup.name}
    for name, setup in setups.items():
        there = bound.path_of(setup, wanted.folder(setup)).is_file()
        found[name] = bound.read_bound(setup, wanted.folder(setup)) if there else {}
    missing = [(name, w) for name, setup in setups.items() for w in wanted.weights_of(setup) if w not in found[name]]
    depends = digest_of(*SEARCHED) if missing else ""
    jobs = [
        Job("agents.tune:search_bound", {"environment": dict(setups[n].environment), "time_weight": w}, depends)
        for n, w in missing
    ]
    for place, result in wanted.done(jobs, "clairvoyant bound"):
        name, weight = missing[place]
        found[name][weight] = result["parameters"]
        bound.write_bound(setups[name], found[name], wanted.folder(setups[name]))
    return [bound.path_of(setup, wanted.folder(setup)) for setup in setups.values()]


def search_bound(
    environment: Mapping[str, Any],
    time_weight: float,
    scenarios: int = BOUND_SCENARIOS,
    generations: int = bound.GENERATIONS,
    population: int = BOUND_POPULATION,
) -> Result:
    """Return as `parameters` (scenarios, k) those of the best `Clairvoyant` for each of the first test scenarios.

    Args:
        environment: arguments of the environment; with a scenario of its own it draws from the seeds of the set.
        time_weight: what a second costs, m/s per s.
        scenarios: how many of the set, from its first on.
        generations: of the search in each scenario.
        population: candidates of each in a generation.
    """
    options = {"rtol": BOUND_RTOL, **environment, "privileged": True, "threads": 1}
    stage = Stage.of(bound.FROZEN, scenarios, copies=population, time_weight=[time_weight] * population, **options)

    def losses(candidates: Floats) -> Floats:
        rule = Clairvoyant(candidates.reshape(population * scenarios, -1)).for_environment(environment)
        return stage.play(rule).loss(time_weight).reshape(population, scenarios)

    found = minimise(losses, Clairvoyant.PARAMETERS, scenarios, population, generations, BOUND_SEED)
    return {"parameters": np.ascontiguousarray(found.parameters)}


def command(name: str, setup: Setup, weight: float, search: Mapping[str, int]) -> str:
    """Return the command that finds it again."""
    words = ["python", "-m", "agents.tune", setup.called, "--names", name, "--weights", f"{weight:g}"]
    for option, value in search.items():
        words += [f"--{option}", str(value)]
    return shlex.join(words)


def _sentence(name: str, setup: Setup, weight: str, found: dict[str, Any]) -> str:
    means = found["validation"]
    text = (
        f"{name} at {weight}: {found['train']:.4f} m/s on train, {means['loss']:.4f} on validation "
        f"(V_p {means['object_velocity']:.4f} m/s, T {means['approach_time']:.4f} s, missed {means['missed']})"
    )
    if RULES[setup.tuned[name].rule] is BlindProfile:
        shape = constant_deceleration(BlindProfile(list(found["parameters"].values())))
        text += (
            f"; v^2 is linear in position with R^2 = {shape.r_squared:.3f}, "
            f"{shape.deceleration:.2f} m/s^2 to rest at {shape.end:.3f} m"
        )
    return text


def main() -> None:
    """Read from the command line what to tune, and tune it."""
    with command_line("agents.tune"):
        wanted = tyro.cli(Tune, prog="python -m agents.tune")
        for (name, setup), path in zip(wanted.baselines().items(), tune(wanted), strict=True):
            print(path)
            for weight, found in read_tuned(name, path.parent, setup)["weights"].items():
                print("  " + _sentence(name, setup, weight, found))
        for path in search_bounds(wanted) if wanted.bound else ():
            print(path)


if __name__ == "__main__":
    main()
