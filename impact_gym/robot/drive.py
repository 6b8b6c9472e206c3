"""What moves an arm's motors: commands along a line, and a sampled servo that follows them or not."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.linalg import expm

from impact_gym.motion import Motion, Trapezoid
from impact_gym.parameters import SI, Parameters
from impact_gym.robot.approach import Array

Command = tuple[float, float, float]
"""When (s), to which velocity (m/s) and with which acceleration (m/s^2); then it is held."""


@dataclass(frozen=True, slots=True)
class Reaction:
    """Commands, and others from an alarm on, which the contact force raises when it first exceeds a threshold."""

    before: tuple[Command, ...]
    after: tuple[Command, ...] = ()  # their times from the alarm on
    threshold: float = math.inf  # N
    delay: float = 0.0  # s, of the alarm


def reaction(motion: Trapezoid | Motion | Reaction) -> Reaction:
    """Return a motion as commands."""
    if isinstance(motion, Reaction):
        return motion
    if isinstance(motion, Motion):
        lasts, changes = np.diff(motion.times), np.abs(np.diff(motion.velocities))
        steps = zip(motion.times, motion.velocities[1:], np.maximum(changes / lasts, 1e-12).tolist(), strict=False)
        return Reaction(tuple(steps))
    before = ((0.0, motion.speed, motion.acceleration),)
    if motion.brake is None:
        return Reaction(before)
    return Reaction(before, ((0.0, 0.0, motion.deceleration),), motion.brake.threshold, motion.brake.delay)


class Path:
    """The commanded motion: pieces of constant acceleration, the last one held."""

    def __init__(self, commands: Reaction) -> None:
        self.commands, self.pieces = commands, [(0.0, 0.0, 0.0, 0.0)]
        for command in commands.before:
            self._obey(command)

    def at(self, t: float) -> tuple[float, float, float]:
        """Return position (m), velocity and acceleration."""
        begin, place, speed, rate = next(piece for piece in reversed(self.pieces) if piece[0] <= t)
        since = t - begin
        return place + (speed + 0.5 * rate * since) * since, speed + rate * since, rate

    def next_change(self, t: float) -> float:
        """Return when the acceleration changes next, s."""
        return min((piece[0] for piece in self.pieces if piece[0] > t), default=math.inf)

    def react(self, detection: float) -> None:
        """Go on with what follows an alarm, its cause having been felt at `detection` (s)."""
        for t, velocity, acceleration in self.commands.after:
            self._obey((detection + self.commands.delay + t, velocity, acceleration))

    def _obey(self, command: Command) -> None:
        t, velocity, acceleration = command
        place, speed, _ = self.at(t)
        lasts = abs(velocity - speed) / acceleration
        self.pieces = [piece for piece in self.pieces if piece[0] < t]
        if lasts > 0.0:
            self.pieces.append((t, place, speed, math.copysign(acceleration, velocity - speed)))
        self.pieces.append((t + lasts, place + 0.5 * (speed + velocity) * lasts, velocity, 0.0))


@dataclass(frozen=True, slots=True)
class Servo(Parameters):
    """Motors that follow the line by a sampled PD control of their own positions, the joints' torque fed forward."""

    frequency: Annotated[float, SI("rad/s", above=0)] = 300.0  # of the controlled rotor alone
    damping_ratio: Annotated[float, SI("-", above=0)] = 1.0
    period: Annotated[float, SI("s", at_least=1e-4, at_most=0.1)] = 1e-3  # between samples
    delay: Annotated[float, SI("s", at_least=0, at_most=0.1)] = 1e-3  # from a sample until its torque acts

    def __post_init__(self) -> None:
        Parameters.__post_init__(self)
        if not self.delay <= 20.0 * self.period:
            raise ValueError(f"Servo.delay must be at most 20 periods, {20 * self.period:g} s, got {self.delay:g} s")

    def growth(self, M: Array, stiffness: Array, damping: Array, rotors: Array) -> float:
        """Return the largest eigenvalue's size of the sampled loop around elastic joints at rest: stable below 1.

        Between samples the torques are held, so that matrix exponentials carry it exactly.
        """
        n, w, inverse = len(M), self.frequency, np.linalg.inv(M)
        unit, K, D, R, zero = np.eye(n), np.diag(stiffness), np.diag(damping), np.diag(1.0 / rotors), np.zeros((n, n))
        # of joints, their rates, motors, their rates, and the torques that are held
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
        late = int(self.delay / self.period + 1e-9)  # samples; of the last one a part of a period is left
        part = min(max(self.delay - late * self.period, 0.0), self.period)
        first, then = (expm(free * t) for t in (part, self.period - part))
        state = 4 * n
        loop = np.zeros((state + n * (late + 1),) * 2)  # then the torques asked for in the last samples
        loop[:state, :state] = (then @ first)[:state, :state]
        loop[:state, state + n * late :] += then[:state, :state] @ first[:state, state:]
        if late:
            loop[:state, state + n * (late - 1) : state + n * late] += then[:state, state:]
            loop[state + n :, state:-n] += np.eye(n * late)
        else:
            loop[:state, :state] += then[:state, state:] @ control
        loop[state : state + n, :state] = control
        return float(np.abs(np.linalg.eigvals(loop)).max())
