"""Approaches solved by heyoka: Taylor series, compiled by LLVM (Biscani, Izzo 2021). No code is shared with our solver.

The units in a contact are the length delta0 = (M v_in^2/k_c)^0.4, the velocity v_in and the time t0 = delta0/v_in. M is
the reduced mass, v_in the approach velocity, k_c the contact stiffness. As in our solver, the state has the square root
s of the penetration, and sigma replaces the time: dt = t0 s dsigma. Hertz' law is a polynomial in s, so Taylor series
keep their order at onset and separation. Flight is integrated in SI units, with the penetration instead of s.
"""

import math
from functools import cache, partial
from importlib import import_module
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impact_gym as ig
from experiments.reference.laws import BistableForce, damping_factor
from experiments.studies.solvers.approaches import Approach, Solution

LAW = ("m_t", "m_p", "k_c", "d", "k_t", "c_t", "L0", "H", "x0", "front", "rear", "k_s", "c_s")
PARAMETERS = (*LAW, "a", "cut", "alarm", "length", "speed", "pressed", "front_on", "rear_on")
STATE = ("s", "w", "v", "tau", "y", "q")
FOREVER = 1e6  # limit of sigma in a contact; every contact ends before this limit
BESIDE = 1e-20  # absolute value of `s` after touch or separation, because heyoka could miss an event at exactly 0
ROUNDING = 1e-12  # m, allowed rounding error of the slider's position
LANES = 16  # contacts in a batch of heyoka; 8 and 32 take as long


@cache
def integrator(kind: str, touching: bool, tolerance: float, number: Any, lanes: int = 1) -> tuple[Any, dict[int, str]]:
    """Compile the equations for the coupling class `kind`; return heyoka's integrator and the names of its events.

    With several `lanes`, heyoka integrates as many contacts at once. A further parameter, set to 0 at the end of a
    contact, then stops its lane, because the end of one lane must not stop the others; peak and alarm are not sought.

    s is the square root of the penetration (in flight the penetration), w the rate of the penetration, v the object's
    velocity, tau the time since flight or contact began, y the tool's deflection from the flange and q the rate of y.
    """
    hy = import_module("heyoka")
    symbols, zero = hy.make_vars(*STATE), hy.expression(0.0)
    s, w, _, tau, y, q = symbols
    numbers = [hy.par[index] for index in range(len(PARAMETERS))]
    m_t, m_p, k_c, d, k_t, c_t, L0, H, x0, front, rear, k_s, c_s = numbers[: len(LAW)]
    a, cut, alarm, length, speed, pressed, front_on, rear_on = numbers[len(LAW) :]
    x, x_dot, T = x0 + length * y, speed * q, zero
    front_force, rear_force = k_s * (x - front) + c_s * x_dot, k_s * (rear - x) - c_s * x_dot
    if kind == "SpringDamper":
        T = -k_t * x - c_t * x_dot
    if kind == "Bistable":  # paper, eq. 23-24, and the two stops
        L = hy.sqrt(H * H + x * x)
        T = k_t * (L0 - L) * x / L - front_on * front_force + rear_on * rear_force
    unit, clamped = length / (speed * speed), 1.0 + d * w
    rate, s_dot, F = zero + 1.0, zero + w, zero
    if touching:  # F has s * s * s, because heyoka's series of s**3 divides by s, which is only BESIDE at onset
        rate, s_dot = s, 0.5 * w
        F = pressed * k_c * length * hy.sqrt(length) * (s * s * s) * clamped  # paper, eq. 5 and 7
    tool = zero + a if kind == "Rigid" else (T - F) / m_t
    w_dot = rate * unit * (tool - F / m_p)
    y_dot, q_dot = (zero, zero) if kind == "Rigid" else (rate * q, rate * unit * (tool - a))
    rising, falling, both = (getattr(hy.event_direction, name) for name in ("positive", "negative", "any"))
    events = [("touching", falling if touching else rising, s)]
    if touching:
        slope = 1.5 * w * clamped + d * s * w_dot  # slope of F divided by s^2
        events += [("peak", falling, slope), ("pressed", both, clamped)]
        events += [("alarm", rising, alarm * F - 1.0), ("cut", rising, tau - cut)]
    if kind == "Bistable":
        events += [("alignment", both, x), ("front_on", rising, x - front), ("front_on", both, front_force)]
        events += [("rear_on", rising, rear - x), ("rear_on", both, rear_force)]
    derivatives = s_dot, w_dot, rate * unit * F / m_p, rate, y_dot, q_dot
    if lanes > 1:

        def happens(made: Any, _: int, lane: int, row: int) -> bool:
            made.pars[row, lane] = 1.0 - made.pars[row, lane]
            return True

        rows = {"touching": len(PARAMETERS), "pressed": PARAMETERS.index("pressed")}
        seen = [hy.t_event_batch(gauge, direction=direction, callback=partial(happens, row=rows[name]))
                for name, direction, gauge in events if name in rows]  # fmt: skip
        held = [(symbol, hy.par[len(PARAMETERS)] * each) for symbol, each in zip(symbols, derivatives, strict=True)]
        return hy.taylor_adaptive_batch(held, np.zeros((len(STATE), lanes)), tol=tolerance, t_events=seen), {}
    made = hy.taylor_adaptive(
        [*zip(symbols, derivatives, strict=True)], [number(0.0)] * len(STATE), tol=number(tolerance), fp_type=number,
        t_events=[hy.t_event(gauge, direction=direction, fp_type=number) for _, direction, gauge in events],
    )  # fmt: skip
    names = {-1 - index: name for index, (name, _, _) in enumerate(events)}
    return made, names | {int(hy.taylor_outcome.time_limit): "cut"}


