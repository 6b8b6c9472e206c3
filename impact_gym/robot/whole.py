"""All joints of an arm at once: the reference that the table of an `Approach` is held against (paper, eq. 10).

    M(q) q'' + c(q, q') = D (q_m' - q') + K (q_m - q) - J' F

with elastic joints between the motors at q_m, which follow the line exactly or by a servo, and the links at q. Tool
and object move along the line, the contact's law is the scene's. MuJoCo gives M, J and the bias c; SciPy integrates;
neither contact nor integrator of MuJoCo's is used, nor the compiled solver of this package.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import fsolve

from impact_gym.motion import Motion, Trapezoid
from impact_gym.physics.dissipation import damping_factor
from impact_gym.record import SI, Record
from impact_gym.robot.approach import Approach
from impact_gym.robot.arm import Arm, Array
from impact_gym.scene import Bistable, Rigid, Scene, SpringDamper
from impact_gym.validation import number, one_of

LOST = 1.0  # rad or m, of a motor off its line: the servo does not hold it
MOST_CONTACTS = 200


@dataclass(frozen=True, slots=True)
class Servo(Record):
    """Motors that follow the line by a sampled PD control of their own positions, a sample late."""

    frequency: Annotated[float, SI("rad/s", above=0)] = 300.0  # of the controlled rotor alone
    damping_ratio: Annotated[float, SI("-", above=0)] = 1.0
    period: Annotated[float, SI("s", at_least=1e-4, at_most=0.1)] = 1e-3  # between samples


@dataclass(frozen=True)
class Blow:
    """What came of an approach of the whole arm."""

    object_velocity: float  # m/s, V_p
    touch_time: float  # s, of the first touch; nan if there is none
    impact_velocity: float  # m/s, of the tool at it
    peak_force: float  # N
    contact_time: float  # s, of the first contact
    impulse: float  # N s, on the object
    contact_count: int
    sideways: float  # m, of the flange from the line, the largest while something touches
    turn: float  # rad, of the flange since the first touch, likewise
    status: str  # "ok", or why it ends before its time


Command = tuple[float, float, float]
"""When (s), to which velocity (m/s) and with which acceleration (m/s^2); then it is held."""


@dataclass(frozen=True, slots=True)
class Reaction:
    """Commands, and others from an alarm on, which the contact force raises when it first exceeds a threshold."""

    before: tuple[Command, ...]
    after: tuple[Command, ...] = ()  # their times from the alarm on
    threshold: float = math.inf  # N
    delay: float = 0.0  # s, of the alarm


def _reaction(motion: Trapezoid | Motion | Reaction) -> Reaction:
    """Return a motion as commands."""
    if isinstance(motion, Reaction):
        return motion
    if isinstance(motion, Motion):
        steps = zip(
            motion.times[:-1], np.diff(motion.times), motion.velocities[1:], np.diff(motion.velocities), strict=True
        )
        return Reaction(tuple((t, to, max(abs(change) / lasts, 1e-12)) for t, lasts, to, change in steps))
    before = ((0.0, motion.speed, motion.acceleration),)
    if motion.brake is None:
        return Reaction(before)
    return Reaction(before, ((0.0, 0.0, motion.deceleration),), motion.brake.threshold, motion.brake.delay)


class _Path:
    """The commanded motion: pieces of constant acceleration, the last one held."""

    def __init__(self, reaction: Reaction) -> None:
        self.reaction, self.pieces = reaction, [(0.0, 0.0, 0.0, 0.0)]
        for command in reaction.before:
            self._obey(command)

    def at(self, t: float) -> Command:
        """Return position (m), velocity and acceleration."""
        begin, place, speed, rate = next(piece for piece in reversed(self.pieces) if piece[0] <= t)
        since = t - begin
        return place + (speed + 0.5 * rate * since) * since, speed + rate * since, rate

    def next_change(self, t: float) -> float:
        """Return when the acceleration changes next, s."""
        return min((piece[0] for piece in self.pieces if piece[0] > t), default=math.inf)

    def react(self, detection: float) -> None:
        """Go on with what follows an alarm, its cause having been felt at `detection` (s)."""
        for t, velocity, acceleration in self.reaction.after:
            self._obey((detection + self.reaction.delay + t, velocity, acceleration))

    def _obey(self, command: Command) -> None:
        t, velocity, acceleration = command
        place, speed, _ = self.at(t)
        lasts = abs(velocity - speed) / acceleration
        self.pieces = [piece for piece in self.pieces if piece[0] < t]
        if lasts > 0.0:
            self.pieces.append((t, place, speed, math.copysign(acceleration, velocity - speed)))
        self.pieces.append((t + lasts, place + 0.5 * (speed + velocity) * lasts, velocity, 0.0))


class _Whole:
    """The equations. The state is q, q', with a servo the motors' angles and rates, then tool and object."""

    def __init__(
        self, arm: Arm, approach: Approach, scene: Scene, path: _Path, coriolis: bool, gravity: bool, linear: bool,
        servo: Servo | None,
    ) -> None:  # fmt: skip
        self.rigid, self.m_t, self.m_p = isinstance(scene.coupling, Rigid), scene.tool.mass, scene.object.mass
        self.arm = arm.with_load(self.m_t) if self.rigid else arm
        self.scene, self.path, self.n = scene, path, arm.count
        self.coriolis, self.gravity, self.servo, self.linear = coriolis, gravity, servo, linear
        self.motors = CubicSpline(approach.travel, approach.joint_angles)
        self.slopes = self.motors.derivative()
        self.start, self.u = approach.start, approach.direction
        self.slope_at_impact = self.slopes(approach.impact_travel)
        self.frozen = self.arm.dynamics(approach.joint_angles[approach.impact_row], np.zeros(self.n), False, False)
        self.bend = self.slopes.derivative()
        self.torque = np.zeros(self.n)  # of the motors, held for a sample
        self.damping = 0.0  # chi of the contact that goes on, N s/m^(1 + n)

    def begin(self, distance: float) -> Array:
        """Return the state at rest, in equilibrium."""
        q_m = self.motors(0.0)
        q = q_m
        if self.linear:
            q = np.zeros(self.n)
        elif self.gravity:
            q = fsolve(lambda q: self.arm.dynamics(q, q * 0.0, False, True)[3] - self.arm.stiffness * (q_m - q), q_m)
        motors = np.concatenate([q_m, np.zeros(self.n)]) if self.servo else np.empty(0)
        place = 0.0 if self.linear else float(self.u @ (self.arm.flange(q)[0] - self.start))
        return np.concatenate([q, np.zeros(self.n), motors, [place, 0.0, distance, 0.0, 0.0]])

    def driven(self, t: float, y: Array) -> tuple[Array, Array]:
        """Return angles and rates of the motors."""
        if self.servo:
            return y[2 * self.n : 3 * self.n], y[3 * self.n : 4 * self.n]
        s, rate, _ = self.path.at(t)
        at = min(max(int(np.searchsorted(self.motors.x, s, "right")) - 1, 0), len(self.motors.x) - 2)
        (a, b, c, d), off = self.motors.c[:, at], s - self.motors.x[at]
        return ((a * off + b) * off + c) * off + d, ((3.0 * a * off + 2.0 * b) * off + c) * rate

    def sample(self, t: float, y: Array) -> Array:
        """Return the torques that the servo works out now."""
        assert self.servo is not None
        s, rate, rise = self.path.at(t)
        q_m, v_m = self.driven(t, y)
        w, rotors = self.servo.frequency, self.arm.rotors
        wanted = self.slopes(s) * rise + self.bend(s) * rate * rate
        follow = w * w * (self.motors(s) - q_m) + 2.0 * self.servo.damping_ratio * w * (self.slopes(s) * rate - v_m)
        held = self.arm.stiffness * (q_m - y[: self.n]) + self.arm.damping * (v_m - y[self.n : 2 * self.n])
        return np.asarray(rotors * (wanted + follow) + held)

    def contact(self, y: Array) -> float:
        """Contact force, N, without the sign that a clamp would take."""
        depth, rate, law = max(y[-5] - y[-3], 0.0), y[-4] - y[-2], self.scene.contact
        return float(law.stiffness * depth**law.stiffness_exponent + self.damping * depth**law.damping_exponent * rate)

    def pull(self, stretch: float, rate: float) -> float:
        """Force of the coupling on the tool, N."""
        held = self.scene.coupling
        if isinstance(held, SpringDamper):
            return -held.stiffness * stretch - 2.0 * held.damping_ratio * math.sqrt(held.stiffness * self.m_t) * rate
        assert isinstance(held, Bistable)
        k, place = held.stop_stiffness, held.rest + stretch
        c = 2.0 * held.stop_damping_ratio * math.sqrt(k * self.m_t)
        front = max(k * (place - held.front_stop) + c * rate, 0.0) if place > held.front_stop else 0.0
        rear = max(k * (held.rear_stop - place) - c * rate, 0.0) if place < held.rear_stop else 0.0
        return float(held.force(place)) - front + rear

    def flange(self, t: float, y: Array) -> tuple[float, float, Array, Array, Array]:
        """Return place and velocity along the line, the line's row of the Jacobian, M and the bias."""
        q, rates = y[: self.n], y[self.n : 2 * self.n]
        if self.linear:  # q is what the joints yield
            _, J, M, _ = self.frozen
            row = self.u @ J[:3]
            s, speed, rise = self.path.at(t)
            return s + float(row @ q), speed + float(row @ rates), row, M, M @ self.slope_at_impact * rise
        place, J, M, bias = self.arm.dynamics(q, rates, self.coriolis, self.gravity)
        row = self.u @ J[:3]
        return float(self.u @ (place - self.start)), float(row @ rates), row, M, bias

    def rates(self, t: float, y: Array, touching: bool) -> Array:
        """Return d(state)/dt."""
        n, out = self.n, np.empty_like(y)
        place, speed, row, M, bias = self.flange(t, y)
        if self.rigid:
            y = y.copy()
            y[-5:-3] = place, speed
        force = max(self.contact(y), 0.0) if touching else 0.0
        pulled = force if self.rigid else self.pull(y[-5] - place, y[-4] - speed)
        q, v = y[:n], y[n : 2 * n]
        if self.linear:
            yielded = -self.arm.stiffness * q - self.arm.damping * v
        else:
            q_m, v_m = self.driven(t, y)
            yielded = self.arm.stiffness * (q_m - q) + self.arm.damping * (v_m - v)
        out[:n], out[n : 2 * n] = v, np.linalg.solve(M, yielded - bias - row * pulled)
        if self.servo:
            out[2 * n : 3 * n] = y[3 * n : 4 * n]
            out[3 * n : 4 * n] = (self.torque - yielded) / self.arm.rotors
        out[-5:] = y[-4], 0.0 if self.rigid else (pulled - force) / self.m_t, y[-2], force / self.m_p, force
        return out

    def seen(self, t: float, y: Array) -> Array:
        """Return the state with the tool where it is."""
        if self.rigid:
            y = y.copy()
            y[-5:-3] = self.flange(t, y)[:2]
        return y


