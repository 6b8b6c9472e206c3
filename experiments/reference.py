"""The slow, obvious, independent solver that the fast one is checked against.

Shares no code with `impact_gym`: it reads the attributes of a scene and of a motion, no more. It knows a tool
held rigidly or by a linear spring and damper, the Hertz contact with Hu-Guo damping (paper, eq. 5-7, 17-18)
and the trapezoid with its brake, and refuses the rest. The motion is cut into phases with smooth equations.
Flight is linear: the matrix exponential carries it, exactly, whatever the method. A contact is handed to
`scipy.integrate.solve_ivp` in the variables

    tau = t/t0,  x = delta/delta0,  u = (x_c - x_t)/delta0,  forces in F0,
    delta0 = (M v_in^2/k_c)^(2/5),  t0 = delta0/v_in,  F0 = k_c delta0^(3/2) = M v_in/t0

and cut again where the force reaches the brake's threshold, where the flange's acceleration changes and where
F is clamped at zero or released. `method`, `rtol` and `evaluations` are about the contacts only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

Vector = NDArray[np.float64]
Gauge = Callable[[float, Vector], float]
TIGHT = {"xtol": 1e-18, "rtol": 4 * np.finfo(float).eps}  # brentq: s, relative


@dataclass(frozen=True)
class ContactRecord:
    """One contact. Times in s, velocities in m/s; `end`, `separation_velocity` are None if unfinished."""

    start: float
    end: float | None
    approach_velocity: float  # v_t - v_p at the start
    separation_velocity: float | None  # v_p - v_t at the end
    peak_force: float  # N
    impulse: float  # N s, given to the object
    object_velocity: float  # at the end


@dataclass(frozen=True)
class Reference:
    """State at the end of the run (m/s) and what happened on the way."""

    object_velocity: float
    tool_velocity: float
    flange_velocity: float
    peak_force: float  # N
    detection_time: float | None  # s; None: the force never exceeded the brake's threshold
    contacts: tuple[ContactRecord, ...]
    coupling_impulse: float  # N s, of the coupling on the tool over the contacts (paper, eq. 21)
    evaluations: int  # of the right-hand side


class _Flange:
    """Imposed motion: pieces (start s, velocity m/s, acceleration m/s^2) in order, the last without end."""

    def __init__(self, motion: Any) -> None:
        v, a, brake = float(motion.speed), float(motion.acceleration), motion.brake
        self.pieces = [(0.0, 0.0, a), (v / a, v, 0.0)]
        self.detection_time: float | None = None
        self.threshold = inf if brake is None else float(brake.threshold)  # N
        self.delay = 0.0 if brake is None else float(brake.delay)  # s
        self.deceleration = a if brake is None or brake.deceleration is None else brake.deceleration

    def at(self, t: float) -> tuple[float, float, float]:
        """Velocity (m/s), acceleration (m/s^2) and when the acceleration changes next (s)."""
        start, v, a = [p for p in self.pieces if p[0] <= t][-1]
        return v + a * (t - start), a, min((p[0] for p in self.pieces if p[0] > t), default=inf)

    def detect(self, t: float) -> None:
        """The force passed the threshold at t: from t + delay, brake to rest."""
        self.detection_time, t_b = t, t + self.delay
        v_b = self.at(t_b)[0]
        self.pieces = [p for p in self.pieces if p[0] < t_b]
        self.pieces += [(t_b, v_b, -self.deceleration), (t_b + v_b / self.deceleration, 0.0, 0.0)]


class _Run:
    """The two masses and what joins them to the flange (SI units), and what the contacts have added up to."""

    def __init__(self, scene: Any, motion: Any) -> None:
        coupling, contact, self.flange = scene.coupling, scene.contact, _Flange(motion)
        self.rigid = not hasattr(coupling, "damping_ratio")
        if getattr(scene, "robot", None) is not None or (self.rigid and hasattr(coupling, "stiffness")):
            raise NotImplementedError("reference: a rigid robot with a rigid or spring-damper coupling only")
        law = [getattr(contact, n, 1.5) for n in ("stiffness_exponent", "damping_exponent")]
        if law != [1.5, 1.5] or getattr(contact, "dissipation", "hu-guo") != "hu-guo":
            raise NotImplementedError("reference: exponents 1.5 and dissipation 'hu-guo' only")
        self.m_t, self.m_p, self.k_c = scene.tool.mass, scene.object.mass, contact.stiffness
        self.M = self.m_p if self.rigid else self.m_t * self.m_p / (self.m_t + self.m_p)
        self.d = 1.5 * (1 - contact.restitution) / contact.restitution  # chi v_in / k_c (paper, eq. 7)
        self.k_t = 0.0 if self.rigid else coupling.stiffness
        self.c_t = 0.0 if self.rigid else 2 * coupling.damping_ratio * sqrt(self.k_t * self.m_t)
        self.contacts: list[ContactRecord] = []
        self.impulse = self.coupling_impulse = 0.0  # N s, on the object; of the coupling on the tool
        self.evaluations = 0


def simulate(
    scene: Any,
    motion: Any,
    duration: float,
    rtol: float = 1e-11,
    method: str = "DOP853",
) -> Reference:
    """Run `scene` under `motion` for `duration` seconds; `method` is any of solve_ivp's."""
    run = _Run(scene, motion)
    t, z = 0.0, np.array([-scene.object.distance, 0.0, 0.0, 0.0, 1.0])
    while t < duration:
        t, z, touching = _fly(run, t, z, duration)
        if touching:
            t, z = _collide(run, t, z, duration, rtol, method)
    v_c = run.flange.at(duration)[0]
    return Reference(
        object_velocity=run.impulse / run.m_p,
        tool_velocity=v_c - float(z[3]),
        flange_velocity=v_c,
        peak_force=max((c.peak_force for c in run.contacts), default=0.0),
        detection_time=run.flange.detection_time,
        contacts=tuple(run.contacts),
        coupling_impulse=run.coupling_impulse,
        evaluations=run.evaluations,
    )


