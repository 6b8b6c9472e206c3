"""What people write by hand: the equations of motion in SI units, at a fixed step or by solve_ivp with event functions.

At a fixed step a contact is an `if penetration > 0`, the approach velocity is the rate at the first step that
penetrates, alarm, peak force and duration are read at the ends of steps. Compiled with numba, so that the comparison is
one of methods. Hertz contact, rigid robot; no coupling, a spring and damper, or the bistable mechanism.
"""

import math
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import impact_gym as ig
from experiments.reference.laws import BistableForce, damping_factor
from experiments.solver.approaches import Approach
from experiments.solver.solutions import Solution

RIGID, SPRING, BISTABLE = range(3)
EULER, RK4 = range(2)
METHODS = {"semi-implicit Euler": EULER, "RK4": RK4}
SLOWEST = 1e-6  # m/s, of v_in in eq. 7
Array = NDArray[np.float64]
compiled = numba.njit(cache=True, error_model="numpy")
inlined = numba.njit(cache=True, error_model="numpy", inline="always")
State = tuple[float, float, float, float]
"""Position and velocity of tool and object: x_t, v_t, x_p, v_p (m, m/s)."""


class Law(NamedTuple):
    """The bodies, their contact and the coupling."""

    m_t: float  # kg
    m_p: float  # kg
    k_c: float  # N/m^1.5
    d: float  # -
    kind: int = RIGID
    k_t: float = 0.0  # N/m, of a spring and damper or of the mechanism's spring
    c_t: float = 0.0  # N s/m
    L0: float = 1.0  # m
    H: float = 1.0  # m
    x0: float = 0.0  # m, slider at rest, from its alignment
    front: float = 0.0  # m
    rear: float = 0.0  # m
    k_s: float = 0.0  # N/m
    c_s: float = 0.0  # N s/m


class Command(NamedTuple):
    """The flange's motion."""

    speed: float  # m/s
    acceleration: float  # m/s^2
    threshold: float  # N
    delay: float  # s
    deceleration: float  # m/s^2


@lru_cache
def law_of(scene: ig.Scene) -> Law:
    """Return the numbers of a scene."""
    coupling, m_t = scene.coupling, scene.tool.mass
    d = damping_factor(scene.contact.dissipation, scene.contact.restitution, 1.5, 1.5)
    bodies = (m_t, scene.object.mass, scene.contact.stiffness, d)
    if isinstance(coupling, ig.SpringDamper):
        k_t = coupling.stiffness
        return Law(*bodies, SPRING, k_t, 2.0 * coupling.damping_ratio * math.sqrt(k_t * m_t))
    if isinstance(coupling, ig.Bistable):
        force = BistableForce(coupling, m_t)
        stops = (coupling.front_stop, coupling.rear_stop, force.k_s, force.c_s)
        return Law(*bodies, BISTABLE, force.k, 0.0, force.L0, force.H, force.x0, *stops)
    return Law(*bodies)


@lru_cache
def command_of(motion: ig.Trapezoid) -> Command:
    """Return the numbers of a motion."""
    brake = motion.brake or ig.Brake(threshold=1e12)
    return Command(motion.speed, motion.acceleration, brake.threshold, brake.delay, motion.deceleration)


@compiled
def flange(command: Command, brake_time: float, t: float) -> tuple[float, float]:
    """Position (m) and velocity (m/s) of the trapezoid that brakes at `brake_time` (s)."""
    v, a, b = command.speed, command.acceleration, command.deceleration
    ramp = min(t, brake_time, v / a)
    x, speed = 0.5 * a * ramp * ramp, a * ramp
    x += speed * (min(t, brake_time) - ramp)
    if t > brake_time:
        s = min(t - brake_time, speed / b)
        x += (speed - 0.5 * b * s) * s
        speed -= b * s
    return x, speed


@compiled
def contact_force(law: Law, delta: float, rate: float, v_in: float) -> float:
    """Paper, eq. 5 and 7, never negative."""
    if delta <= 0.0:
        return 0.0
    return max(law.k_c * delta * math.sqrt(delta) * (1.0 + law.d / v_in * rate), 0.0)


@compiled
def coupling_force(law: Law, stretch: float, rate: float) -> float:
    """Force on the tool, N, by x_t - x_f (m) and its rate: paper, eq. 17 or 23-24."""
    if law.kind == SPRING:
        return -law.k_t * stretch - law.c_t * rate
    x = law.x0 + stretch
    L = math.sqrt(law.H * law.H + x * x)
    force = law.k_t * (law.L0 - L) * x / L
    if x > law.front:
        force -= max(law.k_s * (x - law.front) + law.c_s * rate, 0.0)
    elif x < law.rear:
        force += max(law.k_s * (law.rear - x) - law.c_s * rate, 0.0)
    return force


@inlined
def placed(law: Law, command: Command, brake_time: float, t: float, state: State) -> State:
    """The state, the tool being where the flange is if it is fixed to it."""
    if law.kind == RIGID:
        x_f, v_f = flange(command, brake_time, t)
        return x_f, v_f, state[2], state[3]
    return state


@inlined
def rates(law: Law, command: Command, brake_time: float, v_in: float, t: float, state: State) -> State:
    """Rates of the state; v_in (m/s) is 0 while the bodies are apart."""
    x_t, v_t, x_p, v_p = placed(law, command, brake_time, t, state)
    F = contact_force(law, x_t - x_p, v_t - v_p, v_in) if v_in > 0.0 else 0.0
    if law.kind == RIGID:
        return v_t, 0.0, v_p, F / law.m_p
    x_f, v_f = flange(command, brake_time, t)
    return v_t, (coupling_force(law, x_t - x_f, v_t - v_f) - F) / law.m_t, v_p, F / law.m_p