def simulate(
    arm: Arm, approach: Approach, scene: Scene, motion: Trapezoid | Motion | Reaction, *, duration: float,
    coriolis: bool = True, gravity: bool = False, linear: bool = False, servo: Servo | None = None, rtol: float = 1e-8,
) -> Blow:  # fmt: skip
    """Run an approach of the whole arm along the line of `approach`; its robot is the arm, so the scene has none.

    Args:
        arm: with which the approach was followed.
        approach: where the motors go.
        scene: tool, object, contact and coupling. Without friction, and with equal exponents of the contact.
        motion: of the motors along the line.
        duration: s.
        coriolis: whether centrifugal and Coriolis forces act.
        gravity: whether weight acts, the joints hanging through from the start; else it is taken as compensated.
        linear: M and J as they are at the impact, small deflections: the paper's step from eq. 10 to eq. 11.
        servo: how the motors follow; exactly without.
        rtol: of the integration.

    Raises:
        ValueError: the scene has what this reference has not, or the line ends before the object.
    """
    one_of("motion", motion, Trapezoid, Motion, Reaction)
    number("duration", duration, "s", above=0)
    law, distance = scene.contact, scene.object.distance
    stroke = isinstance(scene.coupling, SpringDamper) and scene.coupling.stroke
    if scene.robot is not None or scene.object.friction or law.reference_velocity or stroke:
        raise ValueError("scene.robot, object.friction, a fixed dissipation and coupling.stroke must be left out here")
    if law.stiffness_exponent != law.damping_exponent:
        raise ValueError("contact.damping_exponent must equal contact.stiffness_exponent here")
    if not distance <= approach.travel[-1]:
        raise ValueError(f"object.distance is {distance!r} m, but the line ends after {approach.travel[-1]:.4g} m")
    if servo is not None and not (arm.rotors > 0).all():
        raise ValueError("a servo needs the arm's rotor_inertia, in kg m^2, above 0")
    if servo is not None and linear:
        raise ValueError("servo and linear exclude each other")
    path = _Path(_reaction(motion))
    return _run(_Whole(arm, approach, scene, path, coriolis, gravity, linear, servo), path, duration, rtol)


