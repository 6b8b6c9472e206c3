"""Matchups: the policies of a set-up, one for each training seed, and the baselines that play the same scenarios."""

import base64
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from agents.baselines import FIXED
from agents.evaluate.play import controller_of, environment_and_scenarios, pairs, try_out
from agents.evaluate.scenario_batch import TEST_SEED
from agents.policies import Policy, load_ensemble, load_policy
from agents.setups import TUNED, Setup, load_setup, shipped, shipped_baselines
from agents.setups.evaluation import Evaluation
from agents.setups.keys import prefixed_errors
from agents.setups.tuned import BOUND_SET, bound_of, read_tuned
from impact_gym.support.provenance import digest_of
from impact_gym.support.validation import identifier, nearest, number
from impact_gym.task import ObservationSpec, Task

PAPER = "paper's rule"
RULE = "paper-trapezoid"  # name of the paper's rule among the baselines
POLICY = "learned policy"
BOUND = "clairvoyant search"
PLAIN = {  # names for readers, by the class of a tuned baseline or the name of a fixed baseline
    "BlindProfile": "tuned profile",
    "ConstantDeceleration": "tuned even braking",
    "ConstantSpeed": "tuned constant speed",
    "DetectorProfile": "tuned profile with a detector",
    "DetectorRanged": "tuned profile over the estimate with a detector",
    "FilteredProfile": "tuned profile over filtered readings",
    "FirstReadingProfile": "tuned profile over the first reading",
    "Ranged": "tuned braking towards the estimate",
    "RangedProfile": "tuned profile over the estimate",
    "SelfCalibratingProfile": "tuned profile over self-calibrated readings",
    "local-brake": "local brake",
    "operator-alone": "operator alone",
}


@dataclass(frozen=True)
class Contestant:
    """A controller, and the time weights (m/s per s) at which it plays."""

    name: str
    controller: Mapping[str, Any]  # JSON, see `agents.evaluate.play`
    weights: tuple[float, ...]
    checksum: str  # SHA-256 of policy, tuned baseline, clairvoyant parameters or the user's module; "": a fixed rule

    @property
    def label(self) -> str:
        """Plain name with `name` in brackets; `name` alone if PLAIN has none."""
        plain = PLAIN.get(self.controller.get("tuned", {}).get("rule", self.name))
        return f"{plain} ({self.name})" if plain else self.name


@dataclass(frozen=True)
class Matchup:
    """Policies and baselines that play the same scenarios in one environment."""

    name: str
    environment: Mapping[str, Any]  # arguments of the environment, JSON, without scenario and time weight
    seeds: tuple[Contestant, ...]  # one for each training seed
    chosen: str  # name of the median seed: its policy has the median validation score
    baselines: tuple[Contestant, ...]  # first the paper's rule, then the main baseline (`rival`) if there is one
    scenarios: Mapping[str, Any]  # JSON, see `agents.evaluate.play`
    provenance: Mapping[str, Any]  # provenance of the median seed's policy
    note: str  # remarks for the reader
    evaluation: Evaluation = field(default_factory=Evaluation)
    bound: Contestant | None = None  # the clairvoyant search: a controller that knows the object
    title: str = ""

    @property
    def operated(self) -> bool:
        """Whether there is an operator. T is then `Episodes.done_time`, not the time until the touch."""
        return Task(**self.environment).operator is not None

    @property
    def labels(self) -> dict[str, str]:
        """Labels of the baselines and of the median seed, by name."""
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
        """The policy's time weight (m/s per s) that is nearest to the typical weight of the set-up."""
        return min(self.policy.weights, key=lambda weight: abs(weight - self.evaluation.typical))

    @property
    def weights(self) -> tuple[float, ...]:
        """Weights (m/s per s) of the evaluation at which the policy plays; if there are none, the policy's weights."""
        weights = tuple(weight for weight in self.evaluation.weights if weight in self.policy.weights)
        return weights or self.policy.weights


