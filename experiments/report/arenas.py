"""Who meets whom, where: a recipe of training, each seed of it a policy, against baselines on the same scenarios."""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.baselines.tuned import TUNABLE, environment_of
from agents.controllers import controller_of
from agents.policy import SHIPPED, Policy, load_policy
from agents.validation import WEIGHTS
from impact_gym.envs import evaluation_sets
from impact_gym.envs.scenario import FIELDS, ScenarioRanges
from impact_gym.envs.task import Task
from impact_gym.validation import number, whole

PAPER = "paper's rule"
POLICY = "learned policy"
CURVE = (0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)
"""Time weights (m/s per s) at which a policy is played, as far as it was trained for them."""
TYPICAL = 2.0  # m/s per s, where one weight must do
PRESETS = ("linear-blind", "linear-ranged", "bistable-blind")
RIVALS = {
    "linear-blind": ("blind-profile", "constant-deceleration", "constant-speed"),
    "linear-ranged": ("ranged", "blind-profile", "constant-speed"),
    "bistable-blind": ("bistable-blind-profile", "bistable-constant-speed"),
}
"""Baselines tuned for each weight; the first is the one that a policy has to beat."""


@dataclass(frozen=True)
class Contestant:
    """One that plays, and at which time weights (m/s per s)."""

    name: str
    controller: Mapping[str, Any]  # JSON, see `agents.controllers`
    weights: tuple[float, ...]


@dataclass(frozen=True)
class Arena:
    """An environment, a recipe of training and the baselines beside it."""

    name: str
    environment: Mapping[str, Any]  # arguments, JSON, but for scenario and time weight
    seeds: tuple[Contestant, ...]  # one for each training seed
    chosen: str  # name of the median seed
    baselines: tuple[Contestant, ...]  # the paper's rule is the first, the rival the second if there is one
    scenarios: Mapping[str, Any]  # JSON, see `play.stage`
    provenance: Mapping[str, Any]  # of the median seed

    @property
    def policy(self) -> Contestant:
        """The median seed."""
        return next(one for one in self.seeds if one.name == self.chosen)

    @property
    def rival(self) -> Contestant:
        """The baseline to beat: the paper's rule where there is no other."""
        return self.baselines[1] if len(self.baselines) > 1 else self.baselines[0]

    @property
    def typical(self) -> float:
        """The weight (m/s per s) that stands for all: 2, or the nearest that the policy is played at."""
        return min(self.policy.weights, key=lambda weight: abs(weight - TYPICAL))


def shipped(scenarios: Mapping[str, Any], folder: Path = SHIPPED) -> list[Arena]:
    """Return an arena for each preset whose policies are there."""
    found = []
    for preset in PRESETS:
        paths = sorted((folder / preset).glob("seed-*.npz"), key=lambda path: int(path.stem.removeprefix("seed-")))
        if not paths:
            continue
        seeds = tuple(policy(path.stem, path) for path in paths)
        chosen = f"seed-{json.loads((folder / preset / 'seeds.json').read_text())['median']}"
        environment = environment_of(preset)
        about = load_policy(folder / preset / f"{chosen}.npz").provenance
        found.append(Arena(preset, environment, seeds, chosen, baselines(RIVALS[preset]), scenarios, about))
    return found


def own(
    path: str, names: Sequence[str], scenarios: Mapping[str, Any], changes: Mapping[str, Any] | None = None
) -> Arena:
    """Return the arena of one policy, by name or file, against the paper's rule and `names`.

    Without `names` it meets the baselines of the preset that it was trained for, if it was one. `changes` are arguments
    of the environment that differ from the policy's own.

    Raises:
        ValueError: the policy sees other things than this environment shows.
    """
    loaded = load_policy(path)
    environment = {name: value for name, value in loaded.environment.items() if name != "time_weight"}
    preset = preset_of(environment)
    environment |= changes or {}
    Policy(loaded.network, {**environment, "time_weight": 2.0}, {})  # raises where they do not fit
    seed = policy(Path(path).stem, _file(path))
    names = names or (RIVALS[preset] if preset else ())
    return Arena(Path(path).stem, environment, (seed,), seed.name, baselines(names), scenarios, loaded.provenance)


def preset_of(environment: Mapping[str, Any]) -> str | None:
    """Return the preset that has this environment."""
    return next((one for one in PRESETS if environment_of(one) == environment), None)


def policy(name: str, path: Path) -> Contestant:
    """Return the policy in a file; it travels with its jobs, so that another machine needs no file."""
    trained = load_policy(path).environment.get("time_weight", TYPICAL)
    low, high = trained if isinstance(trained, (list, tuple)) else (trained, trained)
    weights = tuple(weight for weight in CURVE if low <= weight <= high) or (float(low),)
    return Contestant(name, {"policy": base64.b64encode(path.read_bytes()).decode()}, weights)


def baselines(names: Sequence[str]) -> tuple[Contestant, ...]:
    """Return the paper's rule and the named ones: tuned baselines, or objects with `predict` as module:object."""
    found = [Contestant(PAPER, {"baseline": "paper-trapezoid"}, (TYPICAL,))]
    for name in names:
        spec = {"object": name} if ":" in name else {"baseline": name}
        controller_of(spec, TYPICAL)  # raises now, not in a worker
        found.append(Contestant(name, spec, WEIGHTS if name in TUNABLE else (TYPICAL,)))
    return tuple(found)


def scenarios_from(source: str, count: int | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return scenarios as JSON and changes of the environment: from a frozen set's name or file, or from a JSON file.

    The JSON file says `{"ranges": {...}, "seed": s, "count": n, "environment": {...}}`, all but the ranges may be left
    out; the environment holds arguments of `gym.make`, such as `tool_mass` or `coupling`.

    Raises:
        ValueError: no such set or file, or something in it is unknown or out of range; says what.
    """
    path = Path(source)
    if path.suffix == ".json":
        try:
            content = json.loads(path.read_text())
        except (OSError, ValueError) as error:
            raise ValueError(f"{path} is not read as scenarios: {error}") from error
        unknown = set(content) - {"ranges", "seed", "count", "environment"}
        if unknown:
            raise ValueError(f"{path} has {sorted(unknown)}, which scenarios do not; see --help")
        ranges = ScenarioRanges.of(content.get("ranges", "test"))
        table = {name: list(getattr(ranges, name)) for name in FIELDS}
        number_of = whole("count", count or content.get("count", 1000), at_least=2)
        seed = whole("seed", content.get("seed", 2_000_000), at_least=0)
        environment = dict(content.get("environment", {}))
        Task(**environment)  # raises
        return {"ranges": table, "seed": seed, "count": number_of}, environment
    frozen = evaluation_sets.load(source)
    number_of = whole("scenarios", count or frozen.count, at_least=2)
    number("scenarios", number_of, "(no unit)", at_most=frozen.count)
    if (evaluation_sets.SHIPPED / f"{source}.csv").is_file():
        return {"set": source, "count": number_of}, {}
    table = {name: values[:number_of].tolist() for name, values in frozen.scenario.items()}
    return {"table": table, "seed": frozen.seed, "count": number_of}, {}


def _file(path: str) -> Path:
    named = SHIPPED / f"{path}.npz"
    file = named if named.is_file() else Path(path)
    return file / "best.npz" if file.is_dir() else file
