"""Comparisons: the policies of a set-up, one for each training seed, and the baselines that play the same scenarios."""

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
from agents.baselines import RULES as TUNABLE
from agents.evaluate.scenario_batch import TEST_SEED
from agents.evaluate.specs import controller_of, environment_and_scenarios, pairs, try_out
from agents.policies import Policy, load_ensemble, load_policy
from agents.setups import TUNED, Setup, load_setup, shipped, shipped_baselines
from agents.setups.evaluation import Evaluation, surroundings
from agents.setups.keys import prefixed_errors
from agents.setups.tuned import BOUND_SET, bound_of, read_tuned
from impact_gym.support.provenance import digest_of
from impact_gym.support.validation import identifier, nearest, number
from impact_gym.task import ObservationSpec, Task

PAPER = "paper's rule"
RULE = "paper-trapezoid"  # name of the paper's rule among the baselines
POLICY = "learned policy"
BOUND = "clairvoyant search"
RULES = {  # for the class of a tuned baseline its name for readers, and what it adds to the rules above it
    "ConstantSpeed": ("tuned constant speed", "the arm's limits"),
    "ThresholdBrake": ("rule with tuned speed and threshold", "the choice of a threshold"),
    "ConstantDeceleration": ("tuned even braking", "knowing where objects can stand"),
    "BlindProfile": ("tuned profile", "the profile's shape"),
    "DetectorProfile": ("tuned profile with a detector", "a contact detector"),
    "Ranged": ("tuned braking towards the estimate", "the estimate"),
    "RangedProfile": ("tuned profile over the estimate", "a profile over the estimate"),
    "DetectorRanged": ("tuned profile over the estimate with a detector",
                       "a contact detector and a profile over the estimate"),
    "FirstReadingProfile": ("tuned profile over the first reading", "the first reading of the range sensor"),
    "FilteredProfile": ("tuned profile over filtered readings", "a filter over all readings"),
    "SelfCalibratingProfile": ("tuned profile over self-calibrated readings",
                               "a filter that also estimates the sensor's bias and scale"),
}  # fmt: skip


@dataclass(frozen=True)
class Contestant:
    """A controller, and the time weights (m/s per s) at which it plays."""

    name: str
    controller: Mapping[str, Any]  # JSON, see `agents.evaluate.specs`
    weights: tuple[float, ...]
    checksum: str  # SHA-256 of policy, tuned baseline, clairvoyant parameters or the user's module; "": a fixed rule

    @property
    def label(self) -> str:
        """POLICY, or the plain name of a shipped baseline with `name` in brackets, or `name`."""
        ((kind, content),) = self.controller.items()
        plain = {"policy": POLICY, "baseline": self.name.replace("-", " ")}.get(kind, self.name)
        if kind == "tuned":
            plain, _ = RULES.get(content["rule"], (self.name, ""))
        return plain if plain in (POLICY, self.name) else f"{plain} ({self.name})"

    @property
    def about(self) -> str:
        """What it does, in words: for most, the first line of the docstring of its class."""
        ((kind, content),) = self.controller.items()
        if kind == "policy" or self.name == PAPER:
            return "Neural network." if kind == "policy" else "Constant speed; brakes at the alarm."
        rule = TUNABLE[content["rule"]] if kind == "tuned" else FIXED.get(content)
        return (rule.__doc__ or "").partition("\n")[0].replace("`", "") if rule else "A controller of your own."


@dataclass(frozen=True)
class Comparison:
    """Policies and baselines that play the same scenarios in one environment."""

    name: str
    environment: Mapping[str, Any]  # arguments of the environment, JSON, without scenario and time weight
    seeds: tuple[Contestant, ...]  # one for each training seed
    chosen: str  # name of the median seed: its policy has the median validation score
    baselines: tuple[Contestant, ...]  # first the paper's rule, then the main baseline (`rival`) if there is one
    scenarios: Mapping[str, Any]  # JSON, see `agents.evaluate.specs`
    note: str  # remarks for the reader
    evaluation: Evaluation = field(default_factory=Evaluation)
    bound: Contestant | None = None  # the clairvoyant search: a controller that knows the object
    title: str = ""
    own: bool = False  # whether set-up or policy are the user's; all contestants then play under all changes
    limited: Mapping[str, Any] = field(default_factory=dict)  # see `limits.read_limited`; {}: there are no limits

    @property
    def operated(self) -> bool:
        """Whether there is an operator. T is then `Episodes.done_time`, not the time until the touch."""
        return Task(**self.environment).operator is not None

    @property
    def labels(self) -> dict[str, str]:
        """Labels of the baselines and of the median seed, by name."""
        return {each.name: each.label for each in (*self.baselines, self.policy)}

    @property
    def words(self) -> dict[str, str]:
        """The labels for sentences: without the name in brackets, if no other contestant has the same words."""
        short = {name: label.partition(" (")[0] for name, label in self.labels.items()}
        twice = {words for words in short.values() if [*short.values()].count(words) > 1}
        return {name: self.labels[name] if words in twice else words for name, words in short.items()}

    @property
    def policy(self) -> Contestant:
        """The median seed."""
        return next(seed for seed in self.seeds if seed.name == self.chosen)

    @property
    def rival(self) -> Contestant:
        """The main baseline for comparison; the paper's rule if there is no other baseline."""
        return self.baselines[:2][-1]

    @property
    def rivals(self) -> list[Contestant]:
        """The contestants under changes: the paper's rule, the rival if there is one (`own`: all), the median seed."""
        return [*self.baselines[: None if self.own else 2], self.policy]

    @property
    def typical(self) -> float:
        """The policy's time weight (m/s per s) that is nearest to the typical weight of the set-up."""
        return min(self.policy.weights, key=lambda weight: abs(weight - self.evaluation.typical))


