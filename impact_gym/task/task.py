"""The arguments of the environment, which `Task` checks."""

import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from typing import Annotated, Any, Literal, Self, get_args

from impact_gym import sensors
from impact_gym.couplings import COUPLINGS, SpringDamper, warn_of_stroke
from impact_gym.kernels import RECORD
from impact_gym.pack import indices
from impact_gym.parameters import SI, Options
from impact_gym.quantities import AFTER_ALARM, HORIZON, PAST_READINGS, QUANTITIES, SET_UP
from impact_gym.scene import Contact, Robot
from impact_gym.support.dotted_paths import get, grouped
from impact_gym.support.validation import Range, WrongTypeError, number, one_of, shown
from impact_gym.task.action import ActionSpec
from impact_gym.task.range_sensor import RangeSensor
from impact_gym.task.reach import reach, usual_horizon
from impact_gym.task.scenario import ScenarioRanges, ranged_record
from impact_gym.teleop.channels import WAYS, Channel
from impact_gym.teleop.link import Link
from impact_gym.teleop.operators import Operator

VELOCITY_RANGE = (-0.5, 1.5)  # m/s, default of the argument `velocity_range`
ACCELERATION_RANGE = (1.0, 20.0)  # m/s^2, default of the argument `acceleration_range`
MISSED_COST = 2.0  # m/s, default of the argument `missed_cost`
SETTLE_LIMIT = 10.0  # s, longest simulation after the end of an episode
MOST_STEPS = 2**53  # largest value of `max_episode_steps`
PLACES = indices(RECORD)
"""Index of each number of an episode, by id, in the compiled record RECORD."""
MOUNT_IDS = tuple(row.id for row in SET_UP if row.id.partition(".")[0] in ("tool_mass", "coupling", "robot"))

PARTS: Mapping[str, tuple[Any, ...]] = {
    "coupling": COUPLINGS, "robot": (Robot,), "range_sensor": (RangeSensor,),
    "operator": get_args(Operator), **dict.fromkeys(WAYS, (Channel,)),
}  # fmt: skip
"""The allowed classes of each argument, except `scenario`, that takes an object or a dict that describes the object."""


def argument(default: Any, words: str) -> Any:
    """Return a field of `Task`; `words` describes it in the documentation."""
    return field(default=default, metadata={"words": words})


