"""Load baselines by name; read and write a set-up's files of tuned baselines and of the clairvoyant bound.

The file of a tuned baseline is JSON with a checksum. The file of a bound holds, for each scenario, the best parameters
found for `Clairvoyant`, a rule that knows the scenario. Another controller could still have a lower cost.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.baselines import FIXED, RULES, Clairvoyant, Rule, tuned_rule
from agents.baselines.rule import Floats, ranges_for, tuned_parameters
from agents.policies import Controller
from agents.setups.setup import TUNED, Setup, setup_tuning, shipped_baselines
from impact_gym.support.archive import archive_of, checksum, read_archive, refuse_altered
from impact_gym.support.files import NO_FILE, parsed, reason, write_file
from impact_gym.support.validation import nearest, number, one_of
from impact_gym.task import Task
from impact_gym.teleop.channels import without_files

FORMAT = "impact_gym tuned baseline 1"
BOUND_FORMAT = "impact_gym clairvoyant 2"
BOUND_SET = "test"  # name of the shipped set of scenarios for which a bound is searched
BOUND_GENERATIONS = 150  # largest number of generations in the search for each scenario


def load_baseline(name: str | Path, time_weight: float = 2.0, folder: Path | str | None = None) -> Controller:
    """Return a baseline, by its name (in `folder`) or its file, for `time_weight` (m/s per s), see `Rule.at`.

    Raises:
        TypeError, ValueError: there is no such baseline; the time weight is not above 0; the file is missing or
            altered, or does not fit this version.
    """
    number("time_weight", time_weight, "m/s per s", above=0)
    one_of("baseline", name, str, os.PathLike)
    if name in FIXED:
        return FIXED[name]()
    return tuned_rule(read_tuned(name, Path(folder) if folder else None)).at(time_weight)


def read_tuned(name: str | Path, folder: Path | None = None, setup: Setup | None = None) -> dict[str, Any]:
    """Return the content of a tuned baseline's file; its entry "weights" has the result for each time weight.

    `name` is the baseline's name, or the path of its JSON file (in `folder`). The file must fit the set-up that tunes
    the baseline, see `setup_tuning`. Default folder: the subfolder `tuned` of the set-up's folder, or TUNED if no
    set-up tunes the baseline.
    """
    path = Path(folder or "", name)
    name, folder = (path.stem, path.parent) if path.suffix == ".json" else (str(name), folder)
    setup = setup_tuning(name, setup)
    path = (folder or (setup.folder / "tuned" if setup else TUNED)) / f"{name}.json"
    if setup is None and not os.path.lexists(path):
        raise ValueError(nearest("baseline", name, [*FIXED, *shipped_baselines()]))
    remedy = f"run impact-gym tune {setup.cli_name if setup else 'SETUP'} --out {path.parent}"
    if not path.is_file():
        why = f"{path} must be a file, but it is {NO_FILE}" if os.path.lexists(path) else f"there is no file {path}"
        raise ValueError(f"baseline {name!r} was not tuned ({why}): {remedy}")
    try:
        content: dict[str, Any] = parsed(path, "JSON", json.loads)
        refuse_altered(content["sha256"], {field: value for field, value in content.items() if field != "sha256"})
        task = Task.of_file(without_files(content["environment"]))
        expected = _description(name, setup.tuned[name].rule if setup else RULES[content["rule"]], task)
        other = [field for field, value in expected.items() if content[field] != value]
        if setup and not setup.describes(task):
            other.append("environment")
        if not other:
            tuned_parameters(content)
    except (LookupError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{path} is no tuned baseline, or it is damaged: {reason(error)}; {remedy}") from error
    if other:
        what = "table of parameters" if other[0] == "parameters" else other[0]
        raise ValueError(f"the {what} in {path} differs from that of this version or of the set-up: {remedy}")
    return content


def write_tuned(name: str, weights: Mapping[str, Any], setup: Setup, folder: Path = TUNED) -> Path:
    """Write the file of a baseline atomically, with the result for each time weight; return the path."""
    ordered = {key: weights[key] for key in sorted(weights, key=float)}
    made_for = {**_description(name, setup.tuned[name].rule, setup.task), "environment": dict(setup.environment)}
    content = json.loads(json.dumps({**made_for, "weights": ordered}))
    text = json.dumps({**content, "sha256": checksum(content)}, indent=2)
    return write_file(folder / f"{name}.json", text + "\n")


def _description(name: str, rule: type[Rule], task: Task) -> dict[str, Any]:
    fields, parameters = ("name", "unit", "low", "high"), rule.limited(ranges_for(task))
    limits = [{field: getattr(parameter, field) for field in fields} for parameter in parameters]
    return {"format": FORMAT, "baseline": name, "rule": rule.__name__, "parameters": limits}


def bound_path(setup: Setup, folder: Path = TUNED) -> Path:
    """Return the path of the file with a set-up's bound."""
    return folder / f"clairvoyant-{setup.name}.npz"


def write_bound(
    setup: Setup, by_weight: Mapping[float, Floats], folder: Path = TUNED, generations: int = BOUND_GENERATIONS
) -> Path:
    """Write the best parameters (scenarios, k) for each time weight, atomically; return the path."""
    arrays = {f"{weight:g}": by_weight[weight] for weight in sorted(by_weight)}
    search = {"set": BOUND_SET, "parameters": Clairvoyant.names(), "generations": generations}
    content = {"environment": dict(setup.environment), **search}
    return write_file(bound_path(setup, folder), archive_of(BOUND_FORMAT, content, arrays))


def read_bound(setup: Setup, folder: Path = TUNED, generations: int = BOUND_GENERATIONS) -> dict[float, Floats]:
    """Return the best parameters (scenarios, k) for each time weight (m/s per s); empty if there is no file."""
    path = bound_path(setup, folder)
    if not path.is_file():
        return {}
    content, arrays = read_archive(path, BOUND_FORMAT)
    environment = content.pop("environment", {})
    search = {"set": BOUND_SET, "parameters": Clairvoyant.names(), "generations": generations}
    if content != search or not setup.describes(Task.of_file(environment)):
        remedy = f"run impact-gym tune {setup.cli_name} --bound"
        raise ValueError(f"{path} has a clairvoyant bound for another environment or other search settings: {remedy}")
    return {float(weight): parameters for weight, parameters in arrays.items()}


def bound_of(setup: Setup, folder: Path = TUNED) -> dict[float, Floats]:
    """Return the best parameters (scenarios, k) at each time weight of the evaluation; empty if a weight is missing."""
    by_weight, weights = read_bound(setup, folder), setup.evaluation.weights
    return {weight: by_weight[weight] for weight in weights} if by_weight.keys() >= set(weights) else {}
