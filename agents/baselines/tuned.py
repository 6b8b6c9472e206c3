"""The baselines by name, those with parameters as tuning found them: a JSON file each, with a checksum."""

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from agents.baselines.constant import ConstantSpeed, PaperTrapezoid
from agents.baselines.profile import BlindProfile, ConstantDeceleration
from agents.baselines.random import RandomActions
from agents.baselines.ranged import Ranged
from agents.baselines.rule import Rule
from agents.validation import Controller
from impact_gym.envs import IDS
from impact_gym.envs.task import Task
from impact_gym.files import whole_file
from impact_gym.validation import number

TUNED = Path(__file__).parents[1] / "tuned"
FORMAT = "impact_gym tuned baseline 1"


class Tunable(NamedTuple):
    """A rule and the preset, or the registered id, whose environment it is tuned for."""

    rule: type[Rule]
    preset: str
    rtol: float = Task.rtol  # of the simulation while searching; scores are played at the environment's


TUNABLE = {
    "constant-speed": Tunable(ConstantSpeed, "linear-blind"),
    "constant-deceleration": Tunable(ConstantDeceleration, "linear-blind"),
    "blind-profile": Tunable(BlindProfile, "linear-blind"),
    "ranged": Tunable(Ranged, "linear-ranged"),
    "bistable-constant-speed": Tunable(ConstantSpeed, "bistable-blind"),
    "bistable-blind-profile": Tunable(
        BlindProfile, "bistable-blind", rtol=1e-5
    ),  # twice as fast; V_p is within 1e-6 m/s
    "rigid-blind-profile": Tunable(BlindProfile, "ImpactApproachRigid-v0"),
}
NOUNS = {"parameters": "table of parameters"}
FIXED = {"paper-trapezoid": PaperTrapezoid, "random": RandomActions}


def environment_of(preset: str) -> dict[str, Any]:
    """Return the arguments of a preset's environment, or of the registered id `preset`."""
    from agents.settings import ENVIRONMENTS  # needs tyro, which one who only plays a baseline may not have

    return {**IDS, **ENVIRONMENTS}[preset]


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
    return TUNABLE[name].rule.of(list(content["weights"][f"{nearest:g}"]["parameters"].values()))


def read_tuned(name: str, folder: Path = TUNED) -> dict[str, Any]:
    """Return what `write_tuned` wrote: what was tuned, and below "weights" what was found for each.

    Raises:
        ValueError: as in `load_baseline`.
    """
    if name not in TUNABLE:
        raise ValueError(f"no baseline {name!r}: there are {sorted([*FIXED, *TUNABLE])}")
    path = folder / f"{name}.json"
    try:
        content: dict[str, Any] = json.loads(path.read_text())
        found = _checksum(content)
        if found != content["sha256"]:
            raise ValueError(f"its checksum is {found}, not {content['sha256']}: it was altered")
        about = {field: content[field] for field in _about(name)}
    except FileNotFoundError:
        raise ValueError(f"baseline {name!r} was not tuned, there is no {path}: {_remedy(name)}") from None
    except (OSError, LookupError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{path} is no tuned baseline, or is damaged: {error}; {_remedy(name)}") from error
    for field, value in _about(name).items():
        if about[field] != value:
            raise ValueError(
                f"{path} was tuned for another {NOUNS.get(field, field)} than this version's: {_remedy(name)}"
            )
    return content


def write_tuned(name: str, weights: Mapping[str, Any], folder: Path = TUNED) -> Path:
    """Write what was found for each weight, whole or not at all, and return where."""
    content = {**_about(name), "weights": {key: weights[key] for key in sorted(weights, key=float)}}
    path = folder / f"{name}.json"
    with whole_file(path) as file:
        file.write((json.dumps({**content, "sha256": _checksum(content)}, indent=2) + "\n").encode())
    return path


def _about(name: str) -> dict[str, Any]:
    """What a tuned file is for, as JSON gives it back."""
    rule, preset, _ = TUNABLE[name]
    limits = [{"name": one.name, "unit": one.unit, "low": one.low, "high": one.high} for one in rule.PARAMETERS]
    about = {
        "format": FORMAT,
        "baseline": name,
        "rule": rule.__name__,
        "parameters": limits,
        "environment": environment_of(preset),
    }
    plain: dict[str, Any] = json.loads(json.dumps(about))
    return plain


def _remedy(name: str) -> str:
    return f"python -m agents.tune {name}"


def _checksum(content: Mapping[str, Any]) -> str:
    """SHA-256 of all but the checksum."""
    rest = {field: value for field, value in content.items() if field != "sha256"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()