def of_setup(
    setup: Setup, scenarios: Mapping[str, Any], folder: Path | None = None, time_weight: float | None = None,
    limited: Mapping[str, Any] | None = None,
) -> Comparison:  # fmt: skip
    """Return the comparison of a set-up, with policies and tuned baselines from `folder` (None: the set-up's folder).

    `time_weight` (m/s per s), or that of `limited`, replaces the typical weight; with `limited`, the policy also plays
    at a weight outside the range of its training. ValueError: a file is missing, or an argument does not fit.
    """
    folder = setup.folder if folder is None else folder
    path = folder / "policies" / f"{setup.name}.npz"
    if not path.is_file():
        raise ValueError(f"there are no policies {path}: run impact-gym train {setup.cli_name} --seeds {setup.seeds}")
    ensemble = load_ensemble(path)
    if not setup.describes(ensemble[None].task):
        raise ValueError(f"{path} was trained for another environment than {setup.cli_name} describes: train it again")
    policies = {f"seed-{each.seed}": each for each in sorted(ensemble.policies, key=lambda policy: policy.seed)}
    environment, scenarios = environment_and_scenarios(setup.environment, scenarios)
    needed = limited["time_weight"] if limited else None
    evaluation = replace(setup.evaluation, typical=needed or time_weight or setup.evaluation.typical)
    rivals = baselines(setup.against, environment, evaluation.typical, setup, folder / "tuned")
    teacher = setup.training.teacher
    known = ", which it is compared with" if teacher in setup.against else ""
    imitates = f"; its training begins by imitating {teacher}{known}" if teacher else ""
    note = setup.about + imitates + quick_look_note(setup, ensemble[None].provenance, rivals)
    bound, chosen = clairvoyant(setup, scenarios, folder / "tuned"), f"seed-{ensemble.chosen}"
    low, *_, high = np.repeat(ensemble[None].task.time_weight, 2).tolist()
    if needed and not low <= needed <= high:
        note += f"; the policy is trained for time weights of {low:g} to {high:g}, and plays here at {needed:.3g}"
    seeds = _seeds(policies, chosen, evaluation, time_weight, needed)
    of_setup = seeds, chosen, rivals, scenarios, note, evaluation, bound, setup.title, setup.own, limited or {}
    comparison = Comparison(setup.name, environment, *of_setup)
    if limited and (unknown := limited["attempts"].keys() - comparison.labels.keys()):
        raise ValueError(
            f"limited is of another set-up than {setup.cli_name}, which has no controller {min(unknown)!r}"
        )
    return comparison


def _seeds(
    policies: Mapping[str, Policy], chosen: str, evaluation: Evaluation, time_weight: float | None,
    needed: float | None = None,
) -> tuple[Contestant, ...]:  # fmt: skip
    """Return the policies as contestants, which play at the evaluation's weights within the range of their training.

    If no weight is within this range, they play at the lower end of the range. They also play at `needed` (m/s per s).
    """
    low, *_, high = np.repeat(policies[chosen].task.time_weight, 2).tolist()  # one weight or a pair
    if time_weight is not None:
        number("time_weight", time_weight, "m/s per s", at_least=low, at_most=high)
    compared = sorted({*evaluation.curve, *evaluation.weights, evaluation.typical})
    weights = tuple(weight for weight in compared if low <= weight <= high or weight == needed) or (low,)
    contents = {name: policy.to_bytes() for name, policy in policies.items()}
    return tuple(
        Contestant(name, {"policy": base64.b64encode(each).decode()}, weights, hashlib.sha256(each).hexdigest())
        for name, each in contents.items()
    )


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
    tuned = {rival.name: rival.controller["tuned"]["weights"].values() for rival in rivals if rival.name in setup.tuned}
    budgets = [round(at["search"]["budget"] / setup.tuned[name].effort) for name, each in tuned.items() for at in each]
    budget = min(budgets, default=setup.budget)
    if budget < setup.budget:
        shortfalls.append(f"baselines tuned with {budget:,} candidates of {setup.budget:,}")
    return f"; A QUICK LOOK, {', '.join(shortfalls)}" if shortfalls else ""


