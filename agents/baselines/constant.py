"""Baselines without a speed profile."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.baselines.rule import FIXED, SLOWEST, Parameter, Rule, View
from impact_gym.task import Task
from impact_gym.task.task import ACCELERATION_RANGE, VELOCITY_RANGE


class ConstantSpeed(Rule, tunable=True):
    """Approach at one speed; while the alarm is on, brake to rest."""

    PARAMETERS = (
        Parameter("speed", "m/s", 1e-3, VELOCITY_RANGE[1], 1.0),
        Parameter("acceleration", "m/s^2", *ACCELERATION_RANGE, 8.0),
        Parameter("deceleration", "m/s^2", *ACCELERATION_RANGE, 8.0),
    )

    def __init__(self, speed: ArrayLike, acceleration: ArrayLike = 8.0, deceleration: ArrayLike | None = None) -> None:
        """Make a controller from numbers, or from arrays with a number for each row of a batch.

        Args:
            speed: m/s, 0.001 to 1.5.
            acceleration: m/s^2, 1 to 20.
            deceleration: m/s^2, 1 to 20; None: `acceleration`.
        """
        braking = acceleration if deceleration is None else deceleration
        super().__init__(np.stack(np.broadcast_arrays(speed, acceleration, braking), axis=-1))

    def command(self, view: View) -> tuple[ArrayLike, ArrayLike]:
        """Return the commanded velocity (m/s) and the acceleration (m/s^2)."""
        change = np.where(view.alarm, self["deceleration"], self["acceleration"])
        return np.where(view.alarm, 0.0, self["speed"]), change


class ThresholdBrake(Rule, tunable=True):
    """Approach at one speed; once a sensed force has exceeded a threshold, brake to rest."""

    PARAMETERS = (*ConstantSpeed.PARAMETERS, Parameter("threshold", "N", 0.1, 100.0, 2.0))

    def command(self, view: View) -> tuple[ArrayLike, ArrayLike]:
        """Return the commanded velocity (m/s) and the acceleration (m/s^2)."""
        touched = view["force_peak"] > self["threshold"]
        change = np.where(touched, self["deceleration"], self["acceleration"])
        return np.where(touched, 0.0, self["speed"]), change


class PaperTrapezoid(ConstantSpeed, name="paper-trapezoid"):
    """The paper's rule (section 3.2): accelerate at 8 m/s^2 to 1 m/s; during the alarm, brake at 8 m/s^2 to rest."""

    def __init__(self) -> None:
        super().__init__(speed=1.0, acceleration=8.0)


class LocalBrake(ConstantSpeed, name="local-brake"):
    """Follow the operator's command; while the alarm is on, brake to rest at the arm's largest deceleration."""

    AT_LIMITS = True

    def __init__(self) -> None:
        super().__init__(VELOCITY_RANGE[1], ACCELERATION_RANGE[1])


class OperatorAlone(Rule, name="operator-alone"):
    """Follow the operator's command with a gain of 1."""

    AT_LIMITS = True
    NEEDS: ClassVar[Mapping[str, Any]] = {
        "operator": {"type": "Trapezoid"}, "velocity_range": (-0.3, 0.5), "horizon": 8.0, "friction": 0.3,
    }  # fmt: skip
    PARAMETERS = (
        Parameter("gain", "-", 0.05, 1.0, 0.7),
        Parameter("acceleration", "m/s^2", *ACCELERATION_RANGE, ACCELERATION_RANGE[1]),
    )

    def __init__(self) -> None:
        super().__init__([1.0, ACCELERATION_RANGE[1]])

    def command(self, view: View) -> tuple[ArrayLike, ArrayLike]:
        """Return the gain times the operator's speed (m/s), and the acceleration (m/s^2)."""
        return self["gain"] * np.maximum(np.abs(view["command"]), SLOWEST), self["acceleration"]


class RandomActions:
    """Draw every action uniformly from the action space of a task."""

    def __init__(self, seed: int = 0, task: Task | None = None) -> None:
        """Make a controller; default `task`: that of `ImpactApproach-v0`."""
        self._seed, self._rng, self._size = seed, np.random.default_rng(seed), len((task or Task()).action)

    def for_task(self, task: Task) -> "RandomActions":
        """Return a controller for another task, from the same seed."""
        return RandomActions(self._seed, task)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Return an action (k,), or the actions (n, k) of a batch, and `state`."""
        return self._rng.uniform(-1.0, 1.0, (*np.shape(observation)[:-1], self._size)).astype(np.float32), state


FIXED["random"] = RandomActions
