"""Files of the clairvoyant bound: for each scenario, the parameters with which `Clairvoyant` has the lowest cost.

`impact-gym tune --bound` searches for them. A controller of another class than `Clairvoyant` could have a lower cost.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.archive import archive_of, read_archive
from agents.baselines.profile import Clairvoyant
from agents.baselines.rule import Floats
from agents.setups import TUNED, Setup
from impact_gym.files import write_file
from impact_gym.task import Task

GENERATIONS = 150  # generations of the search in each scenario
FORMAT = "impact_gym clairvoyant 2"
FROZEN = "test"


def path_of(setup: Setup, folder: Path = TUNED) -> Path:
    """Return the path of the file with a set-up's bound."""
    return folder / f"clairvoyant-{setup.name}.npz"


def _search_of(setup: Setup, generations: int) -> dict[str, Any]:
    """Return the settings of a search; the file stores them, and `read_bound` compares them."""
    settings = {"set": FROZEN, "parameters": Clairvoyant.names(), "generations": generations}
    return {"environment": dict(setup.environment), **settings}


def write_bound(
    setup: Setup, by_weight: Mapping[float, Floats], folder: Path = TUNED, generations: int = GENERATIONS
) -> Path:
    """Write the best parameters (scenarios, k) for each time weight, atomically, and return the path."""
    arrays = {f"{weight:g}": by_weight[weight] for weight in sorted(by_weight)}
    return write_file(path_of(setup, folder), archive_of(FORMAT, _search_of(setup, generations), arrays))


def read_bound(setup: Setup, folder: Path = TUNED, generations: int = GENERATIONS) -> dict[float, Floats]:
    """Return the best parameters (scenarios, k) for each time weight (m/s per s); empty if there is no file."""
    path = path_of(setup, folder)
    if not path.is_file():
        return {}
    content, arrays = read_archive(path, FORMAT)
    environment = content.get("environment", {})
    wanted = {**_search_of(setup, generations), "environment": environment}
    if content != wanted or not setup.describes(Task(**environment)):
        remedy = f"impact-gym tune {setup.called} --bound"
        raise ValueError(f"{path} was searched for another environment or for other parameters: {remedy}")
    return {float(weight): parameters for weight, parameters in arrays.items()}


def bound_of(setup: Setup, folder: Path = TUNED) -> dict[float, Floats]:
    """Return the best parameters (scenarios, k) at each time weight of the evaluation; empty if a weight is missing."""
    by_weight, weights = read_bound(setup, folder), setup.evaluation.weights
    return {weight: by_weight[weight] for weight in weights} if by_weight.keys() >= set(weights) else {}