def _fly(run: _Run, t: float, z: Vector, t_end: float) -> tuple[float, Vector, bool]:
    """Fly until the faces meet or t_end: z' = A z, z = (delta, delta_dot, u, u_dot, 1), u = x_c - x_t, SI."""
    k, c, e = run.k_t / run.m_t, run.c_t / run.m_t, np.eye(5)
    while t < t_end:
        _, a, t_change = run.flange.at(t)
        x_t_ddot = a * e[4] if run.rigid else k * e[2] + c * e[3]  # the object coasts: delta'' = x_t''
        A = np.array([e[1], x_t_ddot, e[3], a * e[4] - x_t_ddot, 0 * e[4]])
        t_stop = min(t_change, t_end)
        n = ceil(max(8, 5 * (t_stop - t) * np.abs(np.linalg.eigvals(A)).max()))  # 5 per time constant
        h = (t_stop - t) / n
        P = expm(A * h)
        for i in range(n):
            z_next = P @ z
            s = _meeting(A, z, z_next, h)
            if s is not None:
                return t + i * h + s, expm(A * s) @ z, True
            z = z_next
        t = t_stop
    return t, z, False


def _meeting(A: Vector, z: Vector, z_next: Vector, h: float) -> float | None:
    """First s in (0, h] at which delta rises through 0, if any does: looks at the extremum of delta too."""

    def state(s: float, i: int) -> float:
        return float((expm(A * s) @ z)[i])

    marks = [0.0, h]
    if z[1] * z_next[1] < 0:
        marks.insert(1, brentq(state, 0, h, args=(1,), **TIGHT))
    elif z_next[0] <= 0:
        return None
    for a, b in pairwise(marks):
        if state(a, 0) <= 0 < state(b, 0):
            return float(brentq(state, a, b, args=(0,), **TIGHT))
    return None


