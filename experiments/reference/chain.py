"""Forces and accelerations of object, tool and flange.

The positions are x_p of the object, x_t of the tool, x_f of the flange, and x_r of the commanded motion. The
penetration is delta = x_t - x_p; the deflections are u = x_f - x_t of the coupling and w = x_r - x_f of the robot. The
forces are F of the tool on the object, T of the coupling on the tool, and R of the robot's stiffness and damping on the
robot's mass. The state is y = (delta, delta', u, u', w, w', impulse of F, impulse of T), in SI units.
"""

from math import inf, nan, sqrt
from typing import Any, NamedTuple

import numpy as np

from experiments.reference.command import Command
from experiments.reference.integration import Switch, Vector
from experiments.reference.laws import BistableForce, StoppedSpring, damping_factor, robot_law

# allowances for rounding errors, values of `Switch.slack`; values without a unit are in units of `Scales`
SLACK = 1e-12  # for sign and slope of the contact force, and for the velocity of a sliding object
FRICTION_SLACK = 1e-9  # for the contact force minus friction
POSITION_SLACK = 1e-16  # m, for the position of the slider
G = 9.80665  # m/s^2


class Scales(NamedTuple):
    """Units of a contact: delta0 (m), t0 (s) and F0 (N) of `experiments.reference`."""

    length: float
    time: float
    force: float

    @property
    def state(self) -> Vector:
        """Units of the state."""
        return np.array([self.length, self.length / self.time] * 3 + [self.force * self.time] * 2)


