"""Whole approaches by integrators of other libraries, which share no code with our solver.

A contact is integrated in its own scales delta0 = (M v_in^2/k_c)^0.4, v_in and t0 = delta0/v_in. As in our solver, the
penetration is replaced by its square root s, and the time by sigma with dt = t0 s dsigma. Hertz' law is a polynomial in
s, so methods of high order keep their order from onset to separation. Flight is integrated in SI units, with the
penetration itself. Whatever ends a smooth piece is a terminal event: onset and separation, a change of the flange's
acceleration, the alarm, the peak of the force, the instant at which the force is clamped at zero, a stop that begins or
ceases to push, the slider's alignment.

The equations are written once, for all libraries: see `equations`. `peers` integrates a piece.
"""

import math
from collections.abc import Callable
from time import process_time
from typing import Any

import impact_gym as ig
from experiments.reference.laws import BistableForce, damping_factor
from experiments.studies.solvers.solutions import Solution

RIGID, SPRING, BISTABLE = range(3)
LAW = ("m_t", "m_p", "k_c", "d", "k_t", "c_t", "L0", "H", "x0", "front", "rear", "k_s", "c_s")
PARAMETERS = (*LAW, "a", "cut", "alarm", "length", "speed", "pressed", "front_on", "rear_on")
STATE = ("s", "w", "v", "tau", "y", "q")
GAUGES = ("touching", "peak", "pressed", "alarm", "cut", "alignment", "front_on", "front_on", "rear_on", "rear_on")
DIRECTIONS = (1, -1, 0, 1, 1, 0, 1, 0, 1, 0)  # 1: the gauge rises through zero; -1: it falls; 0: either
FOREVER = 1e6  # limit of a contact in its own units; an event ends it before
BESIDE = 1e-20  # penetration at which a piece begins: an event at exactly zero might be missed
ROUNDING = 1e-12  # m, rounding of the slider's position
Advance = Callable[[list[float], list[float], float], tuple[str, list[float]]]
"""Integrates from a state (STATE) with parameters (PARAMETERS) to the first event, or to a limit of the independent
variable. Returns the event's name ("cut" at the limit) and the state there."""
Backend = Callable[[int, bool, float], Advance]
"""Makes an `Advance` from the kind of coupling, whether the piece is a contact, and a tolerance."""


def law_of(scene: ig.Scene) -> tuple[tuple[float, ...], int]:
    """Return the numbers named in LAW (SI), and the kind of the coupling."""
    coupling, contact, m_t = scene.coupling, scene.contact, scene.tool.mass
    bodies = (m_t, scene.object.mass, contact.stiffness, damping_factor("hu-guo", contact.restitution, 1.5, 1.5))
    if isinstance(coupling, ig.SpringDamper):
        k_t = coupling.stiffness
        return (*bodies, k_t, 2.0 * coupling.damping_ratio * math.sqrt(k_t * m_t), *7 * (0.0,)), SPRING
    if isinstance(coupling, ig.Bistable):
        law = BistableForce(coupling, m_t)
        stops = (coupling.front_stop, coupling.rear_stop, law.k_s, law.c_s)
        return (*bodies, law.k, 0.0, law.L0, law.H, law.x0, *stops), BISTABLE
    return (*bodies, *9 * (0.0,)), RIGID


def watched(kind: int, touching: bool) -> list[tuple[int, int]]:
    """Return the indices into GAUGES of the events that end a piece, each with its direction."""
    places = [0, *(range(1, 5) if touching else ()), *(range(5, 10) if kind == BISTABLE else ())]
    return [(place, -1 if touching and not place else DIRECTIONS[place]) for place in places]


def equations(kind: int, touching: bool, sqrt: Callable[[Any], Any]) -> Callable[[Any, Any], tuple[Any, Any]]:
    """Return a function of STATE and PARAMETERS (tuples) that returns the derivatives of the state and GAUGES.

    The function takes numbers, symbols of heyoka and arrays of JAX. In a contact s is the root of the penetration, in
    flight the penetration itself; w is the rate of the penetration, v the object's velocity, tau the time since the
    piece began. y is the tool's deflection from the flange and q its rate, both zero with a rigid coupling.
    """
    spring, bistable = kind == SPRING, kind == BISTABLE
    mobile = 0.0 if kind == RIGID else 1.0

    def rates(state: Any, par: Any) -> tuple[Any, Any]:
        s, w, _, tau, y, q = state
        m_t, m_p, k_c, d, k_t, c_t, L0, H, x0, front, rear, k_s, c_s = par[:13]
        a, cut, alarm, length, speed, pressed, front_on, rear_on = par[13:]
        x, x_dot, T = x0 + length * y, speed * q, 0.0 * s
        front_force, rear_force = k_s * (x - front) + c_s * x_dot, k_s * (rear - x) - c_s * x_dot
        if spring:
            T = -k_t * x - c_t * x_dot
        if bistable:  # paper, eq. 23-24, and the two stops
            L = sqrt(H * H + x * x)
            T = k_t * (L0 - L) * x / L - front_on * front_force + rear_on * rear_force
        unit, clamped = length / (speed * speed), 1.0 + d * w
        rate, s_dot, F = 1.0 + 0.0 * s, w, 0.0 * s
        if touching:  # s * s * s: heyoka's series of s**3 divides by s, which is zero at onset
            rate, s_dot = s, 0.5 * w
            F = pressed * k_c * length * sqrt(length) * (s * s * s) * clamped  # paper, eq. 5 and 7
        tool = mobile * (T - F) / m_t + (1.0 - mobile) * a
        w_dot = rate * unit * (tool - F / m_p)
        slope = 1.5 * w * clamped + d * s * w_dot  # of F, without s^2
        y_dot, q_dot = mobile * rate * q, mobile * rate * unit * (tool - a)
        gauges = (s, slope, clamped, alarm * F - 1.0, tau - cut, x, x - front, front_force, rear - x, rear_force)
        return (s_dot, w_dot, rate * unit * F / m_p, rate, y_dot, q_dot), gauges

    return rates


