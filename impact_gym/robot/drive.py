"""The motion of an arm's motors: the commanded motion along a line, and a sampled servo that follows it."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from impact_gym.motion import Motion, Trapezoid
from impact_gym.parameters import SI, Parameters


class Path:
    """The commanded motion along the line; its velocity is linear between `times` (s), and the last one is held."""

    def __init__(self, motion: Trapezoid | Motion) -> None:
        self.threshold, self._motion = math.inf, motion  # N, force that triggers the brake
        if isinstance(motion, Motion):
            self._set(motion.times, motion.velocities)
            return
        self._set((0.0, motion.speed / motion.acceleration), (0.0, motion.speed))
        if motion.brake:
            self.threshold = motion.brake.threshold

    def _set(self, times: Sequence[float], velocities: Sequence[float]) -> None:
        self.times, self._velocities = [*times], [*velocities]
        steps, means = np.diff(times), (np.array(velocities[1:]) + velocities[:-1]) / 2.0
        self._places = [0.0, *np.cumsum(steps * means).tolist()]
        self._rates = [*(np.diff(velocities) / steps).tolist(), 0.0]

    def at(self, t: float) -> tuple[float, float, float]:
        """Return commanded position (m), velocity (m/s) and acceleration (m/s^2) at time `t` (s)."""
        k = bisect_right(self.times, t) - 1
        since, speed, rate = t - self.times[k], self._velocities[k], self._rates[k]
        return self._places[k] + (speed + 0.5 * rate * since) * since, speed + rate * since, rate

    def brake(self, detection: float) -> None:
        """Add the braking; it begins the brake's delay after `detection` (s), when the force exceeded the threshold."""
        assert isinstance(self._motion, Trapezoid)
        assert self._motion.brake
        t = detection + self._motion.brake.delay
        k, speed = bisect_left(self.times, t), self.at(t)[1]
        end = t + speed / self._motion.deceleration
        self._set([*self.times[:k], t, end], [*self._velocities[:k], speed, 0.0])


@dataclass(frozen=True, slots=True)
class Servo(Parameters):
    """A sampled PD control of the motors' positions, with the torques of the elastic joints as feedforward."""

    frequency: Annotated[float, SI("rad/s", above=0)] = 300.0  # natural frequency of a rotor without its link
    damping_ratio: Annotated[float, SI("-", above=0)] = 1.0
    period: Annotated[float, SI("s", at_least=1e-4, at_most=0.1)] = 1e-3  # between samples
    delay: Annotated[float, SI("s", at_least=0, at_most=0.1)] = 1e-3  # from a sample until its torque acts
