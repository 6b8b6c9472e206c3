"""Settings of a training: the table `[training]` of a set-up's file."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal, Self

from agents.setups.keys import from_table
from impact_gym.parameters import SI, Count, Options, Share
from impact_gym.quantities import QUANTITIES
from impact_gym.support.validation import Range, fits_memory

Activation = Literal["tanh", "relu"]
SLOTS = 100_000
"""Largest number of environments of a training. `agents.train.ppo` reserves this many seeds for each training."""
FEWEST = 8  # smallest length of an observation


@dataclass(frozen=True)
class Training(Options):
    """Settings of PPO, of its environments, and of the validation."""

    steps: Count = 12_000_000
    """Total number of environment steps. The training rounds this number up to whole rollouts."""
    time_weight: Annotated[Range, QUANTITIES["time_weight"]] = (0.3, 8.0)
    """Smallest and largest time weight (cost of a second until the touch, m/s per s). Each episode draws a time weight
    log-uniformly from this range. The policy observes this time weight, and works at each time weight in the range."""
    weight_power: Share = 0.5
    """The training divides rewards by (1 + time_weight) ** weight_power. With weight_power 0, episodes with a large
    time weight influence the policy most, because their costs are larger."""
    envs: Annotated[int, SI("-", at_least=1, at_most=SLOTS)] = 512
    """Number of parallel environments."""
    batch: Annotated[int, SI("-", at_least=2)] = 2048
    """Number of samples for each gradient step."""
    rollout: Annotated[int, SI("-", at_least=2)] = 64
    """Number of steps that each environment makes between two updates."""
    epochs: Count = 3
    """Number of passes over the samples of each rollout."""
    gae_lambda: Share = 1.0
    """Parameter lambda of PPO's estimate of the advantage. With a larger lambda, this estimate has less bias and
    more variance. The discount factor is always 1."""
    entropy: Annotated[float, SI("-", at_least=0)] = 0.0
    """Weight of the entropy bonus, which rewards exploration."""
    clip: Annotated[float, SI("-", above=0, at_most=1)] = 0.2
    """Clip range of PPO: limit for the relative change of an action's probability in an update."""
    log_std: Annotated[float, SI("-", at_least=-20, at_most=2)] = -0.8
    """Logarithm of the initial standard deviation of the actions."""
    informed_critic: bool = True
    """Let the critic also observe the true scenario and all other numbers that the episode drew from a range."""
    teacher: str = ""
    """Name of a shipped baseline, or of a tuned baseline of the set-up. The policy first imitates the baseline, then
    learns from rewards. Empty: no imitation."""
    imitation_steps: Count = 1_000_000
    """Number of environment steps in which the policy imitates the teacher."""
    learning_rate: Annotated[float, SI("-", above=0)] = 7e-4
    """Initial learning rate. During the training, the learning rate falls linearly to its final value."""
    final_rate: Share = 0.1
    """Final learning rate, as a fraction of the initial learning rate."""
    width: Count = 64
    """Number of neurons in each hidden layer."""
    depth: Count = 2
    """Number of hidden layers."""
    activation: Activation = "tanh"
    """Activation function of the hidden layers."""
    nominal: Share = 0.0
    """Fraction of the parallel environments that use the values in [evaluation.nominal] of the set-up."""
    rtol: Annotated[float | None, QUANTITIES["rtol"]] = None
    """Relative error that the simulation allows in a contact during the training. Without this option, the training
    uses the value of the set-up's environment, as the validation always does."""
    threads: Annotated[int, SI("-", at_least=1, at_most=4096)] = 1
    """Number of threads of PyTorch."""
    simulation_threads: Annotated[int | None, SI("-", at_least=1, at_most=4096)] = None
    """Largest number of threads that simulate the environments; with --seeds always 1. Default: one for each core. The
    result of the training does not depend on this number."""
    validate_every: Count = 1_000_000
    """Approximate number of environment steps between two validations. The result of the training is the policy that
    had the lowest cost in a validation."""
    validation_scenarios: Count = 1000
    """Number of scenarios of each validation. If this number is larger than 1,000, a validation has 1,000 scenarios."""
    checkpoint_every: Count = 2_000_000
    """Approximate number of environment steps between two checkpoints."""

    def __post_init__(self) -> None:
        super().__post_init__()
        # memory holds four numbers for each weight of a network: the weight, its gradient and Adam's two moments
        weights = self.width * (FEWEST + (self.depth - 1) * self.width)
        largest = "width" if self.width >= self.depth else "depth"
        for name, count in ((largest, 2 * 4 * weights), ("rollout", FEWEST * self.round)):
            fits_memory(name, getattr(self, name), 4 * count // getattr(self, name))
        if self.teacher and self.steps < self.imitation_steps:
            raise ValueError(f"steps must be at least imitation_steps, {self.imitation_steps} (no unit), "
                             f"got {self.steps} (no unit)")  # fmt: skip

    def changed(self, changes: Mapping[str, Any]) -> Self:
        """Return the settings after `changes` (lists become tuples); ValueError: an unknown name or a wrong value."""
        return from_table(type(self), {**asdict(self), **changes}, "training", ("mixed", "seeds"))  # these are Setup's

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
