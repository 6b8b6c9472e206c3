"""The base class of most baselines, `Rule`. A rule computes commands from observations and a few parameters."""

import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.support.validation import Range, WrongTypeError, distinct, number
from impact_gym.task import ObservationSpec, ScenarioRanges, Task
from impact_gym.task.task import ACCELERATION_RANGE, VELOCITY_RANGE

Floats = NDArray[np.float64]

DISTANCES = ScenarioRanges().distance
"""Default range of the objects' distances, m. `Rule.placed` takes positions that are given for this range."""
LEAST_STRETCH = 0.01  # m; `Rule.placed` treats a smaller near end or width of a range of distances as this value
SLOWEST = 1e-9  # m/s; a rule divides by the operator's speed, or by this number if the speed is smaller
CLOCK = 1e-6  # s, tolerance in comparisons of observed times
USUAL: Mapping[str, Range] = {"m/s": VELOCITY_RANGE, "m/s^2": ACCELERATION_RANGE}
"""Default ranges of velocity and acceleration, by unit."""
ANY: Mapping[str, Range] = {"m/s": (-math.inf, math.inf), "m/s^2": (0.0, math.inf)}  # ranges without limits


class Parameter(NamedTuple):
    """One number of a rule."""

    name: str
    unit: str
    low: float
    high: float
    start: float  # value at which the search of `impact-gym tune` begins


def ranges_for(task: Task) -> dict[str, Range]:
    """Return the ranges of velocity and acceleration for a task's rules, by unit: USUAL, or wider for a faster arm."""
    both = zip(USUAL.items(), (task.velocity_range, task.acceleration_range), strict=True)
    return {unit: (min(low, least), max(high, most)) for (unit, (low, high)), (least, most) in both}


class View:
    """Observations, an array (..., n_obs).

    `view[id]` (...) is the number with this id, in SI units. Numbers in `own` replace observed ones or add to them.
    """

    def __init__(self, observation: ArrayLike, spec: ObservationSpec, **own: Floats) -> None:
        self.observation, self.spec, self._own = np.asarray(observation, np.float64), spec, own

    def __getitem__(self, name: str) -> Floats:
        return self._own[name] if name in self._own else self.spec.decode(self.observation, name)

    @property
    def alarm(self) -> NDArray[np.bool_]:
        """Whether the alarm is on."""
        return self["alarm"] > 0.5


RULES: dict[str, type["Rule"]] = {}
"""The rules that a set-up may tune, by the name of the class."""
FIXED: dict[str, Any] = {}
"""The classes of baselines without parameters to tune, by the name of the baseline."""