class Chain:
    """The equations of a scene. A phase is a part of a flight or contact with smooth equations.

    `scales`: units of the current contact; None in flight. `on`: whether each switch is on, see `switches`. `motion`
    may be a `Command`.
    """

    def __init__(self, scene: Any, motion: Any) -> None:
        coupling, contact, robot, kind = scene.coupling, scene.contact, scene.robot, type(scene.coupling).__name__
        if kind not in ("Rigid", "SpringDamper", "Bistable"):
            raise NotImplementedError(f"the reference has no equations of the coupling {coupling!r}")
        self.m_t, self.m_p, self.k_c = scene.tool.mass, scene.object.mass, contact.stiffness
        self.m, self.n = contact.stiffness_exponent, contact.damping_exponent
        self.nominal_d = damping_factor(contact.dissipation, contact.restitution, self.m, self.n)
        self.reference_velocity = contact.reference_velocity  # m/s, for "fixed" dissipation
        self.friction = (scene.object.friction or 0.0) * self.m_p * G  # N, while the object slides
        self.on = dict.fromkeys(("pressed", "loading", "alignment", "gaining"), True)
        self.on |= {"rear": False, "sliding": False, "front": kind == "Bistable"}
        self.scales: Scales | None = None
        self.d = 0.0  # damping factor of the current contact

        self.rigid, self.k_t, self.c_t = kind == "Rigid", 0.0, 0.0
        self.stopped: BistableForce | None = None  # force of a coupling with stops
        if kind == "Bistable":
            self.stopped = BistableForce(coupling, self.m_t)
        elif kind == "SpringDamper" and coupling.stroke:
            self.stopped = StoppedSpring(coupling, self.m_t)
        elif kind == "SpringDamper":
            self.k_t, self.c_t = coupling.stiffness, 2 * coupling.damping_ratio * sqrt(coupling.stiffness * self.m_t)

        self.command = motion if isinstance(motion, Command) else Command(motion)
        self.robot = None if robot is None else robot_law(robot)
        nodes = getattr(robot, "position", ())  # m, positions in a table of robot parameters
        self.command.nodes = np.array(nodes)
        self.linear = self.stopped is None and not len(nodes) and not self.friction
        # 1/s: rate of robot and of a coupling with stops; rate of the stops; largest rate or decay of the stops
        self.slow_rate, self.stop_rate, self.stop_decay = 0.0, 0.0, 0.0
        if robot is not None:
            self.slow_rate = float(np.sqrt(np.max(np.divide(robot.stiffness, robot.mass))))
        if self.stopped is not None:
            self.slow_rate = max(self.slow_rate, sqrt(self.stopped.steepest / self.m_t))
            self.stop_rate = sqrt(self.stopped.k_s / self.m_t)
            self.stop_decay = max(self.stop_rate, self.stopped.c_s / self.m_t)

    def contact_scales(self, t: float, v_in: float) -> Scales:
        """Return the scales of a contact that begins at t (s) with the approach velocity v_in (m/s)."""
        m_t = self.m_t
        if self.rigid:
            m_t = inf if self.robot is None else m_t + self.robot(self.command.at(t)[0])[0]
        M = 1 / (1 / m_t + 1 / self.m_p)
        delta0 = (M * v_in**2 / self.k_c) ** (1 / (self.m + 1))
        return Scales(delta0, delta0 / v_in, M * v_in**2 / delta0)

    def begin(self, t: float, v_in: float | None) -> None:
        """Begin a contact at t (s) with the approach velocity v_in (m/s), or a flight (None)."""
        self.on["pressed"] = self.on["loading"] = self.on["gaining"] = True
        self.scales = None if v_in is None else self.contact_scales(t, v_in)
        self.d = self.nominal_d
        if self.scales is not None and self.reference_velocity is not None:
            there = self.contact_scales(t, self.reference_velocity).length
            self.d *= v_in / self.reference_velocity * (there / self.scales.length) ** (self.m - self.n)

    def enter(self, t: float) -> float:
        """Begin a phase at t (s); return the time (s) at which the command reaches its next piece or node."""
        self.x_r, self.v_r, self.a, cut = self.command.at(t)
        return cut

    def scaled(self, y: Any) -> tuple[float, float]:
        """Return penetration, if it is positive, and its rate, in the units of the contact."""
        assert self.scales is not None
        length, time, _ = self.scales
        return max(y[0], 0.0) / length, y[1] / length * time

    def force(self, y: Any) -> float:
        """Return the contact force F, N (paper, eq. 5)."""
        if self.scales is None or not self.on["pressed"]:
            return 0.0
        u, v = self.scaled(y)
        return float(self.scales.force * (u**self.m + self.d * u**self.n * v))

    def derivatives(self, tau: float, y: list[float], alpha: float) -> list[float]:
        """Return y' at tau (s) after the start of the phase, for the commanded acceleration alpha (m/s^2).

        Paper, eq. 8-9 and 17-18.
        """
        _, rate, u, u_dot, w, w_dot, _, _ = y
        F = self.force(y)
        T = self.k_t * u + self.c_t * u_dot if self.stopped is None else self.stopped.force(u, u_dot, self.on)
        x_t_ddot = x_f_ddot = alpha
        if self.robot is not None:
            m_r, k_r, c_r = self.robot(self.x_r + (self.v_r + self.a * tau / 2) * tau)
            R = k_r * w + c_r * w_dot
            if self.rigid:
                T, x_f_ddot = R, (R - F) / (m_r + self.m_t)
                x_t_ddot = x_f_ddot
            else:
                x_f_ddot = (R - T) / m_r
        elif self.rigid:
            T = self.m_t * alpha + F
        if not self.rigid:
            x_t_ddot = (T - F) / self.m_t
        x_p_ddot = (F - self.friction) / self.m_p if self.on["sliding"] or not self.friction else 0.0
        return [rate, x_t_ddot - x_p_ddot, u_dot, x_f_ddot - x_t_ddot, w_dot, alpha - x_f_ddot, F, T]

    def object_velocity(self, tau: float, y: Any) -> float:
        """Return the velocity (m/s) of an object with friction, tau (s) after the start of the phase."""
        return float(self.v_r + self.a * tau - y[5] - y[3] - y[1])

    def rates(self, tau: float, y: Vector) -> list[float]:
        """Return `derivatives`, or nan after an overflow in a trial step."""
        try:
            return self.derivatives(tau, y.tolist(), self.a)
        except OverflowError:
            return [nan] * 8

    def matrix(self) -> Vector:
        """Return A of z' = A z for a linear chain in flight, with z = (delta, delta', u, u', w, w', 1)."""
        A = np.zeros((7, 7))
        A[:6, 6] = self.derivatives(0.0, [0.0] * 8, self.a)[:6]
        A[:6, :6] = np.array([self.derivatives(0.0, unit, 0.0) for unit in np.eye(8)[:6].tolist()]).T[:6]
        return A

    def switches(self) -> list[Switch]:
        """Return the switches that may change in this phase."""
        on, command, law = self.on, self.command, self.stopped
        watched = [Switch("touching", self.scales is not None, lambda _, y: y[0])]
        if self.scales is not None:
            force = self.scales.force
            if self.d > 0:
                watched.append(Switch("pressed", on["pressed"], self._sign_of_force, SLACK))
            if on["pressed"]:
                watched.append(Switch("loading", on["loading"], self._slope_of_force, SLACK))
                if command.detection_time is None and command.threshold < inf:
                    watched.append(Switch("alarm", False, lambda _, y: self.force(y) - command.threshold))
            if self.friction:
                name, slack = ("gaining", FRICTION_SLACK * force) if on["sliding"] else ("sliding", 0.0)
                watched.append(Switch(name, on[name], lambda _, y: self.force(y) - self.friction, slack))
        if on["sliding"]:
            speed = 1.0 if self.scales is None else self.scales.length / self.scales.time
            watched.append(Switch("sliding", True, self.object_velocity, SLACK * speed))
        if law is not None:
            push = law.k_s * POSITION_SLACK
            watched.append(Switch("front", on["front"], lambda _, y: law.front(y[2], y[3]), push))
            watched.append(Switch("rear", on["rear"], lambda _, y: law.rear(y[2], y[3]), push))
            if not isinstance(law, StoppedSpring):
                watched.append(Switch("alignment", on["alignment"], lambda _, y: law.x0 - y[2], POSITION_SLACK))
        return watched

    def _sign_of_force(self, _: float, y: list[float]) -> float:
        """Return the contact force divided by delta^min(m, n), in the units of the contact."""
        (u, v), m, n = self.scaled(y), self.m, self.n
        return float(u ** (m - n) + self.d * v if n < m else 1 + self.d * u ** (n - m) * v)

    def _slope_of_force(self, tau: float, y: list[float]) -> float:
        """Return the rate of the contact force, divided by a positive factor, in the units of the contact."""
        (u, v), m, n, d = self.scaled(y), self.m, self.n, self.d
        if d == 0:
            return v
        assert self.scales is not None
        v_dot = self.derivatives(tau, y, self.a)[1] * self.scales.time**2 / self.scales.length
        low = min(m, n) if n else 1.0
        damping = v_dot if n == 0 else n * u ** (n - low) * v * v + u ** (n - low + 1) * v_dot
        return float(m * u ** (m - low) * v + d * damping)