def first_contacts(approach: Approach, masses: NDArray[np.float64], tolerance: float) -> tuple[Any, float]:
    """Return the velocities (m/s) of objects of `masses` (kg) after their first contacts, and heyoka's time (s).

    The contacts are those of `approach`, from the touch at constant speed, whose state impact_gym computes.
    """
    scene, motion, _ = approach
    if not isinstance(scene.coupling, ig.SpringDamper):
        raise NotImplementedError("only a spring and damper, whose contacts have no further events")
    start, _, v, *_ = ig.simulate(*approach).contacts[0]
    trace = ig.simulate(scene, motion, start, trace=True).trace
    assert trace is not None
    y, q = trace.tool_position[-1] - trace.command_position[-1], trace.tool_velocity[-1] - motion.speed
    one, rows = TaylorApproach(*approach, tolerance), len(masses)
    lengths = (scene.tool.mass * masses / (scene.tool.mass + masses) * v**2 / scene.contact.stiffness) ** 0.4
    of: dict[str, Any] = {**one.par, "a": 0.0, "speed": v, "m_p": masses, "length": lengths, "alive": 1.0}
    pars, states = (np.array([np.broadcast_to(each, rows) for each in every])
                    for every in (of.values(), (BESIDE, 1.0, 0.0, 0.0, y / lengths, q / v)))  # fmt: skip
    made, _ = integrator("SpringDamper", True, tolerance, float, LANES)
    velocities, seconds = np.empty(rows), 0.0
    for first in range(0, rows, LANES):
        some = np.arange(first, first + LANES) % rows  # the last batch repeats the first contacts
        begun = process_time()
        made.set_time(0.0)
        made.reset_cooldowns()
        made.state[:], made.pars[:] = states[:, some], pars[:, some]
        made.propagate_for(FOREVER)
        seconds += process_time() - begun
        velocities[some] = made.state[STATE.index("v")] * v
    return velocities, seconds


class TaylorApproach:
    """One approach, integrated at a tolerance. The first approach with a coupling class at a tolerance compiles code.

    `number` is the type of heyoka's numbers: float, or `heyoka.real128` with 34 digits.
    """

    def __init__(
        self, scene: ig.Scene, motion: ig.Trapezoid, duration: float, tolerance: float, number: Any = float
    ) -> None:
        assert motion.brake is not None
        self.brake, self.motion, self.number = motion.brake, motion, number
        self.distance, self.duration = scene.object.distance, duration
        coupling, contact, kind = scene.coupling, scene.contact, type(scene.coupling).__name__
        self.integrators = [integrator(kind, touching, tolerance, number) for touching in (False, True)]
        m_t, m_p = scene.tool.mass, scene.object.mass
        self.M = m_p if isinstance(coupling, ig.Rigid) else m_t * m_p / (m_t + m_p)  # kg, reduced mass
        numbers = (motion.acceleration, 0.0, 1.0 / self.brake.threshold, 1.0, 1.0, 1.0, 1.0, 0.0)
        self.par = dict.fromkeys(LAW, 0.0) | dict(zip(PARAMETERS[len(LAW) :], numbers, strict=True))
        d = damping_factor("hu-guo", contact.restitution, 1.5, 1.5)
        self.par |= {"m_t": m_t, "m_p": m_p, "k_c": contact.stiffness, "d": d}
        if isinstance(coupling, ig.SpringDamper):
            c_t = 2.0 * coupling.damping_ratio * math.sqrt(coupling.stiffness * m_t)
            self.par |= {"k_t": coupling.stiffness, "c_t": c_t}
        if isinstance(coupling, ig.Bistable):
            law = BistableForce(coupling, m_t)
            self.par |= {"k_t": law.k, "L0": law.L0, "H": law.H, "x0": law.x0, "k_s": law.k_s, "c_s": law.c_s}
            self.par |= {"front": coupling.front_stop, "rear": coupling.rear_stop}
        # times (s) at which the commanded acceleration changes, and the new accelerations (m/s^2; nan: end of the run)
        self.changes = [(motion.speed / motion.acceleration, 0.0), (duration, math.nan)]
        self.seconds = [0.0, 0.0]  # s, processor time of heyoka in flight and in contacts
        self.peak, self.detection, self.passes = 0.0, math.nan, 0

    def solve(self) -> Solution:
        """Integrate flights and contacts in turn."""
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
        (made, events), par = self.integrators[touching], self.par
        unit, event = par["length"] / par["speed"], ""
        made.time, made.state[:] = self.number(0.0), [*map(self.number, state)]
        made.reset_cooldowns()
        while self.changes and event != "touching":
            par["cut"] = (self.changes[0][0] - begun) / unit
            values = [*map(self.number, par.values())][: len(made.pars)]
            longest = self.number(FOREVER if touching else par["cut"] - state[3])
            started = process_time()
            made.pars[:] = values
            event = events[int(made.propagate_for(longest)[0])]
            state = made.state.tolist()
            self.seconds[touching] += process_time() - started
            self._note(event, begun + unit * state[3], state, touching)
        return begun + unit * state[3], state

    def _note(self, event: str, t: float, state: list[float], touching: bool) -> None:
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
