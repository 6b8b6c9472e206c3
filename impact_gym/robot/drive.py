"""The motion of an arm's motors: the commanded motion along a line, and a sampled servo that follows it."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.linalg import expm

from impact_gym.motion import Motion, Trapezoid
from impact_gym.parameters import SI, Parameters
from impact_gym.robot.approach import Array


class Path:
    """The commanded motion along the line: pieces of constant acceleration; the last piece never ends."""

    def __init__(self, motion: Trapezoid | Motion) -> None:
        self.pieces = [(0.0, 0.0, 0.0, 0.0)]  # of each piece at its start: time (s), position, velocity, acceleration
        self._motion, self.threshold = motion, math.inf  # N, force that triggers the brake
        if isinstance(motion, Trapezoid):
            self._change(0.0, motion.speed, motion.acceleration)
            self.threshold = math.inf if motion.brake is None else motion.brake.threshold
            return
        for t, end, velocity in zip(motion.times, motion.times[1:], motion.velocities[1:], strict=False):
            self._change(t, velocity, max(abs(velocity - self.at(t)[1]) / (end - t), 1e-12))

    def at(self, t: float) -> tuple[float, float, float]:
        """Return commanded position (m), velocity (m/s) and acceleration (m/s^2) at time `t` (s)."""
        begin, place, speed, rate = next(piece for piece in reversed(self.pieces) if piece[0] <= t)
        since = t - begin
        return place + (speed + 0.5 * rate * since) * since, speed + rate * since, rate

    def brake(self, detection: float) -> None:
        """Add the braking; it begins the brake's delay after `detection` (s), when the force exceeded the threshold."""
        assert isinstance(self._motion, Trapezoid)
        assert self._motion.brake is not None
        self._change(detection + self._motion.brake.delay, 0.0, self._motion.deceleration)

    def _change(self, t: float, velocity: float, acceleration: float) -> None:
        """From `t` (s) on, go to `velocity` (m/s) with `acceleration` (m/s^2), then keep it."""
        place, speed, _ = self.at(t)
        duration = abs(velocity - speed) / acceleration
        self.pieces = [piece for piece in self.pieces if piece[0] < t]
        if duration > 0.0:
            self.pieces.append((t, place, speed, math.copysign(acceleration, velocity - speed)))
        self.pieces.append((t + duration, place + 0.5 * (speed + velocity) * duration, velocity, 0.0))


@dataclass(frozen=True, slots=True)
class Servo(Parameters):
    """A sampled PD control of the motors' positions, with the torques of the elastic joints as feedforward."""

    frequency: Annotated[float, SI("rad/s", above=0)] = (
        300.0  # natural frequency of a controlled rotor without its link
    )
    damping_ratio: Annotated[float, SI("-", above=0)] = 1.0
    period: Annotated[float, SI("s", at_least=1e-4, at_most=0.1)] = 1e-3  # between samples
    delay: Annotated[float, SI("s", at_least=0, at_most=0.1)] = 1e-3  # from a sample until its torque acts

    def __post_init__(self) -> None:
        Parameters.__post_init__(self)
        if not self.delay <= 20.0 * self.period:
            raise ValueError(f"Servo.delay must be at most 20 periods, {20 * self.period:g} s, got {self.delay:g} s")

    def growth(self, M: Array, stiffness: Array, damping: Array, rotors: Array) -> float:
        """Return the spectral radius of the sampled loop with elastic joints at rest; below 1 the loop is stable.

        The torques are constant between samples, so the loop is computed exactly by matrix exponentials.
        """
        n, w, inverse = len(M), self.frequency, np.linalg.inv(M)
        unit, K, D, R, zero = np.eye(n), np.diag(stiffness), np.diag(damping), np.diag(1.0 / rotors), np.zeros((n, n))
        # rows: time derivatives of joints, joint rates, motors, motor rates, and torques (0 between samples)
        free = np.block([
            [zero, unit, zero, zero, zero],
            [-inverse @ K, -inverse @ D, inverse @ K, inverse @ D, zero],
            [zero, zero, zero, unit, zero],
            [R @ K, R @ D, -R @ K, -R @ D, R],
            [np.zeros((n, 5 * n))],
        ])  # fmt: skip
        control = np.hstack([
            -K, -D, K - np.diag(rotors) * w * w, D - np.diag(rotors) * 2.0 * self.damping_ratio * w
        ])  # fmt: skip
        late = int(self.delay / self.period + 1e-9)  # number of whole periods in the delay; the rest is `part`
        part = min(max(self.delay - late * self.period, 0.0), self.period)
        first, then = (expm(free * t) for t in (part, self.period - part))
        state = 4 * n
        loop = np.zeros((state + n * (late + 1),) * 2)  # acts on the state, followed by the torques of the last samples
        loop[:state, :state] = (then @ first)[:state, :state]
        loop[:state, state + n * late :] += then[:state, :state] @ first[:state, state:]
        if late:
            loop[:state, state + n * (late - 1) : state + n * late] += then[:state, state:]
            loop[state + n :, state:-n] += np.eye(n * late)
        else:
            loop[:state, :state] += then[:state, state:] @ control
        loop[state : state + n, :state] = control
        return float(np.abs(np.linalg.eigvals(loop)).max())