class Run:
    """One approach, integrated by a backend at a tolerance. The first run compiles the pieces."""

    def __init__(
        self, scene: ig.Scene, motion: ig.Trapezoid, duration: float, tolerance: float, backend: Backend
    ) -> None:
        if motion.brake is None:
            raise ValueError("motion must have a brake, whose threshold is that of the alarm")
        law, kind = law_of(scene)
        self.brake = motion.brake
        self.law, self.motion = dict(zip(LAW, law, strict=True)), motion
        self.distance, self.duration = scene.object.distance, duration
        self.pieces = [backend(kind, touching, tolerance) for touching in (False, True)]
        m_t, m_p = scene.tool.mass, scene.object.mass
        self.M = m_p if kind == RIGID else m_t * m_p / (m_t + m_p)  # kg
        self.seconds = [0.0, 0.0]  # processor time of the backend's own calls: in flights, in contacts

    def solve(self) -> Solution:
        """Integrate the pieces one after the other."""
        motion = self.motion
        numbers = (*self.law.values(), motion.acceleration, 0.0, 1.0 / self.brake.threshold, 1.0, 1.0, 1.0, 1.0, 0.0)
        self.par = dict(zip(PARAMETERS, numbers, strict=True))
        self.changes = [(motion.speed / motion.acceleration, 0.0), (self.duration, math.nan)]  # s, m/s^2 from then
        self.peak, self.detection, self.passes = 0.0, math.nan, 0
        rest = [0.0, 0.0]  # y and q, SI
        t, touching, begin, delta_dot, v_p, lasted, contacts = 0.0, False, -self.distance, 0.0, 0.0, 0.0, 0
        while self.changes:
            length = (self.M * delta_dot**2 / self.par["k_c"]) ** 0.4 if touching else 1.0
            speed = delta_dot if touching else 1.0
            self.par |= {"length": length, "speed": speed, "pressed": 1.0}
            state = [begin, delta_dot / speed, v_p / speed, 0.0, rest[0] / length, rest[1] / speed]
            end, (_, w, v, _, y, q) = self._move(touching, t, state)
            delta_dot, v_p, rest = w * speed, v * speed, [y * length, q * speed]
            lasted, t = lasted + (end - t) * touching, end
            touching = not touching
            contacts += touching and bool(self.changes)
            begin = BESIDE if touching else -BESIDE
        return Solution(v_p, self.peak, lasted, self.detection, contacts, self.passes)

    def _move(self, touching: bool, begun: float, state: list[float]) -> tuple[float, list[float]]:
        """Integrate one flight or contact from `begun` (s); return the time at its end and the state there."""
        advance, par = self.pieces[touching], self.par
        time, event = par["length"] / par["speed"], ""
        while self.changes and event != "touching":
            par["cut"] = (self.changes[0][0] - begun) / time
            limit = FOREVER if touching else par["cut"] - state[3]
            started = process_time()
            event, state = advance(state, list(par.values()), limit)
            self.seconds[touching] += process_time() - started
            self._note(event, begun + time * state[3], state, touching)
        return begun + time * state[3], state

    def _note(self, event: str, t: float, state: list[float], touching: bool) -> None:
        """Record an event at t (s) and change the parameters that it changes."""
        motion, par = self.motion, self.par
        if touching:
            F = par["pressed"] * par["k_c"] * par["length"] ** 1.5 * state[0] ** 3 * (1.0 + par["d"] * state[1])
            self.peak = max(self.peak, F)
        if event == "cut":
            par["a"] = self.changes.pop(0)[1]
        elif event == "alarm":
            self.detection, brake, par["alarm"] = t, t + self.brake.delay, 0.0
            stop = brake + min(motion.speed, motion.acceleration * brake) / motion.deceleration
            left = [(when, a) for when, a in self.changes if when < brake or when == self.duration]
            left += [(brake, -motion.deceleration), (stop, 0.0)]
            self.changes = sorted(change for change in left if change[0] <= self.duration)
        elif event == "alignment":
            self.passes += 1
        elif event == "pressed":
            par[event] = 1.0 - par[event]
        elif event in ("front_on", "rear_on"):
            x = par["x0"] + par["length"] * state[4]
            within = x > par["front"] - ROUNDING if event == "front_on" else x < par["rear"] + ROUNDING
            par[event] = (1.0 - par[event]) * within
