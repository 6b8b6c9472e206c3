"""The clairvoyant bound: for each scenario, the best cost of a controller that knows it.

It is found by search among the rules of one kind: a controller with other parameters could do better.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.archive import read_archive, write_archive
from agents.baselines.profile import Clairvoyant
from agents.baselines.rule import Floats
from agents.setups import TUNED, Setup
from impact_gym.task import Task

GENERATIONS = 150  # of the search in each scenario
FORMAT = "impact_gym clairvoyant 2"
FROZEN = "test"


def _search(generations: int) -> dict[str, Any]:
    """Return the settings of the search, as in the file."""
    return {"set": FROZEN, "parameters": Clairvoyant.names(), "generations": generations}


def path_of(setup: Setup, folder: Path = TUNED) -> Path:
    """Return where the bound of a set-up is kept."""
    return folder / f"clairvoyant-{setup.name}.npz"


def write_bound(
    setup: Setup, by_weight: Mapping[float, Floats], folder: Path = TUNED, generations: int = GENERATIONS
) -> Path:
    """Write the best parameters (scenarios, k) for each time weight, atomically, and return the path."""
    path, content = path_of(setup, folder), {"environment": dict(setup.environment), **_search(generations)}
    write_archive(path, FORMAT, content, {f"{weight:g}": by_weight[weight] for weight in sorted(by_weight)})
    return path


def read_bound(setup: Setup, folder: Path = TUNED, generations: int = GENERATIONS) -> dict[float, Floats]:
    """Return the parameters (scenarios, k) of a set-up's bound by time weight, m/s per s.

    Raises:
        ValueError: there is none, it is damaged, or its search was for another environment, for other parameters or of
            another length.
    """
    path, remedy = path_of(setup, folder), f"impact-gym tune {setup.called} --bound"
    try:
        content, arrays = read_archive(path, FORMAT)
    except ValueError as error:
        raise ValueError(f"the bound of {setup.name} was not searched: {error}; {remedy}") from error
    same = all(content[name] == value for name, value in _search(generations).items())
    if not same or not setup.describes(Task(**content["environment"])):
        raise ValueError(f"{path} is of a search for another environment or for other parameters: {remedy}")
    return {float(weight): parameters for weight, parameters in arrays.items()}


def bound_of(setup: Setup, folder: Path = TUNED) -> dict[float, Floats]:
    """Return the parameters (scenarios, k) at each weight of the set-up's evaluation; empty where one is missing."""
    if not path_of(setup, folder).is_file():
        return {}
    by_weight, weights = read_bound(setup, folder), setup.evaluation.weights
    return {weight: by_weight[weight] for weight in weights} if by_weight.keys() >= set(weights) else {}
