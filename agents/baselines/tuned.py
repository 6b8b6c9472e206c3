"""The baselines by name, those with parameters as tuning found them: a JSON file each, with a checksum."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from agents import setups
from agents.baselines.rule import Floats, Rule
from agents.policies import Controller
from agents.setups import TUNED, Setup, owner, shipped_baselines
from impact_gym.files import parsed, write_file
from impact_gym.validation import nearest, number

FORMAT = "impact_gym tuned baseline 1"
RULES: dict[str, type[Rule]] = {name: resolve_name(place) for name, place in setups.RULES.items()}
FIXED: dict[str, Any] = {name: resolve_name(place) for name, place in setups.FIXED.items()}


def load_baseline(name: str, time_weight: float = 2.0, folder: Path = TUNED) -> Controller:
    """Return a baseline, with what was tuned for `time_weight` (m/s per s).

    Between weights that were tuned for, parameters are interpolated over the logarithm of the weight; beyond, they are
    those of the last.

    Raises:
        ValueError: no such baseline; or its file is missing, or altered, or was made for other parameters or for
            another environment than this version has.
    """
    number("time_weight", time_weight, "m/s per s", above=0)
    if name in FIXED:
        return FIXED[name]()
    return tuned_rule(read_tuned(name, folder), time_weight)


def tuned_rule(content: Mapping[str, Any], time_weight: float) -> Rule:
    """Return the rule in what `read_tuned` returned for a weight (m/s per s), interpolated as in `load_baseline`."""
    weights, rule = tuned_table(content)
    rule.parameters = interpolated(weights, rule.parameters, time_weight)
    return rule


def tuned_table(content: Mapping[str, Any]) -> tuple[list[float], Rule]:
    """Return the weights (m/s per s) in what `read_tuned` returned, rising, and the rule with (weights, k) parameters.

    Raises:
        ValueError: it holds no weight, or a parameter out of its limits.
    """
    if not content["weights"]:
        raise ValueError(f"baseline {content['baseline']!r} holds no weight: tune it")
    tuned = {float(weight): found["parameters"] for weight, found in content["weights"].items()}
    weights, names = sorted(tuned), [parameter["name"] for parameter in content["parameters"]]  # JSON may be reordered
    table = [[tuned[weight][name] for name in names] for weight in weights]
    return weights, RULES[content["rule"]].of(table).for_environment(content["environment"])


def interpolated(weights: Sequence[float], table: Floats, time_weight: ArrayLike) -> Floats:
    """Return the parameters (..., k) for weights (...) between those of the rows of `table` (weights, k)."""
    at, logarithms = np.log(time_weight), np.log(weights)
    return np.stack([np.interp(at, logarithms, column) for column in table.T], axis=-1)


def read_tuned(name: str, folder: Path = TUNED, setup: Setup | None = None) -> dict[str, Any]:
    """Return what `write_tuned` wrote: what was tuned, and below "weights" what was found for each.

    It must be what `setup` has tuned, or the shipped set-up of which it is one; a file of neither is taken as it is.

    Raises:
        ValueError: as in `load_baseline`.
    """
    path, setup = folder / f"{name}.json", setup or owner(name)
    if setup is None and not path.is_file():
        raise ValueError(nearest("baseline", name, [*FIXED, *shipped_baselines()]))
    remedy = f"impact-gym tune {setup.called if setup else 'SETUP'}"
    if not path.is_file():
        raise ValueError(f"baseline {name!r} was not tuned, there is no {path}: {remedy}")
    try:
        content: dict[str, Any] = parsed(path, "JSON", json.loads)
        checksum = _checksum(content)
        if checksum != content["sha256"]:
            raise ValueError(f"its checksum is {checksum}, not {content['sha256']}: it was altered")
        expected = _description(name, setup.tuned[name].rule if setup else content["rule"])
        other = [field for field, value in expected.items() if content[field] != value]
        if setup and not setup.describes(content["environment"]):
            other.append("environment")
    except (LookupError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{path} is no tuned baseline, or is damaged: {error}; {remedy}") from error
    if other:
        what = "table of parameters" if other[0] == "parameters" else other[0]
        raise ValueError(f"{path} was tuned for another {what} than this version's: {remedy}")
    return content


def write_tuned(name: str, weights: Mapping[str, Any], setup: Setup, folder: Path = TUNED) -> Path:
    """Write what was found for each weight, whole or not at all, and return where."""
    ordered = {key: weights[key] for key in sorted(weights, key=float)}
    made_for = {**_description(name, setup.tuned[name].rule), "environment": dict(setup.environment)}
    content = json.loads(json.dumps({**made_for, "weights": ordered}))
    text = json.dumps({**content, "sha256": _checksum(content)}, indent=2)
    return write_file(folder / f"{name}.json", text + "\n")


def _description(name: str, rule: str) -> dict[str, Any]:
    """What a tuned file is, but for its environment."""
    fields = ("name", "unit", "low", "high")
    limits = [{field: getattr(parameter, field) for field in fields} for parameter in RULES[rule].PARAMETERS]
    return {"format": FORMAT, "baseline": name, "rule": rule, "parameters": limits}


def _checksum(content: Mapping[str, Any]) -> str:
    """SHA-256 of all but the checksum."""
    rest = {field: value for field, value in content.items() if field != "sha256"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()
