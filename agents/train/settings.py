"""Settings of a training, with a sentence under each; a set-up says which of them it wants otherwise."""

import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tyro

from agents.setups import load_setup
from agents.setups.keys import known, table, within
from impact_gym.envs.scenario import interval
from impact_gym.validation import number, whole

Algorithm = Literal["ppo", "sac", "tqc", "recurrent_ppo"]
Activation = Literal["tanh", "relu"]
FIRST_SEED, SLOTS = 10_000_000, 100_000
"""Environment i of training seed s is seeded FIRST_SEED + s * SLOTS + i: above all that evaluation uses, and no two
trainings share any."""

_OFF = {"steps": 300_000, "envs": 64, "batch": 512, "validate_every": 50_000, "checkpoint_every": 100_000}
OTHERWISE: dict[str, dict[str, Any]] = {
    "ppo": {},
    "recurrent_ppo": {"steps": 2_000_000, "validate_every": 200_000},
    "sac": _OFF,
    "tqc": _OFF,
}
"""What is set otherwise for an algorithm; by hand, while a study searches for the rest."""


@dataclass(frozen=True)
class OnPolicy:
    """Of ppo and recurrent_ppo: learn from what the present policy just did."""

    rollout: int = 64
    """Steps of each environment between two updates; an episode has about 30."""
    epochs: int = 3
    """Passes over a rollout."""
    gae_lambda: float = 1.0
    """Trade of bias for variance in the advantage. The discount is 1: an episode ends, and what counts is its sum."""
    entropy: float = 0.0
    """Bonus on exploration."""
    clip: float = 0.2
    """How far a probability may move in an update."""
    log_std: float = -0.8
    """Initial exploration, logarithm of a standard deviation; much more makes never touching attractive."""
    informed_critic: bool = True
    """The critic, which is not shipped, also sees the scenario: the object's mass, stiffness, restitution and distance.
    Of ppo alone."""
    teacher: str = ""
    """Tuned baseline, the set-up's own or a shipped one, that ppo imitates before it learns by itself; "": none."""
    taught: int = 1_000_000
    """Environment steps for which it does."""
    lstm: int = 32
    """Cells of the recurrent layer; recurrent_ppo alone has one."""

    def __post_init__(self) -> None:
        whole("on_policy.rollout", self.rollout, at_least=2)
        for name in ("epochs", "lstm", "taught"):
            whole(f"on_policy.{name}", getattr(self, name), at_least=1)
        number("on_policy.gae_lambda", self.gae_lambda, "(no unit)", at_least=0, at_most=1)
        number("on_policy.entropy", self.entropy, "(no unit)", at_least=0)
        number("on_policy.clip", self.clip, "(no unit)", above=0, at_most=1)
        number("on_policy.log_std", self.log_std, "(no unit)", at_least=-20, at_most=2)


@dataclass(frozen=True)
class OffPolicy:
    """Of sac and tqc: learn from all that is remembered."""

    buffer: int = 300_000
    """Steps remembered."""
    warm_up: int = 10_000
    """Steps at random before learning begins."""
    gradient_steps: int = 8
    """Gradient steps after each step of all environments."""
    tau: float = 0.005
    """How fast the target network follows."""

    def __post_init__(self) -> None:
        for name in ("buffer", "gradient_steps"):
            whole(f"off_policy.{name}", getattr(self, name), at_least=1)
        whole("off_policy.warm_up", self.warm_up, at_least=0)
        number("off_policy.tau", self.tau, "(no unit)", above=0, at_most=1)


