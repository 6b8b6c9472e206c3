"""Matchups: comparisons of a set-up's policies, one for each training seed, with baselines in the same scenarios."""

import base64
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from agents.baselines.tuned import BOUND_SET, FIXED, bound_of, read_tuned
from agents.evaluate.play import controller_of, environment_and_scenarios, pairs, try_out
from agents.evaluate.scenario_batch import TEST_SEED
from agents.policies import Policy, load_ensemble, load_policy
from agents.provenance import digest_of
from agents.setups import TUNED, Setup, load_setup, shipped, shipped_baselines
from agents.setups.evaluation import Evaluation
from impact_gym.task import ActionSpec, ObservationSpec, Task
from impact_gym.validation import identifier, nearest, number

PAPER = "paper's rule"
RULE = "paper-trapezoid"  # name of the paper's rule among the baselines
POLICY = "learned policy"
IMITATES = "its training begins by imitating"
BOUND = "clairvoyant search"
PLAIN = {
    "BlindProfile": "tuned profile",
    "ConstantDeceleration": "tuned even braking",
    "ConstantSpeed": "tuned constant speed",
    "DetectorProfile": "tuned profile with a detector",
    "DetectorRanged": "tuned profile over the estimate with a detector",
    "FilteredProfile": "tuned profile over filtered readings",
    "FirstReadingProfile": "tuned profile over the first reading",
    "Ranged": "tuned braking towards the estimate",
    "RangedProfile": "tuned profile over the estimate",
    "local-brake": "the local brake",
    "operator-alone": "the operator alone",
}
"""Plain names of baselines, by the class of a tuned baseline or the name of another baseline."""


@dataclass(frozen=True)
class Contestant:
    """A controller, and the time weights (m/s per s) at which it plays."""

    name: str
    controller: Mapping[str, Any]  # JSON, see `agents.evaluate.play`
    weights: tuple[float, ...]
    checksum: str  # of the policy's file, the tuned parameters or the module

    @property
    def plain(self) -> str:
        """Plain name; `name` if PLAIN has none."""
        return PLAIN.get(self.controller.get("tuned", {}).get("rule", self.name), self.name)

    @property
    def label(self) -> str:
        """Plain name with the name in brackets."""
        return self.name if self.plain == self.name else f"{self.plain} ({self.name})"


@dataclass(frozen=True)
class Matchup:
    """Policies and baselines that play the same scenarios in one environment."""

    name: str
    environment: Mapping[str, Any]  # arguments, JSON, without scenario and time weight
    seeds: tuple[Contestant, ...]  # one for each training seed
    chosen: str  # name of the median seed
    baselines: tuple[Contestant, ...]  # first the paper's rule, then the rival if there is one
    scenarios: Mapping[str, Any]  # JSON, see `agents.evaluate.play`
    provenance: Mapping[str, Any]  # of the median seed
    note: str  # remarks for the reader
    evaluation: Evaluation = field(default_factory=Evaluation)
    bound: Contestant | None = None  # the best approaches that a search found, for a controller that knows the object
    title: str = ""

    @property
    def operated(self) -> bool:
        """Whether an operator commands; T is then the time until all is done."""
        return Task(**self.environment).operator is not None

    @property
    def until(self) -> str:
        """Plain name of the event that ends T."""
        return "all is done" if self.operated else "the touch"

    @property
    def labels(self) -> dict[str, str]:
        """Labels of the contestants, by name: the median seed is the policy."""
        return {baseline.name: baseline.label for baseline in self.baselines} | {self.chosen: POLICY}

    @property
    def policy(self) -> Contestant:
        """The median seed."""
        return next(seed for seed in self.seeds if seed.name == self.chosen)

    @property
    def rival(self) -> Contestant:
        """The main baseline for comparison; the paper's rule if there is no other baseline."""
        return self.baselines[1] if len(self.baselines) > 1 else self.baselines[0]

    @property
    def rivals(self) -> list[Contestant]:
        """The contestants shown in detail: the paper's rule, the rival if there is one, and the median seed."""
        return list({each.name: each for each in (self.baselines[0], self.rival, self.policy)}.values())

    @property
    def typical(self) -> float:
        """The typical time weight of the set-up (m/s per s), or the nearest weight at which the policy plays."""
        return min(self.policy.weights, key=lambda weight: abs(weight - self.evaluation.typical))

    @property
    def weights(self) -> tuple[float, ...]:
        """Weights of the evaluation at which the policy is played (m/s per s), or all its weights if there is none."""
        weights = tuple(weight for weight in self.evaluation.weights if weight in self.policy.weights)
        return weights or self.policy.weights


