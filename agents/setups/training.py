"""Settings of a training, the table `[training]` of a set-up's file, with a sentence under each."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import inf
from typing import Any, Literal, Self, get_args

from agents.setups.keys import known
from impact_gym.quantities import QUANTITIES
from impact_gym.validation import Range, fits_memory, flag, number, whole

Activation = Literal["tanh", "relu"]
SLOTS = 100_000
"""Most environments of a training: no two trainings share a seed of their scenarios, see `agents.train.ppo`."""
WHOLE: dict[str, tuple[int, float]] = {
    **dict.fromkeys(("steps", "epochs", "imitation_steps", "width", "depth"), (1, inf)),
    **dict.fromkeys(("validate_every", "validation_scenarios", "checkpoint_every"), (1, inf)),
    **dict.fromkeys(("batch", "rollout"), (2, inf)),
    **dict.fromkeys(("threads", "simulation_threads"), (1, 4096)),
    "envs": (1, SLOTS),
}
"""Whole numbers, with the least and the most of each."""
FEWEST = 8  # numbers of an observation


@dataclass(frozen=True)
class Training:
    """Settings of PPO, of the environments it plays in, and of its validation."""

    steps: int = 12_000_000
    """Environment steps in all; rounded up to whole rollouts of all environments."""
    time_weight: Range = (0.3, 8.0)
    """What a second of approach costs, in m/s of object velocity: log-uniform per episode, and seen by the policy, so
    that one policy is the whole trade-off. A ranged policy is as late as the paper's rule at 0.45."""
    weight_power: float = 0.5
    """Rewards are divided by (1 + time weight) to this power, so that those of a large weight do not dominate."""
    envs: int = 512
    """Environments side by side."""
    batch: int = 2048
    """Samples of a gradient step."""
    rollout: int = 64
    """Steps of each environment between two updates; an episode has about 30."""
    epochs: int = 3
    """Passes over a rollout."""
    gae_lambda: float = 1.0
    """Trade-off of bias and variance in the advantage. The discount is 1, as an episode ends and its sum counts."""
    entropy: float = 0.0
    """Bonus on exploration."""
    clip: float = 0.2
    """How far a probability may move in an update."""
    log_std: float = -0.8
    """Initial exploration, logarithm of the standard deviation of the actions."""
    informed_critic: bool = True
    """The critic, which is not shipped, also sees the true scenario and all other drawn numbers."""
    teacher: str = ""
    """Tuned baseline, the set-up's own or a shipped one, to imitate before learning from rewards; "": none."""
    imitation_steps: int = 1_000_000
    """Environment steps of imitation."""
    learning_rate: float = 7e-4
    """At the start; falls linearly."""
    final_rate: float = 0.1
    """Final learning rate over the initial one."""
    width: int = 64
    """Neurons in each hidden layer."""
    depth: int = 2
    """Hidden layers."""
    activation: Activation = "tanh"
    """Activation function of the hidden layers."""
    nominal: float = 0.0
    """Share of the environments that play the set-up's [evaluation.nominal], where hardly anything is drawn."""
    rtol: float | None = None
    """Relative error allowed in a contact while training, see `simulate`; None: the environment's, as in validation."""
    threads: int = 1
    """Threads of torch. A second one pays only where no other process wants the core."""
    simulation_threads: int | None = None
    """Threads of the environments; None: all cores. They change no result."""
    validate_every: int = 1_000_000
    """Steps between two plays of the validation set; the policy that does best there is kept."""
    validation_scenarios: int = 1000
    """Scenarios of it, at most 1,000."""
    checkpoint_every: int = 2_000_000
    """Steps between two checkpoints."""

    def __post_init__(self) -> None:
        for name, (least, most) in WHOLE.items():
            if (value := getattr(self, name)) is not None or name != "simulation_threads":
                number(name, whole(name, value, at_least=least), "-", at_most=most)
        self._fits_memory()
        flag("informed_critic", self.informed_critic)
        if self.activation not in get_args(Activation):
            raise ValueError(f"activation must be {' or '.join(get_args(Activation))}, got {self.activation!r}")
        if not isinstance(self.teacher, str):
            raise ValueError(f"teacher must be the name of a tuned baseline, got {self.teacher!r}")
        if self.teacher and self.steps < self.imitation_steps:
            raise ValueError(f"steps must be at least imitation_steps, {self.imitation_steps} (no unit), "
                             f"got {self.steps} (no unit)")  # fmt: skip
        object.__setattr__(self, "time_weight", QUANTITIES["time_weight"].interval(self.time_weight))
        for name in ("nominal", "gae_lambda", "weight_power", "final_rate"):
            number(name, getattr(self, name), "-", at_least=0, at_most=1)
        number("entropy", self.entropy, "-", at_least=0)
        number("clip", self.clip, "-", above=0, at_most=1)
        number("log_std", self.log_std, "-", at_least=-20, at_most=2)
        number("learning_rate", self.learning_rate, "-", above=0)
        if self.rtol is not None:
            QUANTITIES["rtol"].check(self.rtol)

    def _fits_memory(self) -> None:
        """Refuse networks or rollouts that this machine cannot hold, by a lower bound of their memory.

        A weight of actor and critic is there four times: itself, its gradient and Adam's two moments. Of a step at
        least the numbers in FEWEST are kept.
        """
        weights = self.width * (FEWEST + (self.depth - 1) * self.width)
        largest = "width" if self.width >= self.depth else "depth"
        for name, numbers in ((largest, 2 * 4 * weights), ("rollout", FEWEST * self.round)):
            value = getattr(self, name)
            fits_memory(name, value, 4 * numbers // value)

    def changed(self, changes: Mapping[str, Any]) -> Self:
        """Return the settings with others by name, as JSON or TOML has them; ValueError: no such setting or value."""
        known("training.", changes, [item.name for item in fields(self)])
        settings: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in changes.items()}
        return replace(self, **settings)  # `__post_init__` checks them

    @property
    def round(self) -> int:
        """Environment steps of a rollout of all environments, after which a checkpoint can be taken."""
        return self.envs * self.rollout

    @property
    def whole_steps(self) -> int:
        """Environment steps in all, in whole rollouts."""
        return -(-self.steps // self.round) * self.round

    def rate(self, remaining: float) -> float:
        """Return the learning rate where this share of the training remains."""
        return self.learning_rate * (self.final_rate + (1.0 - self.final_rate) * remaining)