class Rule:
    """A controller with a few parameters, each within its limits."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = ()
    NEEDS: ClassVar[Mapping[str, Any]] = {}
    """Arguments of an environment that has all observations the rule needs."""
    KNOWS: ClassVar[tuple[str, ...]] = ()
    """Names of arguments whose values a tuned rule keeps from its tuning, see `agents.evaluate.specs.controller_of`."""
    AT_LIMITS: ClassVar[bool] = False
    """Whether `for_task` sets all parameters to their upper limits for the task's arm."""
    weights: Sequence[float] = ()
    """Time weights (m/s per s), ascending, for which the rows of `parameters` (weights, k) were tuned; see `at`."""

    def __init_subclass__(cls, tunable: bool = False, name: str = "") -> None:
        """Enter a `tunable` class into RULES, and a class with the `name` of a baseline into FIXED."""
        if tunable:
            RULES[cls.__name__] = cls
        if name:
            FIXED[name] = cls

    def __init__(self, parameters: ArrayLike, ranges: Mapping[str, Range] = USUAL) -> None:
        """Make a controller from `parameters` (k,) or (rows, k); TypeError, ValueError: invalid ones, see `limited`."""
        kind: Any = type(self)
        self.parameters = np.array(parameters, np.float64)
        if self.parameters.ndim not in (1, 2) or self.parameters.shape[-1] != len(self.names()):
            takes = f"{kind.__name__} needs an array (k,) or (rows, k), k = {len(self.names())}, for {self.names()}"
            raise WrongTypeError(f"{takes}, got an array of shape {self.parameters.shape}")
        for parameter, values in zip(self.limited(ranges), np.moveaxis(self.parameters, -1, 0), strict=True):
            for value in (values.min(), values.max()):
                number(parameter.name, value, parameter.unit, at_least=parameter.low, at_most=parameter.high)
        self.task = Task(**kind.NEEDS)
        self.spec = ObservationSpec(self.task)

    @classmethod
    def names(cls) -> list[str]:
        """Return the names of the parameters."""
        return [parameter.name for parameter in cls.PARAMETERS]

    @classmethod
    def of(cls, parameters: ArrayLike, ranges: Mapping[str, Range] = USUAL) -> Self:
        """Make a rule from `parameters`, even if the constructor of the class takes other arguments; see `limited`."""
        rule = cls.__new__(cls)
        Rule.__init__(rule, parameters, ranges)
        return rule

    @classmethod
    def limited(cls, ranges: Mapping[str, Range]) -> tuple[Parameter, ...]:
        """Return PARAMETERS; the ends of `ranges` replace the limits that are ends of the ranges USUAL."""
        moved = {(unit, end): new for unit in USUAL for end, new in zip(USUAL[unit], ranges[unit], strict=True)}
        limits = [[moved.get((each.unit, end), end) for end in (each.low, each.high)] for each in cls.PARAMETERS]
        pairs = zip(cls.PARAMETERS, limits, strict=True)
        return tuple(each._replace(low=low, high=high) for each, (low, high) in pairs)

    def at(self, time_weight: ArrayLike) -> Self:
        """Return the rule for a time weight (m/s per s), or for the time weight of each row of a batch.

        The parameters are interpolated over the logarithm of the weight. Below the first and above the last of
        `weights`, the parameters are constant. A rule without `weights` does not change.
        """
        twin = copy.copy(self)
        if self.weights:
            logarithms = np.log(time_weight), np.log(self.weights)
            twin.parameters = np.stack([np.interp(*logarithms, column) for column in self.parameters.T], axis=-1)
            twin.weights = ()
        return twin

    def for_task(self, task: Task) -> Self:
        """Return the same rule for a task; ValueError: see `check_observed`."""
        twin = copy.copy(self)
        twin.task = task.changed({"privileged": True}) if "privileged" in self.NEEDS else task
        twin.spec = ObservationSpec(twin.task)
        if self.AT_LIMITS:
            twin.parameters = np.array([each.high for each in self.limited(ranges_for(task))])
        self.check_observed(twin.spec)
        return twin

    @classmethod
    def check_observed(cls, observed: ObservationSpec) -> None:
        """Raise ValueError if an observation lacks a number that the rule needs."""
        if missing := [name for name in ObservationSpec(Task(**cls.NEEDS)).ids if name not in observed.ids]:
            arguments = ", ".join(f"{name} = {value}" for name, value in cls.NEEDS.items())
            what = f"{cls.__name__} needs {', '.join(missing)}"
            raise ValueError(f"{what}, which this environment does not observe: make it with, for example, {arguments}")

    def placed(self, position: Floats) -> Floats:
        """Map a position (m), given for objects in the range DISTANCES, to the task's range of distances."""
        (near, far), (low, high) = DISTANCES, self.task.scenario.distance
        if (low, high) == DISTANCES:
            return position
        low = max(low, LEAST_STRETCH)
        within = max(high - low, LEAST_STRETCH) / (far - near)
        return np.where(position < near, position * low / near, low + (position - near) * within)

    def __getitem__(self, name: str) -> Floats:
        return self.parameters[..., self.names().index(name)]

    def columns(self, first: str, count: int) -> Floats:
        """Return `count` successive parameters (..., count); the first of them has the name `first`."""
        place = self.names().index(first)
        return self.parameters[..., place : place + count]

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the action for an observation (n_obs,), or the actions for a batch (n, n_obs), and the next state."""
        view, state = self.see(View(observation, self.spec), state, episode_start)
        velocity, acceleration = self.command(view)
        if self.task.operator is None:
            return self.task.action.encode(velocity, acceleration), state
        # with an operator, the rule's velocity limits the operator's command; a velocity below 0 is a withdrawal
        velocity, fast = np.asarray(velocity), np.maximum(np.abs(view["command"]), SLOWEST)
        wanted = np.clip(velocity / fast, 0.0, 1.0), acceleration, np.maximum(-velocity, 0.0)
        return np.clip(self.task.action.encode(*wanted), -1.0, 1.0), state

    def see(self, view: View, state: Any, episode_start: Any) -> tuple[View, Any]:
        """Return the view that `command` gets, and the next state; a rule without memory changes neither."""
        return view, state

    def command(self, view: View) -> tuple[ArrayLike, ArrayLike]:
        """Return the commanded velocity (m/s) and the acceleration (m/s^2)."""
        raise NotImplementedError


def interpolate(knots: Floats, values: Floats, at: Floats) -> Floats:
    """Interpolate linearly at `at` (n,) between `values` (k,) or (n, k) at `knots` (k,); constant beyond the knots."""
    place = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    share = np.clip((at - knots[place]) / (knots[place + 1] - knots[place]), 0.0, 1.0)
    table = np.broadcast_to(values, (*np.shape(at), len(knots)))
    left, right = (np.take_along_axis(table, side[..., None], axis=-1)[..., 0] for side in (place, place + 1))
    return left + share * (right - left)


def tuned_rule(content: Mapping[str, Any]) -> Rule:
    """Return the rule from the content of a tuned baseline's file, with its parameters for all time weights."""
    if not content["weights"]:
        raise ValueError(f"the file of baseline {content['baseline']!r} has no time weight: run impact-gym tune")
    table, task = tuned_parameters(content), Task.of_file(content["environment"])
    rule = RULES[content["rule"]].of([*table.values()], ranges_for(task)).for_task(task)
    rule.weights = [*table]
    return rule


def tuned_parameters(content: Mapping[str, Any]) -> dict[float, list[float]]:
    """Return the parameters for each time weight (m/s per s), ascending; ValueError, LookupError: one is invalid.

    The order of the parameters in an entry of "weights" may differ from that in "parameters".
    """
    table = dict[float, list[float]]()
    distinct("weights", [*map(float, content["weights"])])
    for weight, found in content["weights"].items():
        row = [number(each["name"], found["parameters"][each["name"]], each["unit"], at_least=each["low"],
                      at_most=each["high"]) for each in content["parameters"]]  # fmt: skip
        table[number("each of weights", float(weight), "m/s per s", above=0)] = row
    return dict(sorted(table.items()))