@inlined
def plus(state: State, h: float, rate: State) -> State:
    """State + h rate."""
    return state[0] + h * rate[0], state[1] + h * rate[1], state[2] + h * rate[2], state[3] + h * rate[3]


@inlined
def stepped(
    method: int, law: Law, command: Command, brake_time: float, v_in: float, t: float, state: State, h: float
) -> State:
    """The state after one step of `method`."""
    k1 = rates(law, command, brake_time, v_in, t, state)
    if method == EULER:
        v_t, v_p = state[1] + h * k1[1], state[3] + h * k1[3]
        return state[0] + h * v_t, v_t, state[2] + h * v_p, v_p
    k2 = rates(law, command, brake_time, v_in, t + 0.5 * h, plus(state, 0.5 * h, k1))
    k3 = rates(law, command, brake_time, v_in, t + 0.5 * h, plus(state, 0.5 * h, k2))
    k4 = rates(law, command, brake_time, v_in, t + h, plus(state, h, k3))
    total = plus(plus(plus(k1, 2.0, k2), 2.0, k3), 1.0, k4)
    return plus(state, h / 6.0, total)


@compiled
def march(
    method: int, law: Law, command: Command, start: State, duration: float, step: float
) -> tuple[float, float, float, float, int, int]:
    """Return V_p, peak force, contact duration, detection time, contacts, snap-throughs."""
    state, count = start, round(duration / step)
    v_in, brake_time, detection, behind = 0.0, math.inf, math.nan, False
    peak, touching, contacts, passes = 0.0, 0, 0, 0
    for i in range(count):
        t = i * step
        state = placed(law, command, brake_time, t, state)
        x_t, v_t, x_p, v_p = state
        if x_t <= x_p:
            v_in = 0.0
        elif v_in == 0.0:
            v_in = max(v_t - v_p, SLOWEST)
            contacts += 1
        if v_in > 0.0:
            touching += 1
            F = contact_force(law, x_t - x_p, v_t - v_p, v_in)
            peak = max(peak, F)
            if command.threshold < F and math.isnan(detection):
                detection, brake_time = t, t + command.delay
        if law.kind == BISTABLE:
            now_behind = law.x0 + x_t - flange(command, brake_time, t)[0] < 0.0
            passes += now_behind != behind
            behind = now_behind
        state = stepped(method, law, command, brake_time, v_in, t, state, step)
    return state[3], peak, touching * step, detection, contacts, passes


def fixed_step(approach: Approach, method: str, step: float) -> Solution:
    """Run an approach by one of METHODS at a step (s)."""
    law, command = law_of(approach.scene), command_of(approach.motion)
    start = 0.0, 0.0, approach.scene.object.distance, 0.0
    numbers = march(METHODS[method], law, command, start, approach.duration, step)
    return Solution(*numbers, steps=round(approach.duration / step))


def compile_now() -> None:
    """Compile, or load, both methods."""
    march(EULER, Law(1.0, 1.0, 1.0, 0.0), Command(1.0, 1.0, 1.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.0), 1e-3, 1e-3)


def with_events(approach: Approach, method: str, rtol: float, atol: float) -> Solution:
    """solve_ivp as people write it: SI units, tests of signs at the ends of steps, restarts at each touch.

    The motion is cut where the commanded acceleration jumps and at touch, separation and alarm; what turns there and
    back within a step is not seen, and neither are the stops of a mechanism. Nobody asks for peak force, contact
    duration and snap-throughs.

    Raises:
        RuntimeError: the integrator gave up.
    """
    law, command, duration = law_of(approach.scene), command_of(approach.motion), approach.duration
    v_in, brake, detection, contacts, evaluations = 0.0, math.inf, math.nan, 0, 0
    t, y = 0.0, np.array([0.0, 0.0, approach.scene.object.distance, 0.0])

    def slope(t: float, y: Array) -> State:
        return rates(law, command, brake, v_in, t, tuple(y.tolist()))

    def penetration(t: float, y: Array) -> tuple[float, float]:  # m, and its rate, m/s
        x_t, v_t, x_p, v_p = placed(law, command, brake, t, tuple(y.tolist()))
        return x_t - x_p, v_t - v_p

    def over_threshold(t: float, y: Array) -> float:
        return contact_force(law, *penetration(t, y), v_in) - command.threshold

    while t < duration:
        touch = _event(lambda t, y: penetration(t, y)[0], -1.0 if v_in else 1.0)
        watched = [touch, _event(over_threshold, 1.0)] if v_in and math.isnan(detection) else [touch]
        ramp, stopped = command.speed / command.acceleration, brake + command.speed / command.deceleration
        jump = min((at for at in (ramp, brake, stopped, duration) if at > t), default=duration)
        run = solve_ivp(slope, (t, jump), y, method, events=watched, rtol=rtol, atol=atol)
        if run.status < 0:
            raise RuntimeError(run.message)
        evaluations += run.nfev
        t, y = float(run.t[-1]), run.y[:, -1].copy()
        if len(run.t_events[0]):
            contacts += v_in == 0.0
            v_in = 0.0 if v_in else max(penetration(t, y)[1], SLOWEST)
        elif len(watched) > 1 and len(run.t_events[1]):
            detection, brake = t, t + command.delay
    return Solution(float(y[3]), detection_time=detection, contacts=contacts, steps=evaluations)


def _event(gauge: Callable[[float, Array], float], direction: float) -> Any:
    """Return `gauge` as solve_ivp takes a terminal event."""
    event: Any = partial(gauge)
    event.direction, event.terminal = direction, True
    return event