@dataclass(frozen=True)
class Settings:
    """Train a policy on ImpactApproach-v0."""

    setup: tyro.conf.Positional[str] = "linear-blind"
    """What is trained for: a set-up by name or file."""
    algo: Algorithm = "ppo"
    """Algorithm of stable-baselines3 or sb3-contrib."""
    steps: int = 12_000_000
    """Environment steps in all; rounded up to whole rollouts of all environments."""
    seed: int = 0
    """Seed of the scenarios, the network and the exploration; no scenario is drawn as in evaluation."""
    out: Path | None = None
    """Run folder; it must not exist. Default: a new one below runs/."""
    resume: Path | None = None
    """Go on with the run in this folder, from its last checkpoint and with its settings; give nothing else then."""
    time_weight: tuple[float, float] = (0.3, 8.0)
    """What a second of approach costs, in m/s of object velocity: log-uniform per episode, and seen by the policy, so
    that one policy is the whole trade-off. A ranged policy is as late as the paper's rule at 0.45."""
    weight_power: float = 0.5
    """Rewards are divided by (1 + time weight) to this power, so that hurried episodes do not drown the others."""
    envs: int = 512
    """Environments side by side."""
    batch: int = 2048
    """Samples of a gradient step."""
    learning_rate: float = 7e-4
    """At the start; falls linearly."""
    final_rate: float = 0.1
    """Share of it that is left at the end."""
    width: int = 64
    """Neurons in each hidden layer."""
    depth: int = 2
    """Hidden layers."""
    activation: Activation = "tanh"
    """What follows each hidden layer."""
    rtol: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None
    """Relative error allowed in a contact while training, see `simulate`; None: the environment's, as in validation."""
    threads: int = 1
    """Threads of torch. A second one pays only where no other process wants the core."""
    simulation_threads: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None
    """Threads of the environments; None: all cores. They change no result."""
    validate_every: int = 1_000_000
    """Steps between two plays of the validation set; the policy that does best there is kept."""
    validation_scenarios: int = 1000
    """How many of its 1,000 scenarios."""
    checkpoint_every: int = 2_000_000
    """Steps between two checkpoints."""
    on_policy: OnPolicy = field(default_factory=OnPolicy)
    off_policy: OffPolicy = field(default_factory=OffPolicy)

    def __post_init__(self) -> None:
        positive = ("steps", "envs", "width", "depth", "threads", "validate_every", "validation_scenarios")
        for name in (*positive, "checkpoint_every"):
            whole(name, getattr(self, name), at_least=1)
        whole("batch", self.batch, at_least=2)
        whole("seed", self.seed, at_least=0)
        if self.envs > SLOTS:
            raise ValueError(f"envs must be at most {SLOTS}, got {self.envs}")
        object.__setattr__(self, "setup", load_setup(self.setup).called)  # wherever it is asked for again
        if self.algo not in get_args(Algorithm):
            raise ValueError(f"algo must be one of {get_args(Algorithm)}, got {self.algo!r}")
        if self.activation not in get_args(Activation):
            raise ValueError(f"activation must be {' or '.join(get_args(Activation))}, got {self.activation!r}")
        interval("time_weight", self.time_weight, "m/s per s", above=0)
        number("weight_power", self.weight_power, "(no unit)", at_least=0, at_most=1)
        if self.rtol is not None:
            number("rtol", self.rtol, "(no unit)", at_least=1e-13, at_most=1e-2)
        number("learning_rate", self.learning_rate, "(no unit)", above=0)
        number("final_rate", self.final_rate, "(no unit)", at_least=0, at_most=1)

    @property
    def environment(self) -> dict[str, Any]:
        """Arguments of the environment."""
        return {**load_setup(self.setup).environment, "time_weight": list(self.time_weight)}

    @property
    def training_environment(self) -> dict[str, Any]:
        """The same with what an informed critic sees."""
        informed = self.algo == "ppo" and self.on_policy.informed_critic
        faster = {} if self.rtol is None else {"rtol": self.rtol}
        return self.environment | faster | ({"privileged": True} if informed else {})

    @property
    def round(self) -> int:
        """Environment steps between two moments at which a checkpoint can be taken."""
        return self.envs * (self.on_policy.rollout if "ppo" in self.algo else 1)

    def rate(self, remaining: float) -> float:
        """Return the learning rate where this share of the training remains."""
        return self.learning_rate * (self.final_rate + (1.0 - self.final_rate) * remaining)

    @property
    def whole_steps(self) -> int:
        """Environment steps in all, in whole rollouts."""
        return -(-self.steps // self.round) * self.round


def default_settings(setup: str = "linear-blind", algo: Algorithm | None = None) -> Settings:
    """Return the settings of a set-up: what its file says, which holds for the algorithm that it names.

    Raises:
        ValueError: there is no such set-up, or a setting in its file is unknown or out of range; names the file.
    """
    loaded = load_setup(setup)
    with within(f"{loaded.path}: training"):
        changes = {name: value for name, value in loaded.training.items() if name != "seeds"}
        named = changes.pop("algo", "ppo")
        if named not in OTHERWISE:
            raise ValueError(f"algo must be one of {', '.join(OTHERWISE)}, got {named!r}")
        known("", changes, [name for name in as_json(Settings()) if name not in ("setup", "seed")])
        for group, kind in (("on_policy", OnPolicy), ("off_policy", OffPolicy)):
            known(f"{group}.", table(changes, group, "training."), [item.name for item in fields(kind)])
        settings = replace(Settings(), setup=setup, algo=algo or named, **OTHERWISE[algo or named])
        return with_changes(settings, changes) if algo in (None, named) else settings


def read_settings(arguments: list[str]) -> Settings:
    """Return the settings that a command line asks for; the set-up and the algorithm decide what the others are.

    Raises:
        ValueError: something beside the folder to resume.
    """
    default = default_settings()
    while True:
        settings = tyro.cli(Settings, default=default, args=arguments, prog="python -m agents.train")
        if settings.resume:
            if replace(settings, resume=None) != default_settings():
                raise ValueError("--resume takes its settings from the run: give nothing else")
            return settings
        if (settings.setup, settings.algo) == (default.setup, default.algo):
            return settings
        default = default_settings(settings.setup, settings.algo if settings.algo != default.algo else None)


def with_changes(settings: Any, changes: Mapping[str, Any]) -> Any:
    """Return `settings` with other values by name; a group's values as a mapping, lists for tuples."""
    given = {}
    for name, value in changes.items():
        before = getattr(settings, name)
        if is_dataclass(before):
            given[name] = with_changes(before, value)
        else:
            given[name] = tuple(value) if isinstance(value, list) else value
    return replace(settings, **given)


def as_json(settings: Settings) -> dict[str, Any]:
    """Return the settings by name for JSON, without the paths `out` and `resume`."""
    return {name: value for name, value in asdict(settings).items() if name not in ("out", "resume")}


def from_json(content: Mapping[str, Any]) -> Settings:
    """Return the settings that `as_json` gave.

    Raises:
        ValueError: a setting is missing or unknown, as in a run of another version.
    """
    if odd := content.keys() ^ as_json(Settings()).keys():
        raise ValueError(f"settings {sorted(odd)} are missing or unknown: another version's run")
    return with_changes(Settings(), content)


def command(settings: Settings) -> str:
    """Return the command that trains with these settings, as short as it can be."""
    words = ["python", "-m", "agents.train", settings.setup, "--algo", settings.algo]
    default = _flat(as_json(default_settings(settings.setup, settings.algo)))
    for name, value in _flat(as_json(settings)).items():
        if value == default[name]:
            continue
        option = f"--{name}".replace("_", "-")
        if isinstance(value, bool):
            group, _, switch = option.rpartition(".")
            words.append(option if value else f"{group}.no-{switch}")
        else:
            words += [option, *map(str, value if isinstance(value, tuple) else (value,))]
    return shlex.join(words)


def _flat(settings: Mapping[str, Any], group: str = "") -> dict[str, Any]:
    """Return settings by name, those of a group as group.name."""
    result: dict[str, Any] = {}
    for name, value in settings.items():
        result |= _flat(value, f"{name}.") if isinstance(value, Mapping) else {group + name: value}
    return result
