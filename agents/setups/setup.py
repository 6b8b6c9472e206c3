"""The class `Setup`, and functions that read the file of a set-up."""

import pickle
import tomllib
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import numpy as np

from agents.baselines import FIXED, RULES, BlindProfile, RangedProfile, Rule
from agents.setups.evaluation import COMPLIANT, SET_UP_ARGUMENTS, Evaluation
from agents.setups.keys import from_table, prefixed_errors, refuse_unknown, table, text
from agents.setups.training import Training
from impact_gym.parameters import SI, Count, Options, Share
from impact_gym.support.files import named_file, parsed
from impact_gym.support.validation import distinct, identifier, number, one_of, shown
from impact_gym.task import QUANTITIES, ObservationSpec, Task
from impact_gym.teleop.channels import WAYS, columns_of

SHIPPED = Path(__file__).resolve().parent
TUNED = SHIPPED.parent / "tuned"
VERSION = 1
TABLES = ("environment", "training", "baselines", "evaluation")
INHERITED = ("environment", "training", "evaluation")
"""Tables whose keys a set-up inherits, see `_read`."""
README = ("linear-blind", "linear-ranged", "bistable-blind", "paper-limits")
"""Set-ups that `impact-gym report` compares by default."""


@dataclass(frozen=True)
class Tuned(Options):
    """A baseline that is tuned for a set-up."""

    rule: type[Rule]  # one of RULES
    # relative tolerance of simulations in the search; the validation uses the task's rtol
    rtol: Annotated[float, QUANTITIES["rtol"]] = Task.rtol
    clean_alarm: bool = False  # whether the exact contact force raises the alarm in search and validation
    jitter: Share = 0.0  # standard deviation of errors added to actions in the search, as a fraction of their range
    scenarios: Count = 300  # number of scenarios that each candidate plays in the search
    effort: Share = 1.0  # fraction of `Setup.budget` that the search uses


SIMPLE = {"constant-speed": "ConstantSpeed", "threshold": "ThresholdBrake", "even-braking": "ConstantDeceleration"}
"""Rules that each set-up of a user also tunes and compares, by the end of the name, unless `against` is empty."""
UNSAID = "not measured for this controller: run impact-gym controller, or impact-gym report and then impact-gym export"


@dataclass(frozen=True)
class Setup(Options):
    """An arm, its training, and the baselines for comparison."""

    name: str
    title: str
    about: str  # description of the set-up, one line
    environment: Mapping[str, Any]  # arguments of `gym.make("ImpactApproach-v0", ...)`
    training: Training = field(default_factory=Training)
    tuned: Mapping[str, Tuned] = field(default_factory=dict)  # baselines that the set-up tunes, by name
    against: tuple[str, ...] = ()  # names of compared baselines, besides the paper's rule; the first is the main rival
    # name of a set-up whose bound holds here; a bound is the lowest cost found for a controller that knows the object
    bound: str = ""
    budget: Count = 4800  # largest number of candidates in tuning for each time weight, rounded up to whole generations
    evaluation: Evaluation = field(default_factory=Evaluation)
    fails: str = UNSAID  # where the set-up's policy fails, in words
    path: Path = Path()
    mixed: tuple[tuple[float, Mapping[str, Any]], ...] = ()  # pairs: share of training environments, changed arguments
    seeds: Annotated[int, SI("-", at_least=1, at_most=10_000)] = 10  # number of trainings, with seeds from 0 on
    own: bool = False  # whether the file is a user's, and no copy of a shipped one

    def make(self, **more: Any) -> gym.Env[Any, Any]:
        """Return the set-up's Gymnasium environment; arguments in `more` replace those of the set-up."""
        return gym.make("impact_gym:ImpactApproach-v0", **{**self.environment, **more})

    def make_vec(self, num_envs: int, **more: Any) -> gym.vector.VectorEnv[Any, Any, Any]:
        """Return `num_envs` environments as one Gymnasium vector environment; for `more` see `make`."""
        return gym.make_vec("impact_gym:ImpactApproach-v0", num_envs=num_envs, **{**self.environment, **more})

    @cached_property
    def task(self) -> Task:
        """The task of the environment."""
        return Task(**self.environment)

    @property
    def shipped(self) -> bool:
        """Whether the set-up's file is in this folder."""
        return self.path.parent == SHIPPED

    @property
    def cli_name(self) -> str:
        """Argument of a command for this set-up: its name if it is shipped, else its path."""
        return self.name if self.shipped else str(self.path)

    @property
    def folder(self) -> Path:
        """Default folder of the set-up's results, with the subfolders `policies` and `tuned`."""
        return SHIPPED.parent if self.shipped else Path("runs") / self.name

    def describes(self, task: Task) -> bool:
        """Whether a task and the set-up's task have equal values of all arguments in SET_UP_ARGUMENTS."""
        return not {*self.task.differs_in(task)} & {*SET_UP_ARGUMENTS}


