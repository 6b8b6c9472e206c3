"""Whole approaches by heyoka's Taylor integrator (Biscani, Izzo 2021), which shares nothing with the solver.

A contact runs in its own scales delta0 = (M v_in^2/k_c)^0.4, v_in and t0 = delta0/v_in, and as in our solver in the
root s of the penetration, with dt = t0 s dsigma: there Hertz' law is a polynomial, so that Taylor series converge from
onset to separation. Flight runs in SI units, with the penetration itself. Whatever ends a smooth piece is a terminal
event: onset and separation, a change of the flange's acceleration, the alarm, the force's peak, its clamp at zero,
a stop that pushes or lets go, the slider's alignment.
"""

import math
from functools import cache

import impact_gym as ig
from experiments.reference.laws import BistableForce, damping_factor
from experiments.studies.solvers.solutions import Solution

RIGID, SPRING, BISTABLE = range(3)
LAW = ("m_t", "m_p", "k_c", "d", "k_t", "c_t", "L0", "H", "x0", "front", "rear", "k_s", "c_s")
PARAMETERS = (*LAW, "a", "cut", "alarm", "length", "speed", "pressed", "front_on", "rear_on")
FOREVER = 1e12  # in the units of a piece; its end is an event
BESIDE = 1e-20  # where a piece begins: heyoka passes over an event whose gauge begins at zero
ROUNDING = 1e-12  # m, of a slider's place


def law_of(scene):
    """Numbers of the bodies, their contact and coupling, and the kind of the coupling; SI, in the order of LAW."""
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


@cache
def piece(kind, touching, tolerance):
    """The integrator of a flight or contact of one kind of coupling, compiled, and its events by their outcome.

    The state is s or the penetration, its rate w, the object's velocity v, the time tau since the piece began and, with
    a coupling, the tool's deflection y from the flange and its rate q.
    """
    import heyoka as hy  # an extra

    s, w, v, tau, y, q = hy.make_vars("s", "w", "v", "tau", "y", "q")
    par = {name: hy.par[place] for place, name in enumerate(PARAMETERS)}
    length, speed, a = par["length"], par["speed"], par["a"]
    events = [("touching", s, -1 if touching else 1)]
    x, x_dot = par["x0"] + length * y, speed * q
    if kind == SPRING:
        T = -par["k_t"] * x - par["c_t"] * x_dot
    elif kind == BISTABLE:  # paper, eq. 23-24, and the two stops
        L = hy.sqrt(par["H"] ** 2 + x**2)
        front = par["k_s"] * (x - par["front"]) + par["c_s"] * x_dot
        rear = par["k_s"] * (par["rear"] - x) - par["c_s"] * x_dot
        T = par["k_t"] * (par["L0"] - L) * x / L - par["front_on"] * front + par["rear_on"] * rear
        events += [("alignment", x, 0), ("front_on", x - par["front"], 1), ("front_on", front, 0)]
        events += [("rear_on", par["rear"] - x, 1), ("rear_on", rear, 0)]
    rate = s if touching else hy.expression(1.0)  # of time
    unit = rate * length / speed**2
    clamped = 1.0 + par["d"] * w
    # not s**3, whose series heyoka divides by s, which is zero at onset
    F = par["pressed"] * par["k_c"] * length**1.5 * (s * s * s) * clamped if touching else 0.0 * s  # paper, eq. 5 and 7
    tool = a if kind == RIGID else (T - F) / par["m_t"]
    w_dot = unit * (tool - F / par["m_p"])
    equations = [(s, 0.5 * w if touching else w), (w, w_dot), (v, unit * F / par["m_p"]), (tau, rate)]
    if kind != RIGID:
        equations += [(y, rate * q), (q, unit * (tool - a))]
    if touching:
        slope = 1.5 * w * clamped + par["d"] * s * w_dot  # of F, without s^2
        events += [("peak", slope, -1), ("pressed", clamped, 0), ("alarm", par["alarm"] * F - 1.0, 1)]
        events += [("cut", tau - par["cut"], 1)]
    way = {1: hy.event_direction.positive, -1: hy.event_direction.negative, 0: hy.event_direction.any}
    watched = [hy.t_event(gauge, direction=way[sign]) for _, gauge, sign in events]
    integrator = hy.taylor_adaptive(equations, [0.0] * len(equations), tol=tolerance, t_events=watched)
    names = {-1 - place: name for place, (name, _, _) in enumerate(events)}
    return integrator, names | {int(hy.taylor_outcome.time_limit): "cut"}