@dataclass(frozen=True, kw_only=True)
class Task(Options):
    """The checked arguments of all environment classes.

    A number of the set-up may be a pair (low, high), from which each episode draws. Then `drawn` has the pair, and the
    field has the median. But the fields `time_weight` and `reaction_delay` keep a pair.
    """

    scenario: Any = argument("train", '"train", "test", "hard", a `ScenarioRanges` or a dict of ranges')
    coupling: Any = argument(SpringDamper(50.0, 1.0), "how the tool is mounted on the flange; or a dict")
    tool_mass: Any = argument(0.125, "")
    time_weight: Any = argument(2.0, "cost of a second of approach; a pair is a range for log-uniform draws")
    force_weight: Annotated[float, QUANTITIES["force_weight"]] = argument(0.0, "")
    reaction_delay: Any = argument(0.016, "delay from sensor to controller; a pair is a range for uniform draws")
    control_period: Annotated[float, QUANTITIES["control_period"]] = argument(0.016, "")
    velocity_range: Range = argument(VELOCITY_RANGE, "")
    acceleration_range: Range = argument(
        ACCELERATION_RANGE,
        "range of the second number of an action; after the episode the flange brakes at the range's upper end",
    )
    alarm: Literal["force", "reading"] = argument("force", 'or "reading": source of the alarm, see Observation Space')
    alarm_threshold: Any = argument(1.0, "")
    dissipation: Literal["hu-guo", "exact", "fixed"] = argument(
        "hu-guo", 'or "exact" or "fixed": how damping follows from restitution, see `Contact`'
    )
    reference_velocity: float | None = argument(None, 'm/s, velocity at which "fixed" gives the restitution; None: 1')
    friction: Any = argument(None, "coefficient of friction under the object; None: no friction")
    range_noise: Any = argument(None, "standard deviation of a distance estimate; None: no estimate")
    range_bias: Any = argument(0.0, "added to every distance estimate")
    observe_range_noise: bool = argument(False, "observe `range_noise`")
    range_sensor: Any = argument(None, "a `RangeSensor` on the tool, a dict, or a name in `impact_gym.sensors`")
    force_noise: Any = argument(0.0, "")
    force_bias: Any = argument(0.0, "")
    deflection_sensor: bool = argument(False, "observe how far the tool is displaced on its coupling")
    past_readings: Annotated[int, SI("-", at_least=0, at_most=PAST_READINGS)] = argument(
        0, f"number of earlier readings to observe, at most {PAST_READINGS}"
    )
    privileged: bool = argument(False, "also observe true values for a critic, see Observation Space")
    robot: Any = argument(None, "a compliant `Robot`, or a dict; None: a rigid one")
    rtol: Annotated[float, QUANTITIES["rtol"]] = argument(1e-8, "relative error allowed in a contact, see `simulate`")
    horizon: Annotated[float, QUANTITIES["horizon"]] = argument(
        None,
        "end of an episode without an alarm; None: time to the farthest object at 1/5 of the top speed, 1.2 or more",
    )
    after_alarm: Annotated[float, QUANTITIES["after_alarm"]] = argument(
        AFTER_ALARM, "from the alarm to the end of an episode"
    )
    missed_cost: Annotated[float, QUANTITIES["missed_cost"]] = argument(
        MISSED_COST, "cost of an object that was not touched"
    )
    force_limit: Annotated[float | None, QUANTITIES["force_limit"]] = argument(None, "")
    velocity_limit: Annotated[float | None, QUANTITIES["velocity_limit"]] = argument(None, "")
    operator: Any = argument(None, "operator, see `impact_gym.operators`, or a dict; None: the controller alone")
    uplink: Any = argument(None, "`Channel` of the operator's commands, or a dict; None: without delay or loss")
    downlink: Any = argument(None, "`Channel` of the operator's view, or a dict; None: without delay or loss")
    max_episode_steps: Annotated[int | None, SI("-", at_least=1, at_most=MOST_STEPS)] = argument(
        None, "control steps after which an episode is truncated"
    )

    drawn: Mapping[str, Range] = field(init=False, hash=False)  # ranges of the set-up's drawn numbers, by id
    link: Link | None = field(init=False, repr=False, compare=False, default=None)  # None: there is no operator
    _given: Mapping[str, Any] = field(init=False, repr=False, compare=False)

    def __new__(cls, **given: Any) -> Self:
        """Keep the arguments as given, for the method `arguments`."""
        self = super().__new__(cls)
        kept = {name: {**value} if isinstance(value, dict) else value for name, value in given.items()}
        if kept.get("horizon", 0.0) is None:
            del kept["horizon"]
        if isinstance(sensor := kept.get("range_sensor"), str):
            kept["range_sensor"] = sensors.named(sensor)
        self._put("_given", kept)
        return self

    def __post_init__(self) -> None:
        super().__post_init__()
        drawn: dict[str, Range] = {}  # `checked`: all arguments except those left at the default None
        checked = [name for name in ARGUMENTS if getattr(Task, name) is not None or getattr(self, name) is not None]
        self._put("scenario", ScenarioRanges.of(self.scenario))
        for name, kinds in PARTS.items():
            if name in checked:
                record, ranges = ranged_record(name, self._given.get(name, getattr(self, name)), kinds)
                self._put(name, record)
                drawn |= ranges
        for row in SET_UP:
            if row.id in checked:
                low, high = row.interval(getattr(self, row.id))
                self._put(row.id, row.middle(low, high))
                drawn |= {row.id: (low, high)} if low < high else {}
        for name in ("time_weight", "reaction_delay", "velocity_range", "acceleration_range"):
            low, high = QUANTITIES[name].interval(value := getattr(self, name))
            if low == high and name.endswith("_range"):
                unit = QUANTITIES[name].unit
                raise ValueError(f"{name} must be a pair (low, high) in {unit}, low below high, got {shown(value)}")
            self._put(name, low if low == high else (low, high))
        self._put("drawn", {row.id: drawn[row.id] for row in SET_UP if row.id in drawn})
        if self.velocity_range[1] <= 0.0:
            raise ValueError(f"velocity_range must end above 0 m/s, got {self.velocity_range}")
        if self.horizon is None:
            self._put("horizon", usual_horizon(self.scenario.distance[1], self.velocity_range[1]))
        self._check_choices()
        if self.operator is None and (self.uplink or self.downlink):
            raise ValueError("uplink and downlink must be None without an operator")
        if self.operator is not None:
            for way in WAYS:
                self._put(way, getattr(self, way) or Channel())
            uplink, downlink = (getattr(self, way).within(self.horizon, way) for way in WAYS)
            link = Link(self.operator, uplink, downlink, self.drawn)
            link.check(self.velocity_range, self.friction, self.horizon, self.control_period)
            self._put("link", link)
        self._check_reach()

    @classmethod
    def of(cls, field: str, given: Any, *others: str) -> "Task":
        """Return the task with the arguments `given`. If an argument is unknown, the error also lists `others`."""
        one_of(field, given, Mapping)
        if unknown := [name for name in given if name not in ARGUMENTS]:
            allowed = ", ".join([*others, *ARGUMENTS])
            raise WrongTypeError(
                f"{field} got an unexpected keyword argument {shown(unknown[0])}; allowed are {allowed}"
            )
        return cls(**given)

    @classmethod
    def of_file(cls, arguments: Mapping[str, Any]) -> Self:
        """Return the task whose method `arguments` gave `arguments`, for a file; without a horizon it is HORIZON."""
        return cls(**{**arguments, "horizon": arguments.get("horizon", HORIZON)})

    def arguments(self) -> dict[str, Any]:
        """Return the arguments as they were given, and the horizon: `Task(**task.arguments())` equals the task.

        A horizon of HORIZON is left out if it also follows from the other arguments, with and without the scenario.
        """
        distances = self.scenario.distance[1], ScenarioRanges.distance[1]
        followed = {usual_horizon(distance, self.velocity_range[1]) for distance in distances}
        left_out = ("horizon",) if {self.horizon, *followed} == {HORIZON} else ()
        given = {**self._given, "horizon": self._given.get("horizon", self.horizon)}
        return {name: value for name, value in given.items() if name not in left_out}

    def by_path(self) -> dict[str, Any]:
        """Return arguments except `scenario`, and their parts (`_parts`), by dotted path. A range stays as given."""
        values = {name: self._given.get(name, getattr(self, name)) for name in ARGUMENTS if name != "scenario"}
        parts = {name: self._parts(name) for name in PARTS if getattr(self, name) is not None}
        return values | {f"{name}.{part}": value for name, its in parts.items() for part, value in its.items()}

    def changed(self, by_path: Mapping[str, Any]) -> "Task":
        """Return a copy with the values in `by_path`; a path is an argument or a part, such as "coupling.stiffness".

        The horizon stays the same, unless `by_path` has another one; None: the one that follows from the new values.
        """
        arguments = {**self._given, "horizon": self._given.get("horizon", self.horizon)}
        for name, value in grouped(by_path).items():
            if name not in by_path:  # `by_path` has parts of this argument
                value = {"type": type(getattr(self, name)).__name__, **self._parts(name), **value}
            arguments[name] = value
        return Task(**arguments)

    def _parts(self, name: str) -> dict[str, Any]:
        """Return those fields of the argument `name`, such as a coupling, that are not None; ranges stay as given."""
        given = self._given.get(name)
        parts = asdict(getattr(self, name)) | (dict(given) if isinstance(given, Mapping) else {})
        return {part: value for part, value in parts.items() if part != "type" and value is not None}

    def _put(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def _check_choices(self) -> None:
        contact = Contact(1.0, 1.0, self.dissipation, reference_velocity=self.reference_velocity)
        self._put("reference_velocity", contact.reference_velocity)
        if self.deflection_sensor and self.coupling.fixed:
            raise ValueError("deflection_sensor must be False with a Rigid coupling, which has no deflection")
        if self.range_noise is None and (self.observe_range_noise or self.range_bias or "range_bias" in self.drawn):
            given = "range_bias must be 0 and observe_range_noise False"
            raise ValueError(f"{given} without an estimated distance (range_noise)")
        if self.range_sensor is not None:
            if self.range_noise is not None:
                raise ValueError(f"range_noise must be None with a range_sensor, got {self.range_noise:g} m")
            number("range_sensor.delay", self.longest("range_sensor.delay"), "s", at_most=self.horizon)

    def _check_reach(self) -> None:
        near, far = self.scenario.distance
        way = self.check_distance(near)
        if far > self.reach:
            warnings.warn(f"scenario.distance ends at {far:g} m, but {way}: farther objects are missed", stacklevel=3)
        if isinstance(self.coupling, SpringDamper):
            drawn = {name: self.drawn.get(f"coupling.{name}") for name in ("stiffness", "stroke")}
            lowest = {name: ends[0] for name, ends in drawn.items() if ends}
            warn_of_stroke(replace(self.coupling, **lowest), self.longest("tool_mass"), self.acceleration_range[1])

    def check_distance(self, near: float, field: str = "the smallest scenario.distance") -> str:
        """Raise ValueError if `near` (m) is out of reach; return the reach in words."""
        way = f"in {self.horizon:g} s (horizon) the flange moves at most {self.reach:.3g} m"
        if near > self.reach:
            raise ValueError(f"{field} must be at most {self.reach:.3g} m, got {near:g} m: {way}")
        return way

    @property
    def reach(self) -> float:
        """Largest distance that the flange covers in an episode without a touch, m."""
        return reach(self.velocity_range[1], self.acceleration_range[1], self.horizon)

    @property
    def ranges(self) -> dict[str, Range]:
        """The ranges of scenario, reaction delay, time weight and the numbers in `drawn`, by id; low can equal high."""
        pairs = {name: getattr(self, name) for name in ("time_weight", "reaction_delay")}
        always = {name: pair if isinstance(pair, tuple) else (pair, pair) for name, pair in pairs.items()}
        return self.scenario.by_id() | always | dict(self.drawn)

    def longest(self, path: str) -> float:
        """Return the largest value, in any episode, of the number at a dotted path."""
        return self.ranges[path][1] if path in self.ranges else float(get(self, path))

    def ends(self, argument: str) -> Range:
        """Return the ends of the scales that depend on the environment's `argument`."""
        if argument == "operator":
            return -0.25, 0.75 if self.operator is None else 1.75
        if argument == "horizon":
            return 0.0, max(1.25 * self.horizon, self.horizon + self.after_alarm)
        return (0.0, self.after_alarm) if argument == "after_alarm" else self.velocity_range

    def differs_in(self, other: "Task") -> list[str]:
        """Return the names of the arguments whose checked values differ from those of `other`."""
        names = {name for name in ARGUMENTS if getattr(self, name) != getattr(other, name)}
        drawn = {name for name in {*self.drawn, *other.drawn} if self.drawn.get(name) != other.drawn.get(name)}
        return sorted(names | {name.partition(".")[0] for name in drawn})

    @cached_property
    def action(self) -> ActionSpec:
        """The numbers of the action."""
        return ActionSpec(self.velocity_range, self.acceleration_range, operated=self.operator is not None)

    def at(self, record: Mapping[str, float]) -> "Task":
        """Return a task in which numbers of `record` (an `info["record"]`) replace the ranges in `drawn`."""
        return self.changed({name: float(record[name]) for name in self.drawn}) if self.drawn else self


ARGUMENTS = {item.name: item for item in fields(Task) if item.init}