def of_setup(
    setup: Setup, scenarios: Mapping[str, Any], folder: Path | None = None, time_weight: float | None = None
) -> Matchup:
    """Return the matchup of a set-up, with policies and tuned baselines from `folder`, by default the set-up's own.

    `time_weight` (m/s per s) replaces the set-up's typical weight.

    Raises:
        ValueError: there are no policies yet, a baseline was not tuned, or no policy was trained for the time weight.
    """
    folder = setup.folder if folder is None else folder
    if time_weight is not None:  # also the weight at which the paper's rule plays
        setup = replace(setup, evaluation=replace(setup.evaluation, typical=time_weight))
    path = folder / "policies" / f"{setup.name}.npz"
    if not path.is_file():
        raise ValueError(f"there are no policies {path}: impact-gym train {setup.called} --seeds {setup.seeds}")
    ensemble = load_ensemble(path)
    if not setup.describes(ensemble[None].task):
        raise ValueError(f"{path} was trained for another environment than {setup.called} describes: train it again")
    policies = {f"seed-{each.seed}": each for each in sorted(ensemble.policies, key=lambda policy: policy.seed)}
    environment, scenarios = environment_and_scenarios(setup.environment, scenarios)
    rivals = baselines(setup.against, environment, setup, folder / "tuned")
    teacher = setup.training.teacher
    known = ", which it is compared with" if teacher in setup.against else ""
    imitates = f"; {IMITATES} {teacher}{known}" if teacher else ""
    note = setup.about + imitates + quick_look_note(setup, ensemble[None].provenance, rivals)
    bound = clairvoyant(setup, scenarios, folder / "tuned")
    found = Matchup(setup.name, environment, (), f"seed-{ensemble.chosen}", rivals, scenarios, {}, note,
                    setup.evaluation, bound, setup.title)  # fmt: skip
    return _with_policies(found, policies, time_weight)


def _with_policies(matchup: Matchup, policies: Mapping[str, Policy], time_weight: float | None) -> Matchup:
    """Return a matchup with its policies, each at the weights of the evaluation for which it was trained.

    `time_weight` (m/s per s) replaces the typical weight of the evaluation, unless it is None; ValueError: the policies
    were not trained for this weight.
    """
    policy, evaluation = policies[matchup.chosen], matchup.evaluation
    trained = policy.environment.get("time_weight", evaluation.typical)
    low, high = trained if isinstance(trained, (list, tuple)) else (trained, trained)
    if time_weight is not None:
        number("time_weight", time_weight, "m/s per s", at_least=low, at_most=high)
        evaluation = replace(evaluation, typical=time_weight)
    compared = sorted({*evaluation.curve, *evaluation.weights, evaluation.typical})
    weights = tuple(weight for weight in compared if low <= weight <= high) or (float(low),)
    seeds = []
    for name, each in policies.items():
        content = each.to_bytes()
        spec = {"policy": base64.b64encode(content).decode()}
        seeds.append(Contestant(name, spec, weights, hashlib.sha256(content).hexdigest()))
    return replace(matchup, seeds=tuple(seeds), evaluation=evaluation, provenance=policy.provenance)


def clairvoyant(setup: Setup, scenarios: Mapping[str, Any], folder: Path = TUNED) -> Contestant | None:
    """Return the clairvoyant bound of a set-up; None: there is none for the first of these scenarios."""
    its_own = setup.bound == setup.name
    parameters_at = bound_of(setup, folder) if its_own else bound_of(load_setup(setup.bound))
    searched = min(map(len, parameters_at.values()), default=0)
    own = pairs(setup.environment.get("scenario", "test"))
    same = its_own and scenarios.get("seed") == TEST_SEED and scenarios.get("ranges") == own
    if not (same or scenarios.get("set") == BOUND_SET) or not 0 < searched <= scenarios["count"]:
        return None
    spec = {f"{weight:g}": parameters[:searched].tolist() for weight, parameters in parameters_at.items()}
    checksum = hashlib.sha256(json.dumps(spec).encode()).hexdigest()
    return Contestant(BOUND, {"clairvoyant": spec}, tuple(parameters_at), checksum)


