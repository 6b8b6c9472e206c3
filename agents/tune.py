"""Tune the baselines: `python -m agents.tune [SETUP ...]`, or `make tune`.

Each is tuned for each time weight by CMA-ES, on scenarios of the training ranges that no evaluation uses, the same ones
for all candidates. What was found goes to agents/tuned/NAME.json as soon as a weight is done; the same command goes on
where it was stopped, and does nothing where all is done. What was tuned with other settings, or for an environment that
has changed since, is tuned anew.
"""

import multiprocessing
import platform
import shlex
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from tqdm import tqdm

from agents.baselines.cmaes import minimise
from agents.baselines.profile import BlindProfile, constant_deceleration
from agents.baselines.rule import Floats
from agents.baselines.tuned import RULES, read_tuned, write_tuned
from agents.evaluate.stage import TUNING_SEED, Stage
from agents.setups import Setup, load_setup, shipped
from agents.setups.evaluation import WEIGHTS
from impact_gym.validation import number, whole

SETUPS = shipped()
PACKAGES = ("impact-gym", "cma", "numpy", "scipy")


@dataclass(frozen=True)
class Tune:
    """Tune the baselines of set-ups for time weights."""

    setups: tyro.conf.Positional[tuple[str, ...]] = SETUPS
    """Names or files; all that are shipped unless some are named."""
    names: tuple[str, ...] = ()
    """Of their baselines only these."""
    weights: tuple[float, ...] = WEIGHTS
    """What a second of approach costs, m/s per s."""
    scenarios: int = 300
    """Training scenarios that each candidate is played through."""
    budget: int | None = None
    """Candidates for each weight; what the set-up says unless given."""
    population: int = 16
    """Of these in a generation: they are played together."""
    seed: int = 1
    """Of the search."""
    processes: int = 2
    """Weights at a time; each uses one core."""
    out: Path | None = None
    """Folder of the files; that of the shipped ones unless given, for a set-up from a file runs/NAME/tuned."""

    def __post_init__(self) -> None:
        for name in ("scenarios", "processes"):
            whole(name, getattr(self, name), at_least=1)
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

    def search(self, setup: Setup) -> dict[str, int]:
        """Return what the result depends on."""
        budget = setup.budget if self.budget is None else self.budget
        return {"scenarios": self.scenarios, "budget": budget, "population": self.population, "seed": self.seed}

    def folder(self, setup: Setup) -> Path:
        """Return where the files of a set-up are."""
        return setup.folder / "tuned" if self.out is None else self.out


def tune(wanted: Tune) -> list[Path]:
    """Tune what is missing, and return the paths of the files."""
    setups = wanted.baselines()
    done = {name: _done(name, setup, wanted) for name, setup in setups.items()}
    missing = [(name, weight) for name in setups for weight in wanted.weights if f"{weight:g}" not in done[name]]
    context = multiprocessing.get_context("spawn")
    tqdm.set_lock(context.RLock())
    with ProcessPoolExecutor(wanted.processes, context, tqdm.set_lock, (tqdm.get_lock(),)) as pool:
        jobs = {pool.submit(tune_one, name, setups[name], weight, wanted): (name, weight) for name, weight in missing}
        try:
            for job in as_completed(jobs):
                name, weight = jobs[job]
                done[name][f"{weight:g}"] = job.result()
                write_tuned(name, done[name], setups[name], wanted.folder(setups[name]))
                tqdm.write(_sentence(name, setups[name], f"{weight:g}", job.result()))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return [wanted.folder(setup) / f"{name}.json" for name, setup in setups.items()]


def _done(name: str, setup: Setup, wanted: Tune) -> dict[str, Any]:
    """What an earlier run found for each weight, with these settings and in today's environment."""
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


def tune_one(name: str, setup: Setup, weight: float, wanted: Tune) -> dict[str, Any]:
    """Return what was found for one weight, its scores and how it came about."""
    rule, search = RULES[setup.tuned[name].rule], wanted.search(setup)
    population, scenarios = wanted.population, wanted.scenarios
    options = {"scenario": "train", **setup.environment, "rtol": setup.tuned[name].rtol}
    stage = Stage(TUNING_SEED, scenarios, population, [weight] * population, threads=1, **options)

    def losses(candidates: Floats) -> Floats:
        played = stage.play(rule.of(np.repeat(candidates[:, 0], scenarios, axis=0)).for_environment(setup.environment))
        return played.loss(weight).reshape(population, scenarios).mean(axis=1)[:, None]

    generations = -(-search["budget"] // population)
    with tqdm(total=generations, desc=f"{name} at {weight:g}", leave=False, disable=None) as bar:

        def told(loss: float) -> None:
            bar.set_postfix_str(f"{loss:.4f} m/s", refresh=False)
            bar.update()

        found = minimise(losses, rule.PARAMETERS, 1, population, generations, wanted.seed, told)
    best = found.parameters[0].tolist()
    return {
        "parameters": {one.name: value for one, value in zip(rule.PARAMETERS, best, strict=True)},
        "train": float(found.loss[0]),
        "validation": scores(name, setup, weight, best),
        "generations": found.generations,
        "search": search,
        "command": command(name, setup, weight, search),
        "versions": {"python": platform.python_version()} | {package: version(package) for package in PACKAGES},
    }


def scores(name: str, setup: Setup, weight: float, parameters: Any, frozen: str = "validation") -> dict[str, float]:
    """Return the means over a frozen set."""
    stage = Stage.of(frozen, time_weight=[weight], threads=1, **setup.environment)
    played = stage.play(RULES[setup.tuned[name].rule].of(parameters).for_environment(setup.environment))
    return {
        "loss": float(played.loss(weight).mean()),
        "object_velocity": float(played.object_velocity.mean()),
        "approach_time": float(played.approach_time.mean()),
        "missed": int(played.missed.sum()),
    }


def command(name: str, setup: Setup, weight: float, search: dict[str, int]) -> str:
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
    try:
        wanted = tyro.cli(Tune, prog="python -m agents.tune")
        for (name, setup), path in zip(wanted.baselines().items(), tune(wanted), strict=True):
            print(path)
            for weight, found in read_tuned(name, path.parent, setup)["weights"].items():
                print("  " + _sentence(name, setup, weight, found))
    except ValueError as error:
        sys.exit(f"agents.tune: {error}")
    except BrokenProcessPool:
        sys.exit("agents.tune: one of its processes was killed; the same command goes on")
    except KeyboardInterrupt:
        sys.exit("agents.tune: interrupted; the same command goes on")


if __name__ == "__main__":
    main()
