"""The base of all baselines: observations in SI units, and a rule with a few parameters that returns commands.

A rule has one set of parameters, or one for each row of a batch, so that one compiled batch plays many candidates.
"""

import copy
from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.task import ActionSpec, ObservationSpec, ScenarioRanges, Task
from impact_gym.validation import WrongTypeError, number

Floats = NDArray[np.float64]

CONTROL_PERIOD: float = Task.control_period  # s
DISTANCES = ScenarioRanges().distance
"""Default distances of objects, m, to which positions in rules refer."""
LEAST_STRETCH = 0.01  # m
SLOWEST = 1e-9  # m/s, least command that is divided by


class Parameter(NamedTuple):
    """One number of a rule."""

    name: str
    unit: str
    low: float
    high: float
    start: float  # where tuning begins


class View:
    """Observations (..., n_obs) in SI units, an array (...) for each number, computed on demand."""

    def __init__(self, observation: ArrayLike, spec: ObservationSpec) -> None:
        self.observation, self.spec = np.asarray(observation, np.float64), spec

    def __getitem__(self, name: str) -> Floats:
        """The number with this id, in its unit."""
        return self.spec.decode(self.observation, name)

    @property
    def alarm(self) -> NDArray[np.bool_]:
        """Whether the contact alarm has come."""
        return self["alarm"] > 0.5

    @property
    def time_since_alarm(self) -> Floats:
        """Time since then, s."""
        return self["time_since_alarm"]


@cache
def least_task(rule: Any) -> tuple[Task, ObservationSpec]:
    """Return the task with no more arguments than a rule needs, and its observation."""
    task = Task(**rule.NEEDS)
    return task, ObservationSpec(task)


class Rule:
    """A controller of a few numbers, each within its limits."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = ()
    NEEDS: ClassVar[Mapping[str, Any]] = {}  # arguments of the environment that add the observations it needs
    KNOWS: ClassVar[
        tuple[str, ...]
    ] = ()  # arguments that it was tuned for and relies on, whatever they are where it plays

    def __init__(self, parameters: ArrayLike) -> None:
        """Make a controller.

        Args:
            parameters: (k,), in the order and units of PARAMETERS; or (rows, k), for batches of so many rows.

        Raises:
            ValueError: another number of them, or one out of its limits; names it.
        """
        kind: Any = type(self)
        self.parameters = np.array(parameters, np.float64)
        if self.parameters.ndim not in (1, 2) or self.parameters.shape[-1] != len(self.names()):
            raise WrongTypeError(f"{kind.__name__} has the parameters {self.names()}, got {self.parameters.shape}")
        for parameter, values in zip(self.PARAMETERS, np.moveaxis(self.parameters, -1, 0), strict=True):
            for value in (values.min(), values.max()):
                number(parameter.name, value, parameter.unit, at_least=parameter.low, at_most=parameter.high)
        self.task, self.spec = least_task(kind)

    @classmethod
    def names(cls) -> list[str]:
        """Return the names of its parameters."""
        return [parameter.name for parameter in cls.PARAMETERS]

    @classmethod
    def of(cls, parameters: ArrayLike) -> "Rule":
        """Return the rule with `parameters`, also where its constructor takes others."""
        return cls(parameters)

    def for_environment(self, arguments: Mapping[str, Any]) -> Self:
        """Return the same rule for an environment of `gym.make` with these arguments, such as `env.spec.kwargs`."""
        apart = ("render_mode", "record_trace")  # they change nothing of the task
        return self.for_task(Task(**{name: value for name, value in arguments.items() if name not in apart}))

    def for_task(self, task: Task) -> Self:
        """Return the same rule for a task; positions are `placed` where its objects stand.

        Raises:
            ValueError: the task's observation lacks a number that the rule needs.
        """
        kind: Any = type(self)
        twin = copy.copy(self)
        twin.task = task.changed({"privileged": True}) if "privileged" in self.NEEDS else task
        twin.spec = ObservationSpec(twin.task)
        if missing := [name for name in least_task(kind)[1].ids if name not in twin.spec]:
            arguments = ", ".join(f"{name} = {value}" for name, value in self.NEEDS.items())
            what = f"{kind.__name__} looks at {', '.join(missing)}"
            raise ValueError(f"{what}, which this environment does not show: it needs arguments like {arguments}")
        return twin

    def placed(self, position: Floats) -> Floats:
        """Return a position (m) of the rule for this task: DISTANCES are mapped to those of its objects."""
        (near, far), (low, high) = DISTANCES, self.task.scenario.distance
        if (low, high) == DISTANCES:
            return position
        low = max(low, LEAST_STRETCH)
        within = max(high - low, LEAST_STRETCH) / (far - near)
        return np.where(position < near, position * low / near, low + (position - near) * within)

    def __getitem__(self, name: str) -> Floats:
        """A parameter by its name."""
        return self.parameters[..., self.names().index(name)]

    def columns(self, first: str, count: int) -> Floats:
        """Return `count` parameters (..., count) from the one named `first` on."""
        place = self.names().index(first)
        return self.parameters[..., place : place + count]

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the action for an observation (n_obs,) or the actions for a batch of them (n, n_obs), and a state."""
        view, state = self.see(View(observation, self.spec), state, episode_start)
        velocity, acceleration = self.command(view)
        if self.task.operator is None:
            return ActionSpec(self.task).encode(velocity, acceleration), state
        return self._assist(view["command"], np.asarray(velocity), acceleration), state

    def _assist(self, command: Floats, velocity: Floats, acceleration: ArrayLike) -> NDArray[np.float32]:
        """Return the action (..., 3) that lets an operator's `command` (m/s) be no faster than the rule's `velocity`.

        So every rule is an assistance: its own velocity is the limit, and below 0 it becomes a withdrawal.
        """
        fast = np.maximum(np.abs(command), SLOWEST)
        wanted = np.clip(velocity / fast, 0.0, 1.0), acceleration, np.maximum(-velocity, 0.0)
        return np.clip(ActionSpec(self.task).encode(*wanted), -1.0, 1.0)

    def see(self, view: View, state: Any, episode_start: Any) -> tuple[View, Any]:
        """Return the view for `command`, and the next state; a rule without memory returns both unchanged."""
        return view, state

    def command(self, view: View) -> tuple[ArrayLike, ArrayLike]:
        """Return the velocity (m/s) to go to and the acceleration (m/s^2) to use for it."""
        raise NotImplementedError


def interpolate(knots: Floats, values: Floats, at: Floats) -> Floats:
    """Return the broken line through `values` (k,) or (n, k) over `knots` (k,), at `at` (n,); level beyond its ends."""
    place = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(knots) - 2)
    share = np.clip((at - knots[place]) / (knots[place + 1] - knots[place]), 0.0, 1.0)
    table = np.broadcast_to(values, (*np.shape(at), len(knots)))
    left, right = (np.take_along_axis(table, side[..., None], axis=-1)[..., 0] for side in (place, place + 1))
    return left + share * (right - left)
