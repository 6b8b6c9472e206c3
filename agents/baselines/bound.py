"""The bound: for every scenario by itself, the best that a controller does that knows it.

`python -m agents.baselines.bound` searches it for the first scenarios of the frozen test set and writes what it found
to agents/tuned/clairvoyant-SETUP.npz; what is there is kept, so the same command goes on where it was stopped.
"""

import json
import multiprocessing
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from tqdm import tqdm

from agents.archive import read_archive, write_archive
from agents.baselines.clairvoyant import Clairvoyant
from agents.baselines.cmaes import minimise
from agents.baselines.rule import Floats
from agents.baselines.tuned import TUNED
from agents.evaluate.stage import Episodes, Stage
from agents.setups import load_setup
from agents.setups.evaluation import WEIGHTS
from impact_gym.validation import whole

SCENARIOS, GENERATIONS, POPULATION, SEED = 64, 150, 16, 1
SEARCH_RTOL = (
    1e-5  # of the simulation while searching; V_p is within 1e-6 m/s, and the best is played as all others are
)
FORMAT = "impact_gym clairvoyant 1"
FROZEN = "test"
AS_SHIPPED = (FROZEN, GENERATIONS, POPULATION)
SETUPS = ("linear-blind", "bistable-blind")


@dataclass(frozen=True)
class Wanted:
    """Search the bound for set-ups, at each time weight of the bars."""

    setups: tyro.conf.Positional[tuple[str, ...]] = SETUPS
    """Which ones, by name or file."""
    scenarios: int = SCENARIOS
    """How many of the test set, from its first on."""
    generations: int = GENERATIONS
    """Of the search in each scenario."""
    processes: int = 2
    """Weights at a time; each uses one core."""
    out: Path | None = None
    """Folder of the files; that of the shipped ones unless given, for a set-up from a file runs/NAME/tuned."""

    def __post_init__(self) -> None:
        for name in ("scenarios", "generations", "processes"):
            whole(name, getattr(self, name), at_least=1)
        for name in self.setups:
            load_setup(name)


def clairvoyant_bound(
    setup: str,
    time_weight: float,
    frozen: str = FROZEN,
    scenarios: int = SCENARIOS,
    generations: int = GENERATIONS,
    population: int = POPULATION,
) -> Episodes:
    """Optimise a `Clairvoyant` for each of the first `scenarios` of a frozen set alone, and play each through its own.

    What is shipped is not searched again. It is a bound on the rules of its kind, found by search: a controller with
    other freedoms could still do better.
    """
    shipped = shipped_scenarios(setup) if (frozen, generations, population) == AS_SHIPPED else 0
    if scenarios <= shipped:
        found = load_clairvoyant(setup, time_weight).parameters[:scenarios]
    else:
        found = search(setup, time_weight, frozen, scenarios, generations, population)
    environment = load_setup(setup).environment
    stage = Stage.of(frozen, scenarios, time_weight=[time_weight], **environment, privileged=True)
    return stage.play(Clairvoyant(found).for_environment(environment))


def search(
    setup: str,
    time_weight: float,
    frozen: str = FROZEN,
    scenarios: int = SCENARIOS,
    generations: int = GENERATIONS,
    population: int = POPULATION,
    threads: int | None = None,
    told: Callable[[float], object] = lambda loss: None,
) -> Floats:
    """Return the parameters (scenarios, k) of the best `Clairvoyant` for each scenario."""
    options: dict[str, Any] = {**load_setup(setup).environment, "privileged": True, "threads": threads}
    weights = [time_weight] * population
    stage = Stage.of(frozen, scenarios, copies=population, time_weight=weights, **{"rtol": SEARCH_RTOL, **options})

    def losses(candidates: Floats) -> Floats:
        played = stage.play(
            Clairvoyant(candidates.reshape(population * scenarios, -1)).for_environment(load_setup(setup).environment)
        )
        return played.loss(time_weight).reshape(population, scenarios)

    found = minimise(losses, Clairvoyant.PARAMETERS, scenarios, population, generations, SEED, told)
    return np.ascontiguousarray(found.parameters)


def load_clairvoyant(setup: str, time_weight: float, folder: Path = TUNED) -> Clairvoyant:
    """Return the controller whose row k is made for scenario k of the test set, in an environment with `privileged`.

    Raises:
        ValueError: it was not searched for this set-up and weight, or for other parameters, or the file is damaged.
    """
    content, arrays = read_archive(folder / f"clairvoyant-{setup}.npz", FORMAT)
    names = [parameter.name for parameter in Clairvoyant.PARAMETERS]
    if content["parameters"] != names or f"{time_weight:g}" not in arrays:
        raise ValueError(f"the bound of {setup} at {time_weight:g} was not searched: python -m agents.baselines.bound")
    return Clairvoyant(arrays[f"{time_weight:g}"])


def shipped_scenarios(setup: str, folder: Path = TUNED) -> int:
    """Return for how many scenarios of the test set the bound of a set-up is shipped at every weight; 0 for none."""
    try:
        return min(len(load_clairvoyant(setup, weight, folder).parameters) for weight in WEIGHTS)
    except ValueError:
        return 0


def _search_one(setup: str, weight: float, wanted: Wanted) -> Floats:
    with tqdm(total=wanted.generations, desc=f"{setup} at {weight:g}", leave=False, disable=None) as bar:

        def told(loss: float) -> None:
            bar.set_postfix_str(f"{loss:.4f} m/s", refresh=False)
            bar.update()

        return search(setup, weight, scenarios=wanted.scenarios, generations=wanted.generations, threads=1, told=told)


def search_all(wanted: Wanted) -> list[Path]:
    """Search what is missing, and return the paths of the files."""
    names = [parameter.name for parameter in Clairvoyant.PARAMETERS]
    paths = []
    with ProcessPoolExecutor(wanted.processes, multiprocessing.get_context("spawn")) as pool:
        for setup in map(load_setup, wanted.setups):
            path = (setup.folder / "tuned" if wanted.out is None else wanted.out) / f"clairvoyant-{setup.name}.npz"
            about = {
                "preset": setup.name,
                **({} if setup.shipped else {"environment": json.loads(json.dumps(dict(setup.environment)))}),
                "set": FROZEN,
                "parameters": names,
                **{name: getattr(wanted, name) for name in ("scenarios", "generations")},
            }
            arrays: dict[str, Any] = {}
            if path.is_file():
                content, there = read_archive(path, FORMAT)
                arrays = there if content == about else {}
            missing = {
                weight: pool.submit(_search_one, str(setup.path), weight, wanted)
                for weight in WEIGHTS
                if f"{weight:g}" not in arrays
            }
            for weight, job in missing.items():
                arrays[f"{weight:g}"] = job.result()
                write_archive(path, FORMAT, about, arrays)
            paths.append(path)
    return paths


def main() -> None:
    """Read from the command line what to search, and search it."""
    try:
        for path in search_all(tyro.cli(Wanted, prog="python -m agents.baselines.bound")):
            print(path)
    except ValueError as error:
        sys.exit(f"agents.baselines.bound: {error}")
    except KeyboardInterrupt:
        sys.exit("agents.baselines.bound: interrupted; the same command goes on")


if __name__ == "__main__":
    main()
