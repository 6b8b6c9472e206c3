"""Who meets whom, where: a recipe of training, each seed of it a policy, against baselines on the same scenarios."""

import base64
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from agents.baselines.tuned import FIXED, TUNED, read_tuned
from agents.baselines.tuned import names as tuned_names
from agents.evaluate.controllers import baseline_checksum, controller_of, try_out
from agents.evaluate.stage import TEST_SEED
from agents.jobs import digest_of
from agents.policies.policy import SHIPPED, Policy, load_policy
from agents.setups import README, Setup, load_setup, same_environment
from agents.setups import shipped as shipped_setups
from agents.setups.evaluation import WEIGHTS
from agents.train.settings import default_settings
from impact_gym.envs import evaluation_sets, observation
from impact_gym.envs.scenario import FIELDS, ScenarioRanges
from impact_gym.envs.task import Task
from impact_gym.validation import number, whole

PAPER = "paper's rule"
POLICY = "learned policy"
CURVE = (0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)
"""Time weights (m/s per s) at which a policy is played, as far as it was trained for them."""
TYPICAL = 2.0  # m/s per s, where one weight must do
Environment = Mapping[str, Any]


@dataclass(frozen=True)
class Contestant:
    """One that plays, and at which time weights (m/s per s)."""

    name: str
    controller: Mapping[str, Any]  # JSON, see `agents.evaluate.controllers`
    weights: tuple[float, ...]
    checksum: str  # of the policy's file, of the tuned parameters, of the module


@dataclass(frozen=True)
class Matchup:
    """An environment, a recipe of training and the baselines beside it."""

    name: str
    environment: Mapping[str, Any]  # arguments, JSON, but for scenario and time weight
    seeds: tuple[Contestant, ...]  # one for each training seed
    chosen: str  # name of the median seed
    baselines: tuple[Contestant, ...]  # the paper's rule is the first, the rival the second if there is one
    scenarios: Mapping[str, Any]  # JSON, see `play.stage`
    provenance: Mapping[str, Any]  # of the median seed
    note: str  # what a reader has to know of it

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


def shipped(scenarios: Mapping[str, Any]) -> list[Matchup]:
    """Return a matchup for each set-up of the README; the others that are shipped have to be named."""
    return [of_setup(load_setup(name), scenarios) for name in README]


def of_setup(setup: Setup, scenarios: Mapping[str, Any], folder: Path | None = None) -> Matchup:
    """Return the matchup of a set-up, whose policies and tuned baselines are below `folder`, or where they are made.

    Raises:
        ValueError: there are no policies yet, or a baseline was not tuned.
    """
    folder = setup.folder if folder is None else folder
    there = folder / "policies" / setup.name
    paths = sorted(there.glob("seed-*.npz"), key=lambda path: int(path.stem.removeprefix("seed-")))
    if not paths or not (there / "seeds.json").is_file():
        raise ValueError(f"{there} holds no policies: python -m agents.train_seeds {setup.called}")
    for path in paths:
        if not setup.is_of(load_policy(path).environment):
            raise ValueError(f"{path} was trained for another environment than {setup.called} says: train it anew")
    seeds = tuple(policy(path.stem, path) for path in paths)
    chosen = f"seed-{json.loads((there / 'seeds.json').read_text())['median']}"
    about = load_policy(there / f"{chosen}.npz").provenance
    environment, met = met_in(setup.environment, scenarios)
    rivals = baselines(setup.against, environment, setup, folder / "tuned")
    note = setup.about + with_less(setup, about, rivals)
    return Matchup(setup.name, environment, seeds, chosen, rivals, met, about, note)


def with_less(setup: Setup, about: Mapping[str, Any], rivals: Sequence[Contestant]) -> str:
    """Say what was trained or tuned with less than the set-up wants; nothing if nothing was."""
    told = []
    steps, wanted = about["settings"]["steps"], default_settings(str(setup.path)).steps
    if steps < wanted:
        told.append(f"trained for {steps:,} steps of {wanted:,}")
    budgets = [
        at["search"]["budget"]
        for one in rivals
        for at in one.controller.get("tuned", {"weights": {}})["weights"].values()
    ]
    if budgets and min(budgets) < setup.budget:
        told.append(f"baselines tuned with {min(budgets):,} candidates of {setup.budget:,}")
    return f"; A QUICK LOOK, {', '.join(told)}" if told else ""


def met_in(environment: Environment, scenarios: Mapping[str, Any]) -> tuple[dict[str, Any], Mapping[str, Any]]:
    """Return an environment's arguments but for its scenario, and the scenarios that it meets.

    One with ranges of its own meets as many from these, where it is only asked for scenarios of the frozen set test.
    """
    rest = {name: value for name, value in environment.items() if name != "scenario"}
    if "scenario" in environment and scenarios.get("set") == "test":
        ranges = ScenarioRanges.of(environment["scenario"])
        table = {name: list(getattr(ranges, name)) for name in FIELDS}
        return rest, {"ranges": table, "seed": TEST_SEED, "count": scenarios["count"]}
    return rest, scenarios