def of_setup(
    setup: Setup, scenarios: Mapping[str, Any], folder: Path | None = None, time_weight: float | None = None
) -> Matchup:
    """Return the matchup of a set-up, with policies and tuned baselines from `folder` (None: the set-up's folder).

    `time_weight` (m/s per s) replaces the typical weight. ValueError: a file is missing, or an argument does not fit.
    """
    folder = setup.folder if folder is None else folder
    if time_weight is not None:  # for `baselines`, which reads the typical weight of `setup`
        setup = replace(setup, evaluation=replace(setup.evaluation, typical=time_weight))
    path = folder / "policies" / f"{setup.name}.npz"
    if not path.is_file():
        raise ValueError(f"there are no policies {path}: run impact-gym train {setup.called} --seeds {setup.seeds}")
    ensemble = load_ensemble(path)
    if not setup.describes(ensemble[None].task):
        raise ValueError(f"{path} was trained for another environment than {setup.called} describes: train it again")
    policies = {f"seed-{each.seed}": each for each in sorted(ensemble.policies, key=lambda policy: policy.seed)}
    environment, scenarios = environment_and_scenarios(setup.environment, scenarios)
    rivals = baselines(setup.against, environment, setup, folder / "tuned")
    teacher = setup.training.teacher
    known = ", which it is compared with" if teacher in setup.against else ""
    imitates = f"; its training begins by imitating {teacher}{known}" if teacher else ""
    note = setup.about + imitates + quick_look_note(setup, ensemble[None].provenance, rivals)
    bound = clairvoyant(setup, scenarios, folder / "tuned")
    found = Matchup(setup.name, environment, (), f"seed-{ensemble.chosen}", rivals, scenarios, {}, note,
                    setup.evaluation, bound, setup.title)  # fmt: skip
    return _with_policies(found, policies, time_weight)


def _with_policies(matchup: Matchup, policies: Mapping[str, Policy], time_weight: float | None) -> Matchup:
    """Return the matchup with `policies`, which play at the evaluation's weights within the range of their training.

    If no weight is within this range, they play at the lower end of the range.
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
    """Return the clairvoyant search of a set-up; None: there is no search on these scenarios."""
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
    """Return a note if training or tuning was shorter than the set-up says; else ""."""
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
    """Return a matchup for each policy in `paths` (names or paths), with the paper's rule and the baselines `names`.

    If `names` is empty and a shipped set-up has a policy's environment, the set-up's baselines play. `changes` replace
    arguments of the environment. ValueError: an argument is invalid, or two policies have the same name.
    """
    matchups: dict[str, Matchup] = {}
    for path in map(Path, paths):
        loaded = load_policy(path)
        trained_in = {name: value for name, value in loaded.environment.items() if name != "time_weight"}
        arguments = {**trained_in, **changes}
        environment, of_environment = environment_and_scenarios(arguments, scenarios)
        with prefixed_errors(f"{path} with environment {[*changes]}"):
            Policy(loaded.network, Task(**environment), {})  # raises ValueError if the network does not fit
        setup = next((setup for setup in map(load_setup, shipped()) if setup.describes(loaded.task)), None)
        called = path.parent.name if path.name in ("best.npz", "final.npz") else path.stem
        name = identifier("policy", re.sub(r"[^A-Za-z0-9.-]+", "-", called)[:100].strip("-.") or "policy")
        if name in matchups:
            raise ValueError(f"two policies have the name {name!r}: give them files or folders of different names")
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
    """Return the paper's rule and the baselines `names`: tuned or fixed baselines, or controllers as module:object.

    `folder` has the tuned baselines of `setup`; other tuned baselines are shipped. ValueError: a name is unknown,
    repeated or that of the paper's rule, or a baseline does not fit this environment.
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
            raise ValueError(f"{known} (give a baseline of your own as module:object)")
        else:
            controller = controller_of({"object": name}, typical)
            try_out(name, controller, observations, len(task.action))  # an error is raised here, not in a worker
            contestants.append(Contestant(name, {"object": name}, (typical,), digest_of(name.partition(":")[0])))
    return tuple(contestants)
