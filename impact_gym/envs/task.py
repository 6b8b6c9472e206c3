"""The task's rules: constants of the environment, its options, and the record of them that the kernels read."""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Any, get_args

import numpy as np

from impact_gym.envs.scenario import LARGEST_WEIGHT, LONGEST_DELAY, Range, ScenarioRanges, interval
from impact_gym.envs.setting import HOLDER_NUMBERS, NUMBERS, SETTING_PLACES, middle, ranged_record
from impact_gym.kernels import samples_under_way
from impact_gym.lowering import LOCAL_SHARE, holder
from impact_gym.scene import Coupling, Rigid, Robot, RobotTable, SpringDamper
from impact_gym.validation import WrongTypeError, number, whole

VELOCITY_RANGE = (-0.5, 1.5)  # m/s, what action[0] in [-1, 1] is mapped to, if not said otherwise
ACCELERATION_RANGE = (1.0, 20.0)  # m/s^2, what action[1] in [-1, 1] is mapped to, likewise; its end brakes afterwards
FASTEST, STRONGEST = 1e3, 1e6  # m/s, m/s^2
COMMAND_RESOLUTION = 1e-6  # m/s and m/s^2; so 8 m/s^2 can be commanded exactly through a float32
AFTER_ALARM = 0.15  # s, an episode ends this long after the alarm
HORIZON = 1.2  # s, or here, if there is no alarm
MISSED_COST = 2.0  # m/s
DISSIPATIONS = ("hu-guo", "exact")
ALARMS = ("force", "reading")
PAST_READINGS = 3
SETTLE_LIMIT = 10.0  # s, simulated after the end at the most


