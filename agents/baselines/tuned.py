"""The baselines by name, those with parameters as tuning found them: a JSON file each, with a checksum."""

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.baselines.constant import ConstantSpeed, PaperTrapezoid
from agents.baselines.profile import BlindProfile, ConstantDeceleration
from agents.baselines.random import RandomActions
from agents.baselines.ranged import Ranged
from agents.baselines.rule import Rule
from agents.setups import Setup, owner
from agents.validation import Controller
from impact_gym.files import whole_file
from impact_gym.validation import number

TUNED = Path(__file__).parents[1] / "tuned"
FORMAT = "impact_gym tuned baseline 1"
NOUNS = {"parameters": "table of parameters"}


RULES: dict[str, type[Rule]] = {
    rule.__name__: rule for rule in (BlindProfile, ConstantDeceleration, ConstantSpeed, Ranged)
}
FIXED = {"paper-trapezoid": PaperTrapezoid, "random": RandomActions}


def names() -> list[str]:
    """Return the baselines that are shipped with what tuning found."""
    return sorted(path.stem for path in TUNED.glob("*.json"))


def load_baseline(name: str, time_weight: float = 2.0, folder: Path = TUNED) -> Controller:
    """Return a baseline, with what was tuned for `time_weight` (m/s per s).

    Where nothing was tuned for that weight, it is what was tuned for the nearest one, by ratio.

    Raises:
        ValueError: no such baseline; or its file is missing, or altered, or was made for other parameters or for
            another environment than this version has.
    """
    number("time_weight", time_weight, "m/s per s", above=0)
    if name in FIXED:
        return FIXED[name]()
    content = read_tuned(name, folder)
    weights = [float(weight) for weight in content["weights"]]
    if not weights:
        raise ValueError(f"{folder / name}.json holds no weight: {_remedy(name)}")
    nearest = min(weights, key=lambda weight: abs(math.log(weight / time_weight)))
    return RULES[content["rule"]].of(list(content["weights"][f"{nearest:g}"]["parameters"].values()))


def read_tuned(name: str, folder: Path = TUNED, setup: Setup | None = None) -> dict[str, Any]:
    """Return what `write_tuned` wrote: what was tuned, and below "weights" what was found for each.

    It must be what `setup` has tuned, or the shipped set-up of which it is a baseline.

    Raises:
        ValueError: as in `load_baseline`.
    """
    path, setup = folder / f"{name}.json", setup or owner(name)
    if setup is None or name not in setup.tuned:
        raise ValueError(f"no baseline {name!r}: there are {sorted([*FIXED, *names()])}")
    try:
        content: dict[str, Any] = json.loads(path.read_text())
        found = _checksum(content)
        if found != content["sha256"]:
            raise ValueError(f"its checksum is {found}, not {content['sha256']}: it was altered")
        about = {field: content[field] for field in _about(name, setup)}
        elsewhere = not setup.is_of(about.pop("environment"))
    except FileNotFoundError:
        raise ValueError(f"baseline {name!r} was not tuned, there is no {path}: {_remedy(setup)}") from None
    except (OSError, LookupError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{path} is no tuned baseline, or is damaged: {error}; {_remedy(setup)}") from error
    other = [NOUNS.get(field, field) for field, value in about.items() if _about(name, setup)[field] != value]
    if other or elsewhere:
        what = other[0] if other else "environment"
        raise ValueError(f"{path} was tuned for another {what} than this version's: {_remedy(setup)}")
    return content


def write_tuned(name: str, weights: Mapping[str, Any], setup: Setup, folder: Path = TUNED) -> Path:
    """Write what was found for each weight, whole or not at all, and return where."""
    content = {**_about(name, setup), "weights": {key: weights[key] for key in sorted(weights, key=float)}}
    path = folder / f"{name}.json"
    with whole_file(path) as file:
        file.write((json.dumps({**content, "sha256": _checksum(content)}, indent=2) + "\n").encode())
    return path


def _about(name: str, setup: Setup) -> dict[str, Any]:
    """What a tuned file is for, as JSON gives it back."""
    rule = RULES[setup.tuned[name].rule]
    limits = [{"name": one.name, "unit": one.unit, "low": one.low, "high": one.high} for one in rule.PARAMETERS]
    about = {
        "format": FORMAT,
        "baseline": name,
        "rule": rule.__name__,
        "parameters": limits,
        "environment": dict(setup.environment),
    }
    plain: dict[str, Any] = json.loads(json.dumps(about))
    return plain


def _remedy(setup: Setup) -> str:
    return f"python -m agents.tune {setup.name}"


def _checksum(content: Mapping[str, Any]) -> str:
    """SHA-256 of all but the checksum."""
    rest = {field: value for field, value in content.items() if field != "sha256"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()
