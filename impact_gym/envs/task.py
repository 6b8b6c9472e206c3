"""The task's rules: constants of the environment, its options, and the record of them that the kernels read."""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, get_args

import numpy as np

from impact_gym.envs.scenario import LARGEST_WEIGHT, LONGEST_DELAY, Range, ScenarioRanges, interval
from impact_gym.kernels import samples_under_way
from impact_gym.lowering import LOCAL_SHARE
from impact_gym.scene import Coupling, Rigid, Robot, RobotTable, SpringDamper
from impact_gym.validation import WrongTypeError, number, whole

VELOCITY_RANGE = (-0.5, 1.5)  # m/s, what action[0] in [-1, 1] is mapped to
ACCELERATION_RANGE = (1.0, 20.0)  # m/s^2, what action[1] in [-1, 1] is mapped to
COMMAND_RESOLUTION = 1e-6  # m/s and m/s^2; so 8 m/s^2 can be commanded exactly through a float32
AFTER_ALARM = 0.15  # s, an episode ends this long after the alarm
HORIZON = 1.2  # s, or here, if there is no alarm
MISSED_COST = 2.0  # m/s
LARGEST_FORCE_NOISE = 1e6  # N
LARGEST_RANGE_NOISE = 1e3  # m
DISSIPATIONS = ("hu-guo", "exact")
FULL_DECELERATION = 20.0  # m/s^2, after the end of the episode
SETTLE_LIMIT = 10.0  # s, simulated after the end at the most


@dataclass(frozen=True)
class Task:
    """Options of the environment, checked; the arguments of every front end."""

    scenario: Any = "train"
    coupling: Coupling = field(default_factory=lambda: SpringDamper(50.0, 1.0))
    tool_mass: float = 0.125  # kg
    time_weight: Any = 2.0  # m/s per s, a number or a range (log-uniform per episode)
    force_weight: float = 0.0  # m/s per N
    reaction_delay: Any = 0.016  # s, a number or a range (uniform per episode)
    control_period: float = 0.016  # s
    alarm_threshold: float = 1.0  # N, of the contact force (paper, section 3.2)
    dissipation: str = "hu-guo"  # or "exact", see Contact
    range_noise: float | None = None  # m, standard deviation of the distance estimate; None: no estimate
    force_noise: float = 0.0  # N, standard deviation of each reading of the force
    force_bias: float = 0.0  # N, standard deviation of an error that stays for the episode
    deflection_sensor: bool = False
    privileged: bool = False
    robot: Robot | RobotTable | None = None
    rtol: float = 1e-8  # -, see simulate
    max_episode_steps: int | None = None

    ranges: ScenarioRanges = field(init=False)
    weights: Range = field(init=False)
    delays: Range = field(init=False)

    def __post_init__(self) -> None:
        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        put("ranges", ScenarioRanges.of(self.scenario))
        put("coupling", coupling_from(self.coupling))
        put("tool_mass", number("tool_mass", self.tool_mass, "kg", above=0))
        put("weights", interval("time_weight", self.time_weight, "m/s per s", above=0, at_most=LARGEST_WEIGHT))
        put("force_weight", number("force_weight", self.force_weight, "m/s per N", at_least=0, at_most=LARGEST_WEIGHT))
        put("delays", interval("reaction_delay", self.reaction_delay, "s", at_least=0, at_most=LONGEST_DELAY))
        put("control_period", number("control_period", self.control_period, "s", at_least=1e-4, at_most=0.15))
        put("alarm_threshold", number("alarm_threshold", self.alarm_threshold, "N", at_least=1e-6, at_most=1e6))
        if self.dissipation not in DISSIPATIONS:
            raise ValueError(f"dissipation must be one of {DISSIPATIONS}, got {self.dissipation!r}")
        if self.range_noise is not None:
            put("range_noise", number("range_noise", self.range_noise, "m", at_least=0, at_most=LARGEST_RANGE_NOISE))
        put("force_noise", number("force_noise", self.force_noise, "N", at_least=0, at_most=LARGEST_FORCE_NOISE))
        put("force_bias", number("force_bias", self.force_bias, "N", at_least=0, at_most=LARGEST_FORCE_NOISE))
        for name in ("deflection_sensor", "privileged"):
            if not isinstance(getattr(self, name), (bool, np.bool_)):
                raise WrongTypeError(f"{name} must be True or False, got {getattr(self, name)!r}")
        put("robot", robot_from(self.robot))
        if self.deflection_sensor and isinstance(self.coupling, Rigid):
            raise ValueError("deflection_sensor must be False with a Rigid coupling, which has no deflection")
        put("rtol", number("rtol", self.rtol, "(no unit)", at_least=1e-13, at_most=1e-2))
        if self.max_episode_steps is not None:
            put("max_episode_steps", whole("max_episode_steps", self.max_episode_steps, at_least=1))

    def record(self) -> tuple[Any, ...]:
        """Return the fields of the kernels' `Task`."""
        return (
            self.control_period, HORIZON, AFTER_ALARM, FULL_DECELERATION, SETTLE_LIMIT, MISSED_COST,
            VELOCITY_RANGE, ACCELERATION_RANGE, COMMAND_RESOLUTION,
            self.alarm_threshold, self.range_noise or 0.0, self.force_noise, self.force_bias, self.force_weight,
            LOCAL_SHARE * self.rtol, int(self.dissipation == "exact"), self.max_episode_steps or 0,
            (*self.ranges.pairs(), self.weights, self.delays),
        )  # fmt: skip

    def readings_under_way(self) -> int:
        """Return how many force readings can be between sensor and controller."""
        return int(samples_under_way(self.delays[1], self.control_period))


def coupling_from(value: Any) -> Coupling:
    """Return a coupling from one or from a plain mapping, such as {"type": "SpringDamper", "stiffness": 50}."""
    coupling: Coupling = _record_from("coupling", value, {kind.__name__: kind for kind in get_args(Coupling)})
    return coupling


def robot_from(value: Any) -> Robot | RobotTable | None:
    """Return a robot from one, from a plain mapping, or None for a rigid one."""
    if value is None:
        return None
    robot: Robot | RobotTable = _record_from("robot", value, {"Robot": Robot, "RobotTable": RobotTable})
    return robot


def _record_from(name: str, value: Any, kinds: dict[str, type[Any]]) -> Any:
    """Return one of the records `kinds` from one, or from a mapping with its fields and its name as "type".

    A mapping of all fields of one kind needs no type: that is what `EnvSpec.to_json` makes of a record.
    """
    if isinstance(value, tuple(kinds.values())):
        return value
    if isinstance(value, Mapping):
        given = {field: argument for field, argument in value.items() if field != "type"}
        named = {kind: [field.name for field in fields(of)] for kind, of in kinds.items()}
        chosen = value.get("type", next((kind for kind in kinds if set(given) == set(named[kind])), None))
        if isinstance(chosen, str) and chosen in kinds:
            for field in given:
                if field not in named[chosen]:
                    raise WrongTypeError(f"{name} has no field {field!r}; the fields of a {chosen} are {named[chosen]}")
            needed = [field.name for field in fields(kinds[chosen]) if field.default is MISSING]
            needed = [field for field in needed if field not in given]
            if needed:
                raise WrongTypeError(f"{name}, a {chosen}, needs the fields {needed} too")
            return kinds[chosen](**given)
    wanted = " or ".join(kinds)
    raise WrongTypeError(f"{name} must be a {wanted}, or a mapping whose 'type' is one of {list(kinds)}, got {value!r}")