@dataclass(frozen=True)
class Task:
    """Options of the environment, checked; the arguments of every front end.

    A physical number may be given as a pair (low, high), which episodes draw from: `drawn` has it then, and the field
    itself the middle. `at` returns the task of one episode.
    """

    scenario: Any = "train"
    coupling: Any = field(default_factory=lambda: SpringDamper(50.0, 1.0))
    tool_mass: Any = 0.125  # kg
    time_weight: Any = 2.0  # m/s per s, a number or a range (log-uniform per episode)
    force_weight: float = 0.0  # m/s per N
    reaction_delay: Any = 0.016  # s, a number or a range (uniform per episode)
    control_period: float = 0.016  # s
    velocity_range: Any = VELOCITY_RANGE
    acceleration_range: Any = ACCELERATION_RANGE
    alarm: str = "force"  # what raises it: the contact force itself, or its noisy "reading"
    alarm_threshold: Any = 1.0  # N, of the contact force (paper, section 3.2)
    dissipation: str = "hu-guo"  # or "exact", see Contact
    range_noise: Any = None  # m, standard deviation of the distance estimate; None: no estimate
    range_bias: Any = 0.0  # m, by which all estimates are too far
    range_told: bool = False  # observe range_noise
    holder_told: bool = False  # observe what is drawn of tool, coupling and robot
    force_noise: Any = 0.0  # N, standard deviation of each reading of the force
    force_bias: Any = 0.0  # N, standard deviation of an error that stays for the episode
    deflection_sensor: bool = False
    past_readings: int = 0  # observe so many before the last one, too
    privileged: bool = False
    robot: Any = None
    rtol: float = 1e-8  # -, see simulate
    max_episode_steps: int | None = None

    ranges: ScenarioRanges = field(init=False)
    weights: Range = field(init=False)
    delays: Range = field(init=False)
    drawn: Mapping[str, Range] = field(init=False)

    def __post_init__(self) -> None:
        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        put("ranges", ScenarioRanges.of(self.scenario))
        put("scenario", self.ranges)
        drawn: dict[str, Range] = {}
        for name, make in {"coupling": coupling_from, "robot": robot_from}.items():
            record, of_record = ranged_record(name, getattr(self, name), make)
            put(name, record)
            drawn |= of_record
        for name, (unit, _, allowed) in NUMBERS.items():
            if "." not in name and getattr(self, name) is not None:
                pair = interval(name, getattr(self, name), unit, **allowed)
                put(name, middle(name, pair))
                drawn |= {name: pair} if pair[0] < pair[1] else {}
        put("drawn", {name: drawn[name] for name in NUMBERS if name in drawn})
        put("weights", interval("time_weight", self.time_weight, "m/s per s", above=0, at_most=LARGEST_WEIGHT))
        put("force_weight", number("force_weight", self.force_weight, "m/s per N", at_least=0, at_most=LARGEST_WEIGHT))
        put("delays", interval("reaction_delay", self.reaction_delay, "s", at_least=0, at_most=LONGEST_DELAY))
        for name, (low, high) in {"time_weight": self.weights, "reaction_delay": self.delays}.items():
            put(name, low if low == high else (low, high))
        put("control_period", number("control_period", self.control_period, "s", at_least=1e-4, at_most=0.15))
        put("velocity_range", command_range("velocity_range", self.velocity_range, "m/s", at_most=FASTEST))
        if self.velocity_range[0] < -FASTEST or self.velocity_range[1] <= 0.0:
            raise ValueError(
                f"velocity_range must end above 0 and begin at -1000 m/s or more, got {self.velocity_range}"
            )
        limits = {"above": 0.0, "at_most": STRONGEST}
        put("acceleration_range", command_range("acceleration_range", self.acceleration_range, "m/s^2", **limits))
        for name, choice in {"dissipation": DISSIPATIONS, "alarm": ALARMS}.items():
            if getattr(self, name) not in choice:
                raise ValueError(f"{name} must be one of {choice}, got {getattr(self, name)!r}")
        for name in ("deflection_sensor", "privileged", "range_told", "holder_told"):
            if not isinstance(getattr(self, name), (bool, np.bool_)):
                raise WrongTypeError(f"{name} must be True or False, got {getattr(self, name)!r}")
        if self.deflection_sensor and isinstance(self.coupling, Rigid):
            raise ValueError("deflection_sensor must be False with a Rigid coupling, which has no deflection")
        if self.range_noise is None and (self.range_told or self.range_bias or "range_bias" in drawn):
            raise ValueError("range_bias and range_told must be 0 and False without an estimate, range_noise None")
        if self.holder_told and not self.draws_holder:
            raise ValueError("holder_told must be False unless a number of tool, coupling or robot is a range")
        put("rtol", number("rtol", self.rtol, "(no unit)", at_least=1e-13, at_most=1e-2))
        put("past_readings", whole("past_readings", self.past_readings, at_least=0))
        number("past_readings", self.past_readings, "(no unit)", at_most=PAST_READINGS)
        if self.max_episode_steps is not None:
            put("max_episode_steps", whole("max_episode_steps", self.max_episode_steps, at_least=1))

    def record(self, first_draw: int = 0) -> tuple[Any, ...]:
        """Return the fields of the kernels' `Task`; its draws begin at `first_draw` among those of all tasks."""
        _, _, _, of_coupling, of_robot, *_ = holder(self.tool_mass, self.coupling, self.robot)[0]
        ranging = (self.range_noise or 0.0, self.range_bias)
        numbers = (self.tool_mass, self.alarm_threshold, *ranging, self.force_noise, self.force_bias)
        return (
            self.control_period, HORIZON, AFTER_ALARM, self.acceleration_range[1], SETTLE_LIMIT, MISSED_COST,
            self.velocity_range, self.acceleration_range, COMMAND_RESOLUTION,
            (*numbers, of_coupling, of_robot),
            first_draw, first_draw + len(self.drawn), int(self.draws_holder),
            int(self.alarm == "reading"), self.force_weight,
            LOCAL_SHARE * self.rtol, int(self.dissipation == "exact"), self.max_episode_steps or 0,
            (*self.ranges.pairs(), self.weights, self.delays),
        )  # fmt: skip

    @property
    def draws_holder(self) -> bool:
        """Whether episodes differ in what holds the tool."""
        return not self.drawn.keys().isdisjoint(HOLDER_NUMBERS)

    def draws(self) -> list[tuple[Any, ...]]:
        """Return the fields of the kernels' `Draw` of each number that episodes draw."""
        return [
            (SETTING_PLACES[name], int(NUMBERS[name].log_uniform(pair[0])), *pair) for name, pair in self.drawn.items()
        ]

    def at(self, record: Mapping[str, float]) -> "Task":
        """Return the task of the episode that drew `record`, the final `info["record"]`: nothing in it is drawn."""
        if not self.drawn:
            return self
        changes: dict[str, Any] = {"holder_told": False}  # of nothing drawn
        for name in self.drawn:
            top, _, inner = name.partition(".")
            value = float(record[name])
            changes[top] = replace(changes.get(top, getattr(self, top)), **{inner: value}) if inner else value
        return replace(self, **changes)

    def readings_under_way(self) -> int:
        """Return how many force readings can be between sensor and controller."""
        return int(samples_under_way(self.delays[1], self.control_period))


def command_range(name: str, value: Any, unit: str, **limits: float) -> Range:
    """Return what an action is mapped to: a pair whose ends differ."""
    low, high = interval(name, value, unit, **limits)
    if not low < high:
        raise ValueError(f"{name} must be a pair (low, high) in {unit}, low below high, got {value!r}")
    return low, high


def coupling_from(value: Any) -> Coupling:
    """Return a coupling from one or from a plain mapping, such as {"type": "SpringDamper", "stiffness": 50}."""
    return _record_from("coupling", value, *get_args(Coupling))


def robot_from(value: Any) -> Robot | RobotTable | None:
    """Return a robot from one, from a plain mapping, or None for a rigid one."""
    return None if value is None else _record_from("robot", value, Robot, RobotTable)


def _record_from(name: str, value: Any, *allowed: type[Any]) -> Any:
    """Return a record of one of the `allowed` kinds from one, or from a mapping with its fields and its kind as "type".

    A mapping of all fields of one kind needs no type: that is what `EnvSpec.to_json` makes of a record.
    """
    if isinstance(value, allowed):
        return value
    kinds = {kind.__name__: kind for kind in allowed}
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
