"""The task's rules: constants of the environment, its options, and the record of them that the kernels read."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np

from impact_gym.envs.scenario import Range, ScenarioRanges, interval
from impact_gym.lowering import chain_law
from impact_gym.physics.coupling import Law
from impact_gym.scene import Coupling, Rigid, SpringDamper
from impact_gym.solver.state import LOCAL_SHARE
from impact_gym.validation import number, whole

VELOCITY_RANGE = (-0.5, 1.5)  # m/s, what action[0] in [-1, 1] is mapped to
ACCELERATION_RANGE = (1.0, 20.0)  # m/s^2, what action[1] in [-1, 1] is mapped to
COMMAND_RESOLUTION = 1e-6  # m/s and m/s^2; so 8 m/s^2 can be commanded exactly through a float32
ALARM_THRESHOLD = 1.0  # N (paper, section 3.2)
AFTER_ALARM = 0.15  # s, an episode ends this long after the alarm
HORIZON = 1.2  # s, or here, if there is no alarm
MISSED_COST = 2.0  # m/s
LARGEST_WEIGHT = 1e6  # m/s per s and m/s per N; keeps rewards finite
FULL_DECELERATION = 20.0  # m/s^2, after the end of the episode
SETTLE_LIMIT = 10.0  # s, simulated after the end at the most
MAX_STEPS = 1_000_000  # integration steps of one episode


class TaskConstants(NamedTuple):
    """The task for the kernels."""

    control_period: float  # s
    reaction_delay: float  # s
    samples_under_way: int  # force readings between sensor and controller at t = 0
    range_noise: float  # m, negative if there is no estimate
    force_weight: float  # m/s per N
    max_steps: int  # control steps until truncation, 0 if unlimited
    tolerance: float  # -, local, of a contact step


@dataclass(frozen=True)
class Task:
    """Options of the environment, checked; the arguments of every front end."""

    scenario: Any = "train"
    coupling: Coupling = field(default_factory=lambda: SpringDamper(50.0, 1.0))
    tool_mass: float = 0.125  # kg
    time_weight: Any = 2.0  # m/s per s, a number or a range (log-uniform per episode)
    force_weight: float = 0.0  # m/s per N
    reaction_delay: float = 0.016  # s
    control_period: float = 0.016  # s
    range_noise: float | None = None  # m, standard deviation of the distance estimate; None: no estimate
    rtol: float = 1e-8  # -, see simulate
    max_episode_steps: int | None = None

    ranges: ScenarioRanges = field(init=False)
    weights: Range = field(init=False)

    def __post_init__(self) -> None:
        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        put("ranges", ScenarioRanges.of(self.scenario))
        put("coupling", coupling_from(self.coupling))
        put("tool_mass", number("tool_mass", self.tool_mass, "kg", above=0))
        put("weights", interval("time_weight", self.time_weight, "m/s per s", at_most=LARGEST_WEIGHT))
        put("force_weight", number("force_weight", self.force_weight, "m/s per N", at_least=0, at_most=LARGEST_WEIGHT))
        put("reaction_delay", number("reaction_delay", self.reaction_delay, "s", at_least=0, at_most=1.0))
        put("control_period", number("control_period", self.control_period, "s", at_least=1e-4, at_most=0.15))
        if self.range_noise is not None:
            put("range_noise", number("range_noise", self.range_noise, "m", at_least=0))
        put("rtol", number("rtol", self.rtol, "(no unit)", at_least=1e-13, at_most=1e-2))
        if self.max_episode_steps is not None:
            put("max_episode_steps", whole("max_episode_steps", self.max_episode_steps, at_least=1))

    def law(self) -> Law:
        """Return the coupling for the kernels."""
        return chain_law(self.tool_mass, self.coupling)

    def constants(self) -> TaskConstants:
        """Return the rest for the kernels."""
        return TaskConstants(
            self.control_period,
            self.reaction_delay,
            math.floor(self.reaction_delay / self.control_period + 1e-9),
            -1.0 if self.range_noise is None else self.range_noise,
            self.force_weight,
            self.max_episode_steps or 0,
            LOCAL_SHARE * self.rtol,
        )

    def draw_table(self, ranges: ScenarioRanges) -> np.ndarray:
        """Return what an episode draws as an array (5, 2): the scenario's rows, then the time weight."""
        return np.vstack([ranges.table(), self.weights])


def coupling_from(value: Any) -> Coupling:
    """Return a coupling from one or from a plain mapping, such as {"type": "SpringDamper", "stiffness": 50}.

    A mapping of all fields of one kind needs no type: that is what `EnvSpec.to_json` makes of a coupling.
    """
    if isinstance(value, Coupling):
        return value
    kinds: dict[str, type[Any]] = {"Rigid": Rigid, "SpringDamper": SpringDamper}
    if isinstance(value, Mapping):
        given = {name: argument for name, argument in value.items() if name != "type"}
        named = {name: [field.name for field in fields(kind)] for name, kind in kinds.items()}
        complete = next((name for name in kinds if set(given) == set(named[name])), None)
        chosen = value.get("type", complete)
        if chosen in kinds:
            for name in given:
                if name not in named[chosen]:
                    raise TypeError(f"coupling has no field {name!r}; the fields of a {chosen} are {named[chosen]}")
            built: Coupling = kinds[chosen](**given)
            return built
    raise TypeError(
        f"coupling must be a Rigid or SpringDamper, or a mapping whose 'type' is one of {list(kinds)}, got {value!r}"
    )