def quick_look_note(setup: Setup, about: Mapping[str, Any], rivals: Sequence[Contestant]) -> str:
    """Return a note if training or tuning was shorter than in the set-up, else an empty text."""
    shortfalls = []
    steps, wanted = about["settings"]["steps"], setup.training.steps
    if steps < wanted:
        shortfalls.append(f"trained for {steps:,} steps of {wanted:,}")
    tuned = [rival.controller["tuned"]["weights"].values() for rival in rivals if rival.name in setup.tuned]
    budget = min((at["search"]["budget"] for weights in tuned for at in weights), default=setup.budget)
    if budget < setup.budget:
        shortfalls.append(f"baselines tuned with {budget:,} candidates of {setup.budget:,}")
    return f"; A QUICK LOOK, {', '.join(shortfalls)}" if shortfalls else ""


def of_policies(
    paths: Sequence[str], names: Sequence[str], scenarios: Mapping[str, Any], changes: Mapping[str, Any],
    time_weight: float | None = None,
) -> list[Matchup]:  # fmt: skip
    """Return a matchup for each policy, a name or a file, against the paper's rule and the baselines `names`.

    Without `names`, the baselines are those of the shipped set-up for which the policy was trained, if any. `changes`
    replace arguments of the environment in which the policy was trained.

    Raises:
        ValueError: a policy takes other observations than this environment has, or two policies have the same name.
    """
    matchups: dict[str, Matchup] = {}
    for path in map(Path, paths):
        loaded = load_policy(path)
        trained_in = {name: value for name, value in loaded.environment.items() if name != "time_weight"}
        arguments = {**trained_in, **changes}
        environment, of_environment = environment_and_scenarios(arguments, scenarios)
        Policy(loaded.network, Task(**environment), {})  # raises if network and environment do not fit
        setup = next((setup for setup in map(load_setup, shipped()) if setup.describes(loaded.task)), None)
        called = path.parent.name if path.name in ("best.npz", "final.npz") else path.stem
        name = identifier("policy", re.sub(r"[^A-Za-z0-9.-]+", "-", called)[:100].strip("-.") or "policy")
        if name in matchups:
            raise ValueError(f"two policies would be called {name!r}: give them files or folders of different names")
        note = f"your policy {name}"
        if setup and not setup.describes(Task(**arguments)):
            note += f"; its baselines were tuned for {setup.name}, not for this environment"
        rivals = baselines(names or (setup.against if setup else ()), environment)
        bound = clairvoyant(setup, of_environment) if setup and not changes else None
        evaluation = setup.evaluation if setup else Evaluation.of_table({}, trained_in)
        found = Matchup(name, environment, (), name, rivals, of_environment, {}, note, evaluation, bound)
        matchups[name] = _with_policies(found, {name: loaded}, time_weight)
    return list(matchups.values())


def baselines(
    names: Sequence[str], environment: Mapping[str, Any], setup: Setup | None = None, folder: Path = TUNED
) -> tuple[Contestant, ...]:
    """Return the paper's rule and the baselines `names`: tuned baselines, or objects with `predict` as module:object.

    Tuned baselines of a `setup` are read from `folder`, others are shipped.

    Raises:
        ValueError: there is no such baseline, it is named twice, it is the paper's rule, or it does not fit this
        environment.
    """
    typical = (setup.evaluation if setup else Evaluation()).typical
    contestants = [Contestant(PAPER, {"baseline": RULE}, (typical,), "")]
    if len({*names, RULE}) <= len(names):
        raise ValueError(f"name each baseline once, and not {RULE!r}, which is always included; got {list(names)}")
    task = Task(**environment)
    observations = np.zeros((2, len(ObservationSpec(task))), np.float32)
    for name in names:
        its_own = setup is not None and name in setup.tuned
        if its_own or name in shipped_baselines():
            content = read_tuned(name, folder, setup) if its_own else read_tuned(name)
            weights = tuple(map(float, content["weights"]))
            contestants.append(Contestant(name, {"tuned": content}, weights, content["sha256"]))
        elif name in FIXED:
            contestants.append(Contestant(name, {"baseline": name}, (typical,), ""))
        elif ":" not in name:
            known = nearest("baseline", name, [*FIXED, *shipped_baselines()])
            raise ValueError(f"{known} (your own baseline is named module:object)")
        else:
            controller = controller_of({"object": name}, typical)
            try_out(name, controller, observations, len(ActionSpec(task)))  # raises now, not in a worker
            contestants.append(Contestant(name, {"object": name}, (typical,), digest_of(name.partition(":")[0])))
    return tuple(contestants)