def shipped() -> tuple[str, ...]:
    """Return the names of the set-ups in this folder."""
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.toml")))


def trained() -> tuple[str, ...]:
    """Return the names of the shipped set-ups with a shipped policy."""
    return tuple(name for name in shipped() if (SHIPPED.parent / "policies" / f"{name}.npz").is_file())


def shipped_baselines() -> tuple[str, ...]:
    """Return the names of the shipped tuned baselines."""
    return tuple(sorted(path.stem for path in TUNED.glob("*.json")))


def setup_tuning(baseline: str, setup: Setup | None = None) -> Setup | None:
    """Return the set-up that tunes `baseline`: `setup`, or else a shipped set-up; None: no set-up tunes it."""
    if setup and baseline in setup.tuned:
        return setup
    return next((setup for setup in map(load_setup, shipped()) if baseline in setup.tuned), None)


def load_setup(name_or_path: str | Path) -> Setup:
    """Return a shipped set-up, by name, or the set-up in a file. TypeError, ValueError: it is missing or invalid."""
    path = named_file("set-up", name_or_path, SHIPPED, ".toml").resolve()
    identifier("name of a set-up's file", path.stem)
    content, beside = _read(path), SHIPPED / path.name
    own = not (beside.is_file() and beside.read_bytes() == path.read_bytes())
    with prefixed_errors(str(path)):
        return deepcopy(_setup(path, own, pickle.dumps(content)))


