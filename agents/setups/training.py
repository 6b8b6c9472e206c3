"""Settings of a training: the table `[training]` of a set-up's file."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import inf
from typing import Any, Literal, Self, get_args

from agents.setups.keys import refuse_unknown
from impact_gym.quantities import QUANTITIES
from impact_gym.support.validation import Range, choice, fits_memory, flag, number, shown, whole

Activation = Literal["tanh", "relu"]
SLOTS = 100_000
"""Largest number of environments of a training. `agents.train.ppo` reserves this many seeds for each training."""
WHOLE: dict[str, tuple[int, float]] = {
    **dict.fromkeys(("steps", "epochs", "imitation_steps", "width", "depth"), (1, inf)),
    **dict.fromkeys(("validate_every", "validation_scenarios", "checkpoint_every"), (1, inf)),
    **dict.fromkeys(("batch", "rollout"), (2, inf)),
    **dict.fromkeys(("threads", "simulation_threads"), (1, 4096)),
    "envs": (1, SLOTS),
}
"""Limits of the settings that are whole numbers."""
FEWEST = 8  # smallest length of an observation


@dataclass(frozen=True)
class Training:
    """Settings of PPO, of its environments, and of the validation."""

    steps: int = 12_000_000
    """Total number of environment steps. The training rounds this number up to whole rollouts."""
    time_weight: Range = (0.3, 8.0)
    """Smallest and largest time weight (cost of a second until the touch, in m/s of the object's final velocity). Each
    episode draws a time weight log-uniformly from this range. The policy observes this time weight, and can be used
    with every time weight in the range."""
    weight_power: float = 0.5
    """The training divides rewards by (1 + time_weight) ** weight_power. With weight_power 0, episodes with a large
    time weight influence the policy most, because their costs are larger."""
    envs: int = 512
    """Number of parallel environments."""
    batch: int = 2048
    """Number of samples for each gradient step."""
    rollout: int = 64
    """Number of steps that each environment makes between two updates."""
    epochs: int = 3
    """Number of passes over the samples of each rollout."""
    gae_lambda: float = 1.0
    """Parameter lambda of PPO's estimate of the advantage. With a larger lambda, this estimate has less bias and
    more variance. The discount factor is always 1."""
    entropy: float = 0.0
    """Weight of the entropy bonus, which rewards exploration."""
    clip: float = 0.2
    """Clip range of PPO: limit for the relative change of an action's probability in an update."""
    log_std: float = -0.8
    """Logarithm of the initial standard deviation of the actions."""
    informed_critic: bool = True
    """Let the critic also observe the true scenario and all other numbers that the episode drew from a range."""
    teacher: str = ""
    """Name of a shipped baseline, or of a tuned baseline of the set-up. The policy first imitates the baseline, then
    learns from rewards. Empty: no imitation."""
    imitation_steps: int = 1_000_000
    """Number of environment steps in which the policy imitates the teacher."""
    learning_rate: float = 7e-4
    """Initial learning rate. During the training, the learning rate falls linearly to its final value."""
    final_rate: float = 0.1
    """Final learning rate, as a fraction of the initial learning rate."""
    width: int = 64
    """Number of neurons in each hidden layer."""
    depth: int = 2
    """Number of hidden layers."""
    activation: Activation = "tanh"
    """Activation function of the hidden layers."""
    nominal: float = 0.0
    """Fraction of the parallel environments that use the values in [evaluation.nominal] of the set-up."""
    rtol: float | None = None
    """Relative error that the simulation allows in a contact during the training. Without this option, the training
    uses the value of the set-up's environment, as the validation always does."""
    threads: int = 1
    """Number of threads of PyTorch."""
    simulation_threads: int | None = None
    """Largest number of threads that simulate the environments; with --seeds always 1. Default: one for each core. The
    result of the training does not depend on this number."""
    validate_every: int = 1_000_000
    """Approximate number of environment steps between two validations. The result of the training is the policy that
    had the lowest cost in a validation."""
    validation_scenarios: int = 1000
    """Number of scenarios of each validation. If this number is larger than 1,000, a validation has 1,000 scenarios."""
    checkpoint_every: int = 2_000_000
    """Approximate number of environment steps between two checkpoints."""

    def __post_init__(self) -> None:
        for name, (least, most) in WHOLE.items():
            if (value := getattr(self, name)) is not None or name != "simulation_threads":
                number(name, whole(name, value, at_least=least), "-", at_most=most)
        # memory holds four numbers for each weight of a network: the weight, its gradient and Adam's two moments
        weights = self.width * (FEWEST + (self.depth - 1) * self.width)
        largest = "width" if self.width >= self.depth else "depth"
        for name, count in ((largest, 2 * 4 * weights), ("rollout", FEWEST * self.round)):
            fits_memory(name, getattr(self, name), 4 * count // getattr(self, name))
        flag("informed_critic", self.informed_critic)
        choice("activation", self.activation, get_args(Activation))
        if not isinstance(self.teacher, str):
            raise ValueError(f"teacher must be the name of a baseline, got {shown(self.teacher)}")
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

    def changed(self, changes: Mapping[str, Any]) -> Self:
        """Return the settings after `changes` (lists become tuples); ValueError: an unknown name or a wrong value."""
        refuse_unknown(
            "training.", changes, ["mixed", "seeds", *(item.name for item in fields(self))]
        )  # two are for Setup
        settings: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in changes.items()}
        return replace(self, **settings)  # `__post_init__` checks them

    @property
    def round(self) -> int:
        """Number of environment steps in one rollout of all environments."""
        return self.envs * self.rollout

    @property
    def whole_steps(self) -> int:
        """Total number of environment steps: `steps`, rounded up to whole rollouts."""
        return -(-self.steps // self.round) * self.round

    def rate(self, remaining: float) -> float:
        """Return the learning rate; `remaining` is the fraction of the training that remains."""
        return self.learning_rate * (self.final_rate + (1.0 - self.final_rate) * remaining)
