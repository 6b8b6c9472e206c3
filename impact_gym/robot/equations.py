"""The equations of motion of an arm's joints and motors, a tool and an object; see `all_joints.simulate`."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import fsolve

from impact_gym.motion import Motion, Trapezoid
from impact_gym.parameters import SI, Parameters
from impact_gym.robot.arm import Arm
from impact_gym.robot.line_table import Array, LineTable
from impact_gym.scene import Scene

LOST = 0.05  # rad or m; if a motor deviates from its command by this or more, the run ends
MOST_EVALUATIONS = 400_000  # default limit on evaluations of the equations in a run; 400,000 take about 15 s
STIFF = 1e5  # 1/s; if the joints' fastest mode has a higher rate, a run without a servo uses the implicit method Radau


class Path:
    """The commanded motion along the line; velocity is linear between `times` (s), then constant."""

    def __init__(self, motion: Trapezoid | Motion) -> None:
        self.threshold = math.inf  # N, contact force that triggers the brake
        if isinstance(motion, Motion):
            self._set(motion.times, motion.velocities)
            return
        self._set((0.0, motion.speed / motion.acceleration), (0.0, motion.speed))
        if motion.brake:
            self.threshold, self._delay = motion.brake.threshold, motion.brake.delay
            self._deceleration = motion.deceleration

    def _set(self, times: Sequence[float], velocities: Sequence[float]) -> None:
        self.times, self._velocities = [*times], [*velocities]
        steps, means = np.diff(times), (np.array(velocities[1:]) + velocities[:-1]) / 2.0
        self._positions = [0.0, *np.cumsum(steps * means).tolist()]
        self._rates = [*(np.diff(velocities) / steps).tolist(), 0.0]

    def at(self, t: float) -> tuple[float, float, float]:
        """Return commanded position (m), velocity (m/s) and acceleration (m/s^2) at time `t` (s)."""
        k = bisect_right(self.times, t) - 1
        since, speed, rate = t - self.times[k], self._velocities[k], self._rates[k]
        return self._positions[k] + (speed + 0.5 * rate * since) * since, speed + rate * since, rate

    def brake(self, detection: float) -> None:
        """Brake to rest from one delay after `detection` (s), the time when the force first exceeds the threshold."""
        t = detection + self._delay
        k, speed = bisect_left(self.times, t), self.at(t)[1]
        self._set([*self.times[:k], t, t + speed / self._deceleration], [*self._velocities[:k], speed, 0.0])
        self.threshold = math.inf


@dataclass(frozen=True, slots=True)
class Servo(Parameters):
    """A sampled PD control of motor positions, with feedforward of acceleration and compensation of joint torques."""

    frequency: Annotated[float, SI("rad/s", above=0)] = 300.0  # natural frequency of a controlled rotor without link
    damping_ratio: Annotated[float, SI("-", above=0)] = 1.0
    period: Annotated[float, SI("s", at_least=1e-4, at_most=0.1)] = 1e-3  # time between samples
    delay: Annotated[float, SI("s", at_least=0, at_most=0.1)] = 1e-3  # time from a sample until its torque acts


class Unfinished(Exception):  # noqa: N818 a status, not an error
    """Raised if a run must end early; the message says why."""


class Equations:
    """The equations of motion.

    The state: joint angles and rates; with a servo, motor angles and rates; position and velocity of the tool, then of
    the object; impulse on the object.
    """

    def __init__(
        self, arm: Arm, line: LineTable, scene: Scene, path: Path, gravity: bool, servo: Servo | None,
        most_evaluations: int,
    ) -> None:  # fmt: skip
        self.rigid, self.m_t, self.m_p = scene.coupling.fixed, scene.tool.mass, scene.object.mass
        self.arm = arm.moving(self.m_t if self.rigid else 0.0, gravity)
        self.scene, self.path, self.servo, self.n = scene, path, servo, arm.count
        self.motors = CubicSpline(line.position, line.joint_angles)
        self.slopes, self.bend = self.motors.derivative(), self.motors.derivative(2)
        self.start, self.u, self.end = line.start, line.direction, float(line.position[-1])
        inverse, unit = np.linalg.inv(self.arm.mass_matrix(self.motors(scene.object.distance))), np.eye(self.n)
        modes = np.linalg.eigvals(np.block([[0.0 * unit, unit], [-inverse * arm.stiffness, -inverse * arm.damping]]))
        self.stiff = bool(np.abs(modes).max() > STIFF)
        self.damping = 0.0  # N s/m^(1 + n), hysteresis damping chi of the present contact, see `scene.Contact`
        self.evaluations, self.most_evaluations = 0, most_evaluations
        q = q_m = self.motors(0.0)

        def unbalanced(q: Array) -> Array:
            self.arm.move(q, 0.0 * q)
            return self.arm.accelerations(arm.stiffness * (q_m - q))

        if gravity:
            q = fsolve(unbalanced, q_m)
        self.torque = arm.stiffness * (q_m - q)  # the motors' present torques, used only with a servo
        motors = [q_m, np.zeros(self.n)] if servo else []
        tool = float(self.u @ (self.arm.flange(q)[0] - self.start))
        self.first = np.concatenate([q, np.zeros(self.n), *motors, [tool, 0.0, scene.object.distance, 0.0, 0.0]])

    def driven(self, t: float, y: Array) -> tuple[Array, Array]:
        """Return angles and rates of the motors."""
        if self.servo:
            return y[2 * self.n : 3 * self.n], y[3 * self.n : 4 * self.n]
        s, rate, _ = self.path.at(t)
        return self.motors(s), self.slopes(s) * rate

    def sample(self, t: float, y: Array) -> Array:
        """Return the motor torques that the servo computes at time `t` (s) from the state `y`."""
        assert self.servo is not None
        (s, rate, rise), (q_m, v_m) = self.path.at(t), self.driven(t, y)
        off = self.motors(s) - q_m
        if not (most := np.abs(off).max()) < LOST:
            raise Unfinished(f"the servo does not hold the arm on its line: a motor is {most:.3g} rad or m off")
        w, wanted = self.servo.frequency, self.slopes(s) * rise + self.bend(s) * rate * rate
        follow = w * w * off + 2.0 * self.servo.damping_ratio * w * (self.slopes(s) * rate - v_m)
        held = self.arm.stiffness * (q_m - y[: self.n]) + self.arm.damping * (v_m - y[self.n : 2 * self.n])
        return np.asarray(self.arm.rotors * (wanted + follow) + held)

    def contact(self, depth: float, rate: float) -> float:
        """Return the force of the contact law, N; it is negative where the law would pull."""
        law, depth = self.scene.contact, max(depth, 0.0)
        return float(law.stiffness * depth**law.stiffness_exponent + self.damping * depth**law.damping_exponent * rate)

    def flange(self, y: Array) -> tuple[float, float, Array]:
        """Return position and velocity of the flange along the line, and d(velocity) / d(joint rates)."""
        position, J = self.arm.move(y[: self.n], y[self.n : 2 * self.n])
        row = self.u @ J
        return float(self.u @ (position - self.start)), float(row @ y[self.n : 2 * self.n]), row

    def rates(self, t: float, y: Array, touching: bool) -> Array:
        """Return the time derivative of the state."""
        self.evaluations += 1
        if self.evaluations > self.most_evaluations:
            raise Unfinished(f"more than {self.most_evaluations} evaluations of the equations")
        n, out = self.n, np.empty_like(y)
        position, speed, row = self.flange(y)
        tool, v_t, x, v_p = (position, speed, y[-3], y[-2]) if self.rigid else y[-5:-1]
        force = max(self.contact(tool - x, v_t - v_p), 0.0) if touching else 0.0
        pulled = force if self.rigid else self.scene.coupling.pull(tool - position, v_t - speed, self.m_t)
        (q, v), (q_m, v_m) = (y[:n], y[n : 2 * n]), self.driven(t, y)
        yielded = self.arm.stiffness * (q_m - q) + self.arm.damping * (v_m - v)
        out[:n], out[n : 2 * n] = v, self.arm.accelerations(yielded - row * pulled)
        if self.servo:
            out[2 * n : 3 * n] = v_m
            out[3 * n : 4 * n] = (self.torque - yielded) / self.arm.rotors
        out[-5:] = v_t, 0.0 if self.rigid else (pulled - force) / self.m_t, v_p, force / self.m_p, force
        return out

    def penetration(self, y: Array) -> tuple[float, float]:
        """Return the penetration, m, and its rate, m/s."""
        tool, v_t = self.flange(y)[:2] if self.rigid else y[-5:-3]
        return float(tool - y[-3]), float(v_t - y[-2])

    def piece(self, t: float, until: float, y: Array, touching: bool, rtol: float) -> Any:
        """Integrate to `until` (s) or the first event: touch, parting, an end of the line, force above threshold."""
        events: list[Any] = [
            lambda _, y: self.penetration(y)[0],
            lambda t, _: min((s := self.path.at(t)[0]) + 1e-9, self.end - s),
            lambda _, y: self.contact(*self.penetration(y)) - self.path.threshold,
        ][: 3 if touching and self.path.threshold < math.inf else 2]
        for event, direction in zip(events, (-1.0 if touching else 1.0, -1.0, 1.0), strict=False):
            event.terminal, event.direction = True, direction
        longest, law = until - t, self.scene.contact
        if touching:
            mass, closing = 1.0 / (1.0 / self.m_t + 1.0 / self.m_p), max(abs(self.penetration(y)[1]), 1e-3)
            depth = (mass * closing**2 / law.stiffness) ** (1.0 / (law.stiffness_exponent + 1.0))
            longest = min(longest, depth / closing)
        elif not self.rigid:
            longest = min(longest, 2.0 * self.scene.coupling.stop_time(self.m_t))
        # LSODA restarts too slowly at each sample of a servo, and oscillates if the joints are stiff
        method = "DOP853" if self.servo else "Radau" if self.stiff else "LSODA"
        return solve_ivp(
            lambda t, y: self.rates(t, y, touching), (t, until), y, method, events=events, rtol=rtol,
            atol=max(1e-2 * rtol, 1e-10 if self.stiff else 0.0), max_step=max(longest, 1e-9), dense_output=touching,
        )  # fmt: skip