class Run:
    """An approach at a tolerance; making it compiles the pieces, unless an earlier one has."""

    def __init__(self, scene, motion, duration, tolerance):
        law, kind = law_of(scene)
        self.law, self.motion = dict(zip(LAW, law, strict=True)), motion
        self.distance, self.duration = scene.object.distance, duration
        self.pieces = [piece(kind, touching, tolerance) for touching in (False, True)]
        m_t, m_p = scene.tool.mass, scene.object.mass
        self.M = m_p if kind == RIGID else m_t * m_p / (m_t + m_p)  # kg

    def solve(self):
        """Go from event to event, and from piece to piece."""
        motion = self.motion
        numbers = (*self.law.values(), motion.acceleration, 0.0, 1.0 / motion.brake.threshold, 1.0, 1.0, 1.0, 1.0, 0.0)
        self.par = dict(zip(PARAMETERS, numbers, strict=True))
        self.changes = [(motion.speed / motion.acceleration, 0.0), (self.duration, math.nan)]  # s, m/s^2 from then on
        self.peak, self.detection, self.passes = 0.0, math.nan, 0
        rest = [0.0, 0.0]  # y and q, SI
        t, touching, begin, delta_dot, v_p, lasted, contacts = 0.0, False, -self.distance, 0.0, 0.0, 0.0, 0
        while self.changes:
            length = (self.M * delta_dot**2 / self.par["k_c"]) ** 0.4 if touching else 1.0
            speed = delta_dot if touching else 1.0
            self.par |= {"length": length, "speed": speed, "pressed": 1.0}
            state = [begin, delta_dot / speed, v_p / speed, 0.0, rest[0] / length, rest[1] / speed]
            end, (_, w, v, _, *scaled) = self._move(touching, t, state)
            delta_dot, v_p = w * speed, v * speed
            rest = [scaled[0] * length, scaled[1] * speed] if scaled else rest
            lasted, t = lasted + (end - t) * touching, end
            touching = not touching
            contacts += touching and bool(self.changes)
            begin = BESIDE if touching else -BESIDE
        return Solution(v_p, self.peak, lasted, self.detection, contacts, self.passes)

    def _move(self, touching, begun, state):
        """From `begun` (s) to the end of a flight, a contact or the run; return when, and the state."""
        (integrator, names), par = self.pieces[touching], self.par
        integrator.time, integrator.state[:] = 0.0, state[: len(integrator.state)]
        integrator.reset_cooldowns()
        time, event = par["length"] / par["speed"], ""
        while self.changes and event != "touching":
            par["cut"] = (self.changes[0][0] - begun) / time
            integrator.pars[:] = list(par.values())[: len(integrator.pars)]
            outcome, *_ = integrator.propagate_until(FOREVER if touching else par["cut"])
            event, state = names[int(outcome)], integrator.state.tolist()
            self._note(event, begun + time * state[3], state, touching)
        return begun + time * state[3], state

    def _note(self, event, t, state, touching):
        """Change what an event at t (s) changes."""
        motion, par = self.motion, self.par
        if touching:
            F = par["pressed"] * par["k_c"] * par["length"] ** 1.5 * state[0] ** 3 * (1.0 + par["d"] * state[1])
            self.peak = max(self.peak, F)
        if event == "cut":
            par["a"] = self.changes.pop(0)[1]
        elif event == "alarm":
            self.detection, brake, par["alarm"] = t, t + motion.brake.delay, 0.0
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
