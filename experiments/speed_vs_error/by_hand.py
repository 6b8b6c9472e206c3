"""What people write by hand: the equations of motion in SI units at a fixed step, without events.

Contact is an `if penetration > 0`, the approach velocity is the rate at the first step that penetrates, alarm, peak
force and duration are read at the ends of steps. Compiled with numba, so that the comparison is one of methods.
Hertz contact, rigid robot; no coupling, a spring and damper, or the bistable mechanism.
"""

import math
from typing import Any, NamedTuple

import numba

import impact_gym as ig
from experiments.reference.bistable import BistableForce
from experiments.reference.dissipation import damping_factor
from experiments.speed_vs_error.quantities import Solution
from experiments.speed_vs_error.scenes import Approach

RIGID, SPRING, BISTABLE = range(3)
EULER, RK4 = range(2)
METHODS = {"semi-implicit Euler": EULER, "RK4": RK4}
SLOWEST = 1e-6  # m/s, of v_in in eq. 7
compiled = numba.njit(cache=True, error_model="numpy")


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


def command_of(motion: ig.Trapezoid) -> Command:
    """Return the numbers of a motion."""
    brake = motion.brake or ig.Brake(threshold=1e300)
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


@compiled
def accelerations(
    law: Law, command: Command, brake_time: float, v_in: float, t: float, x_t: float, v_t: float, x_p: float, v_p: float
) -> tuple[float, float]:
    """Of tool and object, m/s^2; v_in is 0 while they are apart."""
    F = contact_force(law, x_t - x_p, v_t - v_p, v_in) if v_in > 0.0 else 0.0
    if law.kind == RIGID:
        return 0.0, F / law.m_p
    x_f, v_f = flange(command, brake_time, t)
    return (coupling_force(law, x_t - x_f, v_t - v_f) - F) / law.m_t, F / law.m_p


@compiled
def place(law: Law, command: Command, brake_time: float, t: float, x: float, v: float) -> tuple[float, float]:
    """Position and velocity of the tool: its own, or the flange's if it is fixed to it."""
    if law.kind == RIGID:
        return flange(command, brake_time, t)
    return x, v


@compiled
def march(
    method: int, law: Law, command: Command, start: Any, duration: float, step: float
) -> tuple[float, float, float, float, int, int]:
    """Return V_p, peak force, contact duration, detection time, contacts, snap-throughs.

    `start` is x_t, v_t, x_p, v_p (m, m/s).
    """
    x, v, y, w = start
    h, count = step, round(duration / step)
    v_in, brake_time, detection, behind = 0.0, math.inf, math.nan, False
    peak, touching, contacts, passes = 0.0, 0, 0, 0
    for i in range(count):
        t = i * h
        x, v = place(law, command, brake_time, t, x, v)
        if x <= y:
            v_in = 0.0
        elif v_in == 0.0:
            v_in = max(v - w, SLOWEST)
            contacts += 1
        if v_in > 0.0:
            touching += 1
            F = contact_force(law, x - y, v - w, v_in)
            peak = max(peak, F)
            if command.threshold < F and math.isnan(detection):
                detection, brake_time = t, t + command.delay
        if law.kind == BISTABLE:
            now_behind = law.x0 + x - flange(command, brake_time, t)[0] < 0.0
            passes += now_behind != behind
            behind = now_behind
        a, b = accelerations(law, command, brake_time, v_in, t, x, v, y, w)
        if method == EULER:
            v, w = v + h * a, w + h * b
            x, y = x + h * v, y + h * w
        else:
            x_s, v_s, y_s, w_s = v, a, w, b  # slopes of the stage before, and below the weighted sums of all
            dx, dv, dy, dw = x_s, v_s, y_s, w_s
            for part, weight in ((0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
                s = part * h
                x_s, v_s = place(law, command, brake_time, t + s, x + s * x_s, v + s * v_s)
                y_s, w_s = y + s * y_s, w + s * w_s
                a, b = accelerations(law, command, brake_time, v_in, t + s, x_s, v_s, y_s, w_s)
                x_s, v_s, y_s, w_s = v_s, a, w_s, b
                dx, dv, dy, dw = dx + weight * x_s, dv + weight * v_s, dy + weight * y_s, dw + weight * w_s
            x, v, y, w = x + h / 6.0 * dx, v + h / 6.0 * dv, y + h / 6.0 * dy, w + h / 6.0 * dw
    return w, peak, touching * h, detection, contacts, passes


def arguments(method: str, approach: Approach, step: float) -> tuple[Any, ...]:
    """Return what `march` takes for an approach at a step (s)."""
    start = (0.0, 0.0, approach.scene.object.distance, 0.0)
    return METHODS[method], law_of(approach.scene), command_of(approach.motion), start, approach.duration, step


def solve(method: str, approach: Approach, step: float) -> Solution:
    """Run an approach."""
    return Solution(*march(*arguments(method, approach, step)), steps=round(approach.duration / step))


def compile_now() -> None:
    """Compile, or load, both methods."""
    march(EULER, Law(1.0, 1.0, 1.0, 0.0), Command(1.0, 1.0, 1.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.0), 1e-3, 1e-3)