def _read(path: Path, extended: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Return the content of a file; the INHERITED tables also get the keys of the set-up that `extends` names."""
    content: dict[str, Any] = parsed(path, "TOML", tomllib.loads)
    with prefixed_errors(str(path)):
        _read_delays(table(content, "environment"), path.parent)
        mixed = table(content, "training").get("mixed", [])
        for place, part in enumerate(mixed if isinstance(mixed, list) else []):
            if isinstance(part, dict):
                with prefixed_errors(f"training.mixed[{place}]"):
                    _read_delays(part, path.parent)
        if "extends" in content:
            beside = path.parent / (name := text(content, "extends", ""))
            base = named_file("set-up", beside if name.endswith(".toml") else name, SHIPPED, ".toml").resolve()
            if base in (*extended, path):
                raise ValueError(f"extends must name a set-up that does not extend this one, got {name!r}")
            inherited = _read(base, (*extended, path))
            content |= {each: {**table(inherited, each), **table(content, each)} for each in INHERITED}
    return content


@lru_cache(maxsize=64)  # by content, because checking a set-up takes ten times as long as reading its files
def _setup(path: Path, own: bool, packed: bytes) -> Setup:
    """Return the set-up with the pickled content of the file; `own`: whether the file is a user's."""
    content = pickle.loads(packed)
    version = content.get("version", VERSION)
    if version != VERSION:
        raise ValueError(
            f"version must be {VERSION}, got {shown(version)}: the file is for another version of impact-gym"
        )
    refuse_unknown("", content, ("version", "title", "about", "fails", "extends", *TABLES))
    environment, training, baselines, evaluation = (table(content, name) for name in TABLES)
    refuse_unknown("environment.", environment, SET_UP_ARGUMENTS)
    with prefixed_errors("environment"):
        task = Task(**environment)
        environment = task.arguments()  # so that a part of them, without the scenario, has the same horizon
    refuse_unknown("baselines.", baselines, ("against", "tuned", "bound", "budget"))
    usual = {f"{path.stem}-profile": (BlindProfile if task.range_noise is None else RangedProfile).__name__}
    listed = table(baselines, "tuned", "baselines.") or usual
    tuned = dict[str, Tuned]()
    for name, given in listed.items():
        tuned[identifier("baselines.tuned: each", name)] = _tuned(f"baselines.tuned.{name}", given, task)
    against = baselines.get("against", list(tuned))
    if not isinstance(against, list) or not all(isinstance(name, str) for name in against):
        raise ValueError(f"baselines.against must be a list of names, got {shown(against)}")
    distinct("baselines.against", against)
    if own and against:
        rules = {each.rule.__name__ for each in tuned.values()}
        missing = {f"{path.stem}-{end}": rule for end, rule in SIMPLE.items() if rule not in rules}
        simple = {name: Tuned(RULES[rule], effort=0.5) for name, rule in missing.items() if name not in tuned}
        tuned |= simple
        against = [*against, *(name for name in simple if name not in against)]
    title = text(content, "title", path.stem)
    mixed = _mixed(training.pop("mixed", []), task)
    counts = {name: of.pop(name) for name, of in (("seeds", training), ("budget", baselines)) if name in of}
    settings = Training().changed(training)
    with prefixed_errors("training"):
        shares = settings.nominal + sum(share for share, _ in mixed)
        number("nominal and the shares in mixed, added up,", shares, "-", at_most=1)
    asked = Evaluation.of_table(evaluation, environment, COMPLIANT if path.parent == SHIPPED else None, own)
    if settings.nominal and not asked.nominal:
        raise ValueError(f"training.nominal must be 0 without a table [evaluation.nominal], got {settings.nominal!r}")
    setup = Setup(
        path.stem, title, text(content, "about", title), environment, settings, tuned, tuple(against),
        text(baselines, "bound", path.stem, "baselines."), evaluation=asked, fails=text(content, "fails", UNSAID),
        path=path, mixed=mixed, own=own, **counts,
    )  # fmt: skip
    _check_names_and_weights(setup, evaluation)
    return setup


def _read_delays(environment: dict[str, Any], folder: Path) -> None:
    """Replace each channel's `trace`, a path relative to the set-up's `folder`, by the rows of that file."""
    for way in WAYS:
        if isinstance(channel := environment.get(way), dict) and isinstance(trace := channel.get("trace"), str):
            with prefixed_errors(f"environment.{way}"):
                channel["trace"] = [list(row) for row in zip(*columns_of(folder / trace), strict=True)]


def _mixed(given: Any, task: Task) -> tuple[tuple[float, Mapping[str, Any]], ...]:
    one_of("training.mixed", given, list)
    parts = []
    for place, part in enumerate(given):
        name = f"training.mixed[{place}]"
        one_of(name, part, dict)
        refuse_unknown(f"{name}.", part, ("share", *SET_UP_ARGUMENTS))
        with prefixed_errors(name):
            share = number("share", part.pop("share", "nothing"), "-", above=0, at_most=1)
            ObservationSpec.of_rows([task, task.changed(part)])
        parts.append((share, part))
    return tuple(parts)


def _check_names_and_weights(setup: Setup, given: Mapping[str, Any]) -> None:
    """Refuse unknown baselines and an unknown bound, and time weights outside the training's range."""
    low, high = setup.training.time_weight
    for name in ("weights", "typical", "curve"):
        for weight in np.atleast_1d(getattr(setup.evaluation, name)).tolist():
            if name in given:
                number(f"evaluation.{name}", weight, "m/s per s", at_least=low, at_most=high)
            elif name != "curve" and not low <= weight <= high:  # the report omits such weights of `curve`
                what = f"{weight:g} m/s per s, a default of evaluation.{name}"
                raise ValueError(f"training.time_weight must include {what}, got {low:g} to {high:g} m/s per s")
    baselines = {*setup.tuned, *shipped_baselines(), *FIXED}  # only names: a set-up's file must not import code
    refuse_unknown("baselines.against.", setup.against, baselines, "name")
    refuse_unknown("training.teacher.", [setup.training.teacher], {"", *baselines}, "name")
    refuse_unknown("baselines.bound.", [setup.bound], [setup.name, *shipped()], "name")


def _tuned(name: str, given: Any, task: Task) -> Tuned:
    entry = {"rule": given} if isinstance(given, str) else given
    if not isinstance(entry, dict) or entry.get("rule") not in [*RULES]:
        raise ValueError(
            f"{name} must be a rule ({', '.join(sorted(RULES))}) or a table whose key rule is one, got {shown(given)}"
        )
    tuned = from_table(Tuned, {**entry, "rule": RULES[entry["rule"]]}, name)
    with prefixed_errors(name):
        tuned.rule.check_observed(ObservationSpec(task))
    return tuned