def _run(whole: _Whole, path: _Path, duration: float, rtol: float) -> Blow:
    """Integrate from one event to the next."""
    scene, touching, unfelt, t = whole.scene, False, path.reaction.threshold < math.inf, 0.0
    y, d = whole.begin(scene.object.distance), damping_factor(scene.contact.dissipation, scene.contact.restitution)
    touches, parted, peak, impact, aside, status = list[float](), math.inf, 0.0, math.nan, (0.0, 0.0), "ok"
    rotation = np.eye(3)
    due, waiting = math.inf if whole.servo is None else 0.0, np.zeros(whole.n)
    while t < duration:
        if t >= due:
            assert whole.servo is not None
            whole.torque, waiting = waiting, whole.sample(t, y)
            due = t + whole.servo.period
            off = np.abs(whole.driven(t, y)[0] - whole.motors(path.at(t)[0])).max()
            if not off < LOST:
                status = f"the servo does not hold the arm on its line: a joint is {off:.3g} rad or m off"
                break
        until = min(duration, path.next_change(t), due)
        found = _piece(whole, t, until, y, touching, unfelt and touching, rtol)
        if not found.success:
            status = f"the integration failed: {found.message}"
            break
        if touching:
            peak = max(peak, _highest([whole.contact(whole.seen(s, each)) for s, each in _between(found)]))
            aside = _aside(whole, found.y[:, -1], rotation, aside)
        t, y = float(found.t[-1]), found.y[:, -1]
        if found.status != 1:
            continue
        y = whole.seen(t, y)
        if touching and len(found.t_events) > 1 and found.t_events[1].size:
            path.react(t)
            unfelt = False
        elif touching:
            touching, y[-5] = False, y[-3] - 1e-15
            parted = min(parted, t)
        else:
            touching, closing = True, float(y[-4] - y[-2])
            whole.damping = d * scene.contact.stiffness / max(closing, 1e-9)
            if not touches:
                impact, rotation = float(y[-4]), whole.arm.flange(y[: whole.n])[1]
                aside = _aside(whole, y, rotation, aside)
            touches.append(t)
            if len(touches) > MOST_CONTACTS:
                status = f"more than {MOST_CONTACTS} contacts"
                break
    return Blow(
        object_velocity=float(y[-2]), touch_time=touches[0] if touches else math.nan, impact_velocity=impact,
        peak_force=peak, contact_count=len(touches),
        contact_time=parted - touches[0] if touches and parted < math.inf else math.nan,
        impulse=float(y[-1]), sideways=aside[0], turn=aside[1], status=status,
    )  # fmt: skip