def of_policies(
    paths: Sequence[str], names: Sequence[str], scenarios: Mapping[str, Any], changes: Mapping[str, Any],
    time_weight: float | None = None,
) -> list[Comparison]:  # fmt: skip
    """Return a comparison for each policy in `paths` (names or paths), with the paper's rule and the baselines `names`.

    If `names` is empty and a shipped set-up has a policy's environment, the set-up's baselines play. `changes` replace
    arguments of the environment. ValueError: an argument is invalid, or two policies have the same name.
    """
    comparisons: dict[str, Comparison] = {}
    for path in map(Path, paths):
        policy = load_policy(path)
        trained_in = {name: value for name, value in policy.environment.items() if name != "time_weight"}
        arguments = {**trained_in, **({"horizon": policy.task.horizon} if changes else {}), **changes}
        environment, of_environment = environment_and_scenarios(arguments, scenarios)
        with prefixed_errors(f"{path} with environment {[*changes]}"):
            Policy(policy.network, Task(**environment), {})  # raises ValueError if the network does not fit
        setup = next((setup for setup in map(load_setup, shipped()) if setup.describes(policy.task)), None)
        called = path.parent.name if path.name in ("best.npz", "final.npz") else path.stem
        name = identifier("policy", re.sub(r"[^A-Za-z0-9.-]+", "-", called)[:100].strip("-.") or "policy")
        if name in comparisons:
            raise ValueError(f"two policies have the name {name!r}: give them files or folders of different names")
        note = f"your policy {name}"
        if setup and not setup.describes(Task(**arguments)):
            note += f"; its baselines were tuned for {setup.name}, not for this environment"
        bound = clairvoyant(setup, of_environment) if setup and not changes else None
        evaluation = setup.evaluation if setup else Evaluation.of_table({}, trained_in)
        varied = {**surroundings(policy.task), **evaluation.varied}
        evaluation = replace(evaluation, typical=time_weight or evaluation.typical, varied=varied)
        rivals = baselines(names or (setup.against if setup else ()), environment, evaluation.typical)
        seeds = _seeds({name: policy}, name, evaluation, time_weight)
        about = seeds, name, rivals, of_environment, note, evaluation, bound
        comparisons[name] = Comparison(name, environment, *about, own=True)
    return list(comparisons.values())


def baselines(
    names: Sequence[str], environment: Mapping[str, Any], typical: float, setup: Setup | None = None,
    folder: Path = TUNED,
) -> tuple[Contestant, ...]:  # fmt: skip
    """Return the paper's rule and the baselines `names`: tuned or fixed baselines, or controllers as module:object.

    Baselines that are not tuned play at the weight `typical` (m/s per s). `folder` has the tuned baselines of `setup`;
    other tuned baselines are shipped. ValueError: a name is unknown, repeated or that of the paper's rule, or a
    baseline does not fit this environment.
    """
    contestants = [Contestant(PAPER, {"baseline": RULE}, (typical,), "")]
    if len({*names, RULE}) <= len(names):
        raise ValueError(f"name each baseline once, and not {RULE!r}, which is always included; got {list(names)}")
    task = Task(**environment)
    observations = np.zeros((2, len(ObservationSpec(task))), np.float32)
    for name in names:
        spec: dict[str, Any] = {"baseline": name}
        weights: tuple[float, ...] = (typical,)
        checksum, its_own = "", setup is not None and name in setup.tuned
        if its_own or name in shipped_baselines():
            content = read_tuned(name, folder, setup) if its_own else read_tuned(name)
            spec, weights, checksum = {"tuned": content}, tuple(map(float, content["weights"])), content["sha256"]
        elif ":" in name:
            spec = {"object": name}
            try_out(name, controller_of(spec, typical), observations, len(task.action))  # here, not in a worker
            checksum = digest_of(name.partition(":")[0])
        elif name not in FIXED:
            known = nearest("baseline", name, [*FIXED, *shipped_baselines()])
            raise ValueError(f"{known} (give a baseline of your own as module:object)")
        contestants.append(Contestant(name, spec, weights, checksum))
    return tuple(contestants)