def own(
    paths: Sequence[str], names: Sequence[str], scenarios: Mapping[str, Any], changes: Environment
) -> list[Matchup]:
    """Return a matchup for each policy, by name or file, against the paper's rule and `names`.

    Without `names` it meets the baselines of the set-up that it was trained for, if that is shipped. `changes` are
    arguments of the environment that differ from the policy's own.

    Raises:
        ValueError: a policy sees other things than this environment shows, or is asked for twice.
    """
    found: list[Matchup] = []
    for path in paths:
        file = _file(path)
        loaded = load_policy(file)
        trained_in = {name: value for name, value in loaded.environment.items() if name != "time_weight"}
        environment, met = met_in({**trained_in, **changes}, scenarios)
        Policy(loaded.network, {**environment, "time_weight": TYPICAL}, {})  # raises where they do not fit
        setup = setup_of(trained_in)
        name = slug(Path(path).parent.name if Path(path).name in ("best.npz", "final.npz") else Path(path).stem)
        if any(one.name == name for one in found):
            raise ValueError(f"two policies would be called {name!r}: give them files or folders of different names")
        note = f"your policy {name}"
        if setup and not same_environment({**trained_in, **changes}, trained_in):
            note += f"; its baselines were tuned for {setup.name}, not for this environment"
        rivals = baselines(names or (setup.against if setup else ()), environment)
        seed = policy(name, file)
        found.append(Matchup(name, environment, (seed,), seed.name, rivals, met, loaded.provenance, note))
    return found


def setup_of(environment: Environment) -> Setup | None:
    """Return the shipped set-up that has this environment."""
    return next((one for one in map(load_setup, shipped_setups()) if one.is_of(environment)), None)


def policy(name: str, path: Path) -> Contestant:
    """Return the policy in a file; it travels with its jobs, so that another machine needs no file."""
    trained = load_policy(path).environment.get("time_weight", TYPICAL)
    low, high = trained if isinstance(trained, (list, tuple)) else (trained, trained)
    weights = tuple(weight for weight in CURVE if low <= weight <= high) or (float(low),)
    content = path.read_bytes()
    return Contestant(
        name, {"policy": base64.b64encode(content).decode()}, weights, hashlib.sha256(content).hexdigest()
    )


def baselines(
    names: Sequence[str], environment: Environment, setup: Setup | None = None, folder: Path = TUNED
) -> tuple[Contestant, ...]:
    """Return the paper's rule and the named ones: tuned baselines, or objects with `predict` as module:object.

    Tuned ones are those that are shipped, or, of a `setup`, those in `folder`.

    Raises:
        ValueError: there is no such baseline, it is named twice, or it cannot be asked in this environment.
    """
    spec: dict[str, Any]
    weights: tuple[float, ...]
    found = [Contestant(PAPER, {"baseline": "paper-trapezoid"}, (TYPICAL,), "")]
    if len(set(names)) < len(names) or "paper-trapezoid" in names:
        raise ValueError(f"baselines must differ, and the paper's rule is there anyway; got {list(names)}")
    shown = np.zeros((2, len(observation.entries(Task(**environment)))), np.float32)
    for name in names:
        weights, spec = (TYPICAL,), {}
        if setup and not setup.shipped and name in setup.tuned:
            content = read_tuned(name, folder, setup)
            weights, spec, checksum = tuple(map(float, content["weights"])), {"tuned": content}, content["sha256"]
        elif ":" in name or name not in {*tuned_names(), *FIXED}:
            spec = {"object": name}
            try_out(name, controller_of(spec, TYPICAL), shown)  # raises now, not in a worker
            checksum = digest_of(name.partition(":")[0])
        else:
            checksum = baseline_checksum(name)
            spec = {"baseline": name, "sha256": checksum}
            weights = WEIGHTS if name in tuned_names() else weights
        found.append(Contestant(name, spec, weights, checksum))
    return tuple(found)


def scenarios_from(source: str, count: int | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return scenarios as JSON and changes of the environment: from a frozen set's name or file, or from a JSON file.

    The JSON file says `{"ranges": {...}, "seed": s, "count": n, "environment": {...}}`, all of which may be left out;
    the environment holds arguments of `gym.make`, such as `tool_mass` or `coupling`.

    Raises:
        ValueError: no such set or file, or something in it is unknown or out of range; says what.
    """
    path = Path(source)
    if path.suffix == ".json":
        content = _content(path)
        ranges = ScenarioRanges.of(content.get("ranges", "test"))
        table = {name: list(getattr(ranges, name)) for name in FIELDS}
        number_of = whole("count", count or content.get("count", 1000), at_least=2)
        seed = whole("seed", content.get("seed", 2_000_000), at_least=0)
        environment = content.get("environment", {})
        if not isinstance(environment, dict):
            raise ValueError(f"{path}: environment must hold arguments of gym.make by name, got {environment!r}")
        taken = sorted(set(environment) & {"scenario", "time_weight", "max_episode_steps", "privileged"})
        if taken:
            raise ValueError(f"{path}: environment must leave out {taken}: ranges and the report see to that")
        Task(**environment)  # raises
        return {"ranges": table, "seed": seed, "count": number_of}, environment
    frozen = evaluation_sets.load(source)
    number_of = whole("scenarios", count or frozen.count, at_least=2)
    number("scenarios", number_of, "(no unit)", at_most=frozen.count)
    if (evaluation_sets.SHIPPED / f"{source}.csv").is_file():
        return {"set": source, "count": number_of}, {}
    table = {name: values[:number_of].tolist() for name, values in frozen.scenario.items()}
    return {"table": table, "seed": frozen.seed, "count": number_of}, {}


def _content(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise ValueError(f"{path} is not read as scenarios: {error}") from error
    known = {"ranges", "seed", "count", "environment"}
    if not isinstance(content, dict) or set(content) - known:
        raise ValueError(f"{path} must be a JSON object with some of {sorted(known)}, got {str(content)[:200]}")
    return content


def slug(name: str) -> str:
    """Return a name that files and links can have."""
    return re.sub(r"[^A-Za-z0-9.-]+", "-", name).strip("-") or "policy"


def _file(path: str) -> Path:
    named = SHIPPED / f"{path}.npz"
    file = named if named.is_file() else Path(path)
    return file / "best.npz" if file.is_dir() else file