def _collide(run: _Run, t: float, z: Vector, t_end: float, rtol: float, method: str) -> tuple[float, Vector]:
    """One contact, from its onset at t to its end or t_end: y = (x, x', u, u', impulse of F, of coupling)."""
    rigid, d, M, v_in, t_in, flange = run.rigid, run.d, run.M, float(z[1]), t, run.flange
    if not v_in > 0:
        raise ValueError(f"contact at {t:.6g} s begins at {v_in:.3g} m/s; eq. 7 needs an approach velocity")
    delta0 = (M * v_in**2 / run.k_c) ** 0.4
    t0, F0 = delta0 / v_in, M * v_in**2 / delta0
    k, c, mu_t, mu_p = run.k_t * delta0 / F0, run.c_t * v_in / F0, M / run.m_t, M / run.m_p
    alpha, pressed = 0.0, True  # acceleration of the flange; False while F is clamped

    def force(y: Vector) -> float:
        return float(max(y[0], 0.0) ** 1.5 * (1 + d * y[1])) if pressed else 0.0

    def rates(_: float, y: Vector) -> tuple[float, ...]:
        _, x_dot, u, u_dot, _, _ = y.tolist()
        F = force(y)
        T = alpha / mu_t + F if rigid else k * u + c * u_dot
        x_t_ddot = alpha if rigid else mu_t * (T - F)
        return x_dot, x_t_ddot - mu_p * F, u_dot, alpha - x_t_ddot, F, T

    def jacobian(_: float, y: Vector) -> Vector:
        x, e = max(y[0], 0.0) if pressed else 0.0, np.eye(6)
        dF, dT = 1.5 * sqrt(x) * (1 + d * y[1]) * e[0] + d * x**1.5 * e[1], k * e[2] + c * e[3]
        dx_t_ddot = 0 * dF if rigid else mu_t * (dT - dF)
        return np.array([e[1], dx_t_ddot - mu_p * dF, e[3], -dx_t_ddot, dF, dF if rigid else dT])

    def force_slope(_: float, y: Vector) -> float:  # F' / sqrt(x)
        return float(1.5 * y[1] * (1 + d * y[1]) + d * y[0] * rates(0.0, y)[1])

    def solve(start: float, end: float, y: Vector, events: list[Gauge] | None = None) -> Any:
        options: dict[str, Any] = {"jac": jacobian} if method in ("Radau", "BDF", "LSODA") else {}
        options |= {"rtol": rtol, "atol": rtol / 100}
        sol = solve_ivp(rates, (start, end), y, method, events=events, **options)
        run.evaluations += sol.nfev
        if sol.status < 0:
            raise RuntimeError(f"contact at {t_in:.6g} s, v_in = {v_in:.3g} m/s: {sol.message}")
        return sol

    leave, shallowest = _event(lambda _, y: y[0], -1), _event(lambda _, y: y[1], 1, terminal=False)
    summit = _event(force_slope, -1, terminal=False)
    clamp, release = _event(lambda _, y: 1 + d * y[1], -1), _event(lambda _, y: 1 + d * y[1], 1)
    alarm = _event(lambda _, y: force(y) * F0 - flange.threshold, 1)

    y, peak, touching = np.array([0.0, 1.0, z[2] / delta0, z[3] / v_in, 0.0, 0.0]), 0.0, True
    while touching and t < t_end:
        _, a, t_change = flange.at(t)
        alpha, t_stop = a * t0 / v_in, min(t_change, t_end)
        watch = pressed and flange.detection_time is None and flange.threshold < inf
        events = [leave, shallowest, summit, clamp if pressed else release] + [alarm] * watch
        sol = solve(0.0, (t_stop - t) / t0, y, events)
        turns = [(s, w) for i in (1, 2) for s, w in zip(sol.t_events[i], sol.y_events[i], strict=True)]
        missed = min((s for s, w in turns if w[0] < 0 or (watch and alarm(s, w) > 0)), default=inf)
        if missed < sol.t[-1]:  # there and back within a step, unseen: stop between the two crossings
            sol, t_stop = solve(0.0, missed, y, events), t + missed * t0
        tau, y = float(sol.t[-1]), sol.y[:, -1]
        peak = max(peak, force(y), *map(force, sol.y_events[2]))
        if sol.status == 1:  # a step that ends on the event is more accurate than the interpolant
            y = solve(sol.t[-2], tau, sol.y[:, -2]).y[:, -1]
        t = t + tau * t0 if sol.status == 1 else t_stop
        if sol.t_events[0].size:
            y[0], touching = 0.0, False
        elif sol.t_events[3].size:
            pressed = not pressed
        elif sol.status == 1:
            flange.detect(t)

    impulse = M * v_in * float(y[4])
    run.impulse += impulse
    run.coupling_impulse += M * v_in * float(y[5])
    end, v_out = (None, None) if touching else (t, -v_in * float(y[1]))
    run.contacts.append(ContactRecord(t_in, end, v_in, v_out, F0 * peak, impulse, run.impulse / run.m_p))
    return t, np.array([delta0 * y[0], v_in * y[1], delta0 * y[2], v_in * y[3], 1.0])


def _event(g: Gauge, sign: int, terminal: bool = True) -> Gauge:
    """Give g the attributes by which solve_ivp knows an event."""
    g.direction, g.terminal = sign, terminal  # type: ignore[attr-defined]
    return g
