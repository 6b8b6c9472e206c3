"""Settings of a training, with a sentence under each; a set-up says which of them it wants otherwise."""

import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tyro

from agents.setups import load_setup
from agents.setups.keys import known, within
from impact_gym.envs.scenario import interval
from impact_gym.validation import number, whole

Activation = Literal["tanh", "relu"]
FIRST_SEED, SLOTS = 10_000_000, 100_000
"""Environment i of training seed s is seeded FIRST_SEED + s * SLOTS + i: above all that evaluation uses, and no two
trainings share any."""


@dataclass(frozen=True)
class Settings:
    """Train a policy on ImpactApproach-v0."""

    setup: tyro.conf.Positional[str] = "linear-blind"
    """What is trained for: a set-up by name or file."""
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
    """The critic, which is not shipped, also sees the scenario: object's mass, stiffness, restitution and distance."""
    teacher: str = ""
    """Tuned baseline, the set-up's own or a shipped one, to imitate before learning by oneself; "": none."""
    taught: int = 1_000_000
    """Environment steps for which it is."""
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
    nominal: float = 0.0
    """Share of the environments that play the set-up's [evaluation.nominal], where hardly anything is drawn."""
    deflection: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None
    """m, that the tool may move against the flange before it touches: more is charged while training; None: nothing."""
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

    def __post_init__(self) -> None:
        positive = ("steps", "envs", "epochs", "taught", "width", "depth", "threads", "validate_every")
        for name in (*positive, "validation_scenarios", "checkpoint_every"):
            whole(name, getattr(self, name), at_least=1)
        for name in ("batch", "rollout"):
            whole(name, getattr(self, name), at_least=2)
        whole("seed", self.seed, at_least=0)
        if self.envs > SLOTS:
            raise ValueError(f"envs must be at most {SLOTS}, got {self.envs}")
        object.__setattr__(self, "setup", load_setup(self.setup).called)  # wherever it is asked for again
        if self.activation not in get_args(Activation):
            raise ValueError(f"activation must be {' or '.join(get_args(Activation))}, got {self.activation!r}")
        interval("time_weight", self.time_weight, "m/s per s", above=0)
        number("nominal", self.nominal, "(no unit)", at_least=0, at_most=1)
        if self.nominal and not load_setup(self.setup).evaluation.nominal:
            raise ValueError(f"nominal must be 0: {self.setup} has no table [evaluation.nominal], got {self.nominal!r}")
        number("gae_lambda", self.gae_lambda, "(no unit)", at_least=0, at_most=1)
        number("entropy", self.entropy, "(no unit)", at_least=0)
        number("clip", self.clip, "(no unit)", above=0, at_most=1)
        number("log_std", self.log_std, "(no unit)", at_least=-20, at_most=2)
        number("weight_power", self.weight_power, "(no unit)", at_least=0, at_most=1)
        if self.deflection is not None:
            number("deflection", self.deflection, "m", above=0)
        if self.nominal and load_setup(self.setup).environment.get("holder_told"):
            raise ValueError(
                f"nominal must be 0 where holder_told scales what is shown by its range, got {self.nominal!r}"
            )
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
        faster = {} if self.rtol is None else {"rtol": self.rtol}
        return self.environment | faster | ({"privileged": True} if self.informed_critic else {})

    @property
    def round(self) -> int:
        """Environment steps between two moments at which a checkpoint can be taken."""
        return self.envs * self.rollout

    def rate(self, remaining: float) -> float:
        """Return the learning rate where this share of the training remains."""
        return self.learning_rate * (self.final_rate + (1.0 - self.final_rate) * remaining)

    @property
    def whole_steps(self) -> int:
        """Environment steps in all, in whole rollouts."""
        return -(-self.steps // self.round) * self.round


def default_settings(setup: str = "linear-blind") -> Settings:
    """Return the settings of a set-up: what its file says.

    Raises:
        ValueError: there is no such set-up, or a setting in its file is unknown or out of range; names the file.
    """
    loaded = load_setup(setup)
    with within(f"{loaded.path}: training"):
        changes = {name: value for name, value in loaded.training.items() if name != "seeds"}
        known("", changes, [name for name in as_json(Settings()) if name not in ("setup", "seed")])
        return with_changes(Settings(), {**changes, "setup": setup})


def read_settings(arguments: list[str]) -> Settings:
    """Return the settings that a command line asks for; the set-up decides what the others are.

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
        if settings.setup == default.setup:
            return settings
        default = default_settings(settings.setup)


def with_changes(settings: Settings, changes: Mapping[str, Any]) -> Settings:
    """Return `settings` with other values by name, lists for tuples."""
    given = {name: tuple(value) if isinstance(value, list) else value for name, value in changes.items()}
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
    words = ["python", "-m", "agents.train", settings.setup]
    default = as_json(default_settings(settings.setup))
    for name, value in as_json(settings).items():
        if value == default[name]:
            continue
        option = name.replace("_", "-")
        if isinstance(value, bool):
            words.append(f"--{option}" if value else f"--no-{option}")
        else:
            words += [f"--{option}", *map(str, value if isinstance(value, tuple) else (value,))]
    return shlex.join(words)