def _piece(whole: _Whole, t: float, until: float, y: Array, touching: bool, unfelt: bool, rtol: float) -> Any:
    """Integrate a piece without corners, to its first event."""

    def gap(t: float, y: Array) -> float:
        at = whole.seen(t, y)
        return float(at[-5] - at[-3])

    def felt(t: float, y: Array) -> float:
        return whole.contact(whole.seen(t, y)) - whole.path.reaction.threshold

    events: list[Any] = [gap, felt] if unfelt else [gap]
    for event, direction in zip(events, (-1.0 if touching else 1.0, 1.0), strict=False):
        event.terminal, event.direction = True, direction
    longest, law = until - t, whole.scene.contact
    if touching:
        mass = 1.0 / (1.0 / whole.m_t + 1.0 / whole.m_p)
        closing = max(whole.damping and abs(float(y[-4] - y[-2])), 1e-3)
        depth = (mass * closing**2 / law.stiffness) ** (1.0 / (law.stiffness_exponent + 1.0))
        longest = min(longest, depth / closing)
    elif isinstance(whole.scene.coupling, Bistable):
        longest = min(longest, 2.0 * math.sqrt(whole.m_t / whole.scene.coupling.stop_stiffness))
    return solve_ivp(
        lambda t, y: whole.rates(t, y, touching), (t, until), y, "DOP853", events=events, rtol=rtol, atol=1e-3 * rtol,
        max_step=max(longest, 1e-9), dense_output=touching,
    )  # fmt: skip


def _between(found: Any) -> list[tuple[float, Array]]:
    """Return times and states along a piece, evenly and closely."""
    times = np.linspace(found.t[0], found.t[-1], 8 * len(found.t) + 1)
    return [(float(t), found.sol(t)) for t in times]


def _highest(forces: list[float]) -> float:
    """Return the top of the parabola through the largest of evenly spaced values and its neighbours."""
    top = int(np.argmax(forces))
    if not 0 < top < len(forces) - 1:
        return forces[top]
    left, middle, right = forces[top - 1 : top + 2]
    bend = left - 2.0 * middle + right
    return middle - 0.125 * (right - left) ** 2 / bend if bend < 0.0 else middle


def _aside(whole: _Whole, y: Array, rotation: Array, before: tuple[float, float]) -> tuple[float, float]:
    """Return how far the flange is from the line, m, and turned, rad, or was before if that is more."""
    if whole.linear:
        return before
    place, turned = whole.arm.flange(y[: whole.n])
    away = place - whole.start
    away = away - whole.u * (whole.u @ away)
    angle = math.acos(min(1.0, max(-1.0, 0.5 * (float(np.trace(rotation.T @ turned)) - 1.0))))
    return max(before[0], float(np.linalg.norm(away))), max(before[1], angle)
