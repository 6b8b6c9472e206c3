"""Forces and accelerations of object, tool and flange.

The positions are x_p of the object, x_t of the tool, x_f of the flange, and x_r of the commanded motion. The
penetration is delta = x_t - x_p; the deflections are u = x_f - x_t of the coupling and w = x_r - x_f of the robot. The
forces are F of the tool on the object, T of the coupling on the tool, and R of the robot's stiffness and damping on the
robot's mass. The state is y = (delta, delta', u, u', w, w', impulse of F, impulse of T).
"""

from dataclasses import dataclass
from math import inf, nan, sqrt
from typing import Any

import numpy as np

from experiments.reference.command import Command
from experiments.reference.integration import Switch, Vector
from experiments.reference.laws import BistableForce, StoppedSpring, damping_factor, robot_law

# values of `Switch.slack`, an allowance for rounding errors; values without a unit are in units of `System.scales`
SLACK = 1e-12  # for sign and slope of the contact force, and for the velocity of a sliding object
STEADY = 1e-9  # for the contact force minus friction
POSITION_SLACK = 1e-16  # m, for the position of the slider
G = 9.80665  # m/s^2


@dataclass(frozen=True)
class Scales:
    """Units of a contact, in SI; the units of flight are `UNITS`."""

    length: float  # m, delta0 of `experiments.reference`
    time: float  # s, t0 of `experiments.reference`
    force: float  # N, F0 of `experiments.reference`

    @property
    def state(self) -> Vector:
        """Units of the first six elements of the state (m, m/s, ...)."""
        return np.tile([self.length, self.length / self.time], 3)


UNITS = Scales(1.0, 1.0, 1.0)


class Chain:
    """Bodies and force laws of a scene (SI units); `on`: whether each switch is on. `motion` may be a `Command`."""

    def __init__(self, scene: Any, motion: Any) -> None:
        coupling, contact, robot = scene.coupling, scene.contact, getattr(scene, "robot", None)
        self.m_t, self.m_p, self.k_c = scene.tool.mass, scene.object.mass, contact.stiffness
        self.m = float(getattr(contact, "stiffness_exponent", 1.5))
        self.n = float(getattr(contact, "damping_exponent", 1.5))
        self.d = damping_factor(getattr(contact, "dissipation", "hu-guo"), contact.restitution, self.m, self.n)
        self.reference_velocity = getattr(contact, "reference_velocity", None)  # m/s, for "fixed" dissipation
        self.friction = (getattr(scene.object, "friction", None) or 0.0) * self.m_p * G  # N, while the object slides
        self.on = dict.fromkeys(("pressed", "loading", "alignment", "gaining"), True)
        self.on |= {"rear": False, "sliding": False, "front": hasattr(coupling, "free_length")}

        self.bistable = BistableForce(coupling, self.m_t) if self.on["front"] else None
        if getattr(coupling, "damping_ratio", None) is not None and coupling.stroke:
            self.bistable = StoppedSpring(coupling, self.m_t)
        sprung = self.bistable is None and hasattr(coupling, "damping_ratio")
        self.rigid = self.bistable is None and not sprung
        if type(coupling).__name__ not in ("Rigid", "SpringDamper", "Bistable"):
            raise NotImplementedError(f"the reference has no equations of the coupling {coupling!r}")
        self.k_t = coupling.stiffness if sprung else 0.0
        self.c_t = 2 * coupling.damping_ratio * sqrt(self.k_t * self.m_t) if sprung else 0.0

        self.command = motion if isinstance(motion, Command) else Command(motion)
        self.robot = None if robot is None else robot_law(robot)
        nodes = getattr(robot, "position", ())  # m, positions in a table of robot parameters
        self.command.nodes = np.array(nodes)
        self.linear = self.bistable is None and not len(nodes) and not self.friction
        slow, fast = [0.0], [0.0]  # 1/s, rates of the robot and of a coupling with stops; rates of the stops
        if robot is not None:
            slow.append(float(np.sqrt(np.max(np.divide(robot.stiffness, robot.mass)))))
        if self.bistable is not None:
            stopped = isinstance(self.bistable, StoppedSpring)
            slope = 1.0 if stopped else self.bistable.L0 / self.bistable.H - 1
            slow.append(sqrt(self.bistable.k * slope / self.m_t))
            fast += [sqrt(self.bistable.k_s / self.m_t), self.bistable.c_s / self.m_t]
        self.slow_rate, self.stop_rate, self.stop_decay = max(slow), max(fast[:2]), max(fast)

    def damping(self, t: float, v_in: float) -> float:
        """Return the damping factor d of a contact that begins at t (s) with the approach velocity v_in (m/s)."""
        if self.reference_velocity is None:
            return self.d
        there, here = (self.contact_scales(t, v).length for v in (self.reference_velocity, v_in))
        chi = self.d * self.k_c * there ** (self.m - self.n) / self.reference_velocity
        return float(chi * v_in / (self.k_c * here ** (self.m - self.n)))

    def contact_scales(self, t: float, v_in: float) -> Scales:
        """Return the scales of a contact that begins at t (s) with the approach velocity v_in (m/s)."""
        m_t = self.m_t
        if self.rigid:
            m_t = inf if self.robot is None else m_t + self.robot(self.command.at(t)[0])[0]
        M = 1 / (1 / m_t + 1 / self.m_p)
        delta0 = (M * v_in**2 / self.k_c) ** (1 / (self.m + 1))
        return Scales(delta0, delta0 / v_in, M * v_in**2 / delta0)


class System:
    """The scaled equations of one flight or contact. A phase is a part of a flight or contact with smooth equations."""

    def __init__(self, chain: Chain, scales: Scales, touching: bool, damping: float = 0.0) -> None:
        self.chain, self.scales, self.touching, self.on = chain, scales, touching, chain.on
        self.on["pressed"] = self.on["loading"] = self.on["gaining"] = True
        self.d, self.m, self.n, self.friction = damping, chain.m, chain.n, chain.friction / scales.force
        self.stiffness_unit = scales.force / scales.length
        self.damping_unit = scales.force / scales.length * scales.time
        self.mass_unit = self.damping_unit * scales.time
        self.m_t, self.m_p = chain.m_t / self.mass_unit, chain.m_p / self.mass_unit
        self.k_t, self.c_t = chain.k_t / self.stiffness_unit, chain.c_t / self.damping_unit

    def enter(self, t: float) -> float:
        """Begin a phase at t (s); return the time (s) at which the command reaches its next piece or node."""
        self.x_r, self.v_r, self.a, cut = self.chain.command.at(t)
        self.alpha = self.a * self.scales.time**2 / self.scales.length
        return cut

    def robot(self, tau: float) -> tuple[float, float, float]:
        """Return the robot's mass, stiffness and damping at the time tau after the start of the phase, all scaled."""
        assert self.chain.robot is not None
        s = tau * self.scales.time
        m_r, k_r, c_r = self.chain.robot(self.x_r + (self.v_r + self.a * s / 2) * s)
        return m_r / self.mass_unit, k_r / self.stiffness_unit, c_r / self.damping_unit

    def force(self, y: Any) -> float:
        """Return the contact force F, scaled (paper, eq. 5)."""
        if not (self.touching and self.on["pressed"]):
            return 0.0
        u = y[0] if y[0] > 0 else 0.0
        return float(u**self.m + self.d * u**self.n * y[1])

    def coupling_force(self, u: float, u_dot: float) -> float:
        """Return the force T of a spring or a bistable mechanism on the tool, scaled."""
        if self.chain.bistable is None:
            return self.k_t * u + self.c_t * u_dot
        length, time = self.scales.length, self.scales.time
        return self.chain.bistable.force(length * u, length / time * u_dot, self.on) / self.scales.force

    def derivatives(self, tau: float, y: list[float], alpha: float) -> list[float]:
        """Return the derivative of y at the commanded acceleration alpha, all scaled (paper, eq. 8-9 and 17-18)."""
        _, rate, u, u_dot, w, w_dot, _, _ = y
        F, T = self.force(y), self.coupling_force(u, u_dot)
        x_t_ddot = x_f_ddot = alpha
        if self.chain.robot is not None:
            m_r, k_r, c_r = self.robot(tau)
            R = k_r * w + c_r * w_dot
            if self.chain.rigid:
                T, x_f_ddot = R, (R - F) / (m_r + self.m_t)
                x_t_ddot = x_f_ddot
            else:
                x_f_ddot = (R - T) / m_r
        elif self.chain.rigid:
            T = self.m_t * alpha + F
        if not self.chain.rigid:
            x_t_ddot = (T - F) / self.m_t
        x_p_ddot = (F - self.friction) / self.m_p if self.on["sliding"] or not self.friction else 0.0
        return [rate, x_t_ddot - x_p_ddot, u_dot, x_f_ddot - x_t_ddot, w_dot, alpha - x_f_ddot, F, T]

    def object_velocity(self, tau: float, y: Any) -> float:
        """Return the velocity of an object with friction, scaled."""
        v_r = self.v_r + self.a * tau * self.scales.time
        return float(v_r * self.scales.time / self.scales.length - y[5] - y[3] - y[1])

    def rates(self, tau: float, y: Vector) -> list[float]:
        """Return `derivatives`, or nan after an overflow in a trial step."""
        try:
            return self.derivatives(tau, y.tolist(), self.alpha)
        except OverflowError:
            return [nan] * 8

    def matrix(self) -> Vector:
        """Return A of z' = A z for a linear chain in flight, with z = (delta, delta', u, u', w, w', 1)."""
        A = np.zeros((7, 7))
        A[:6, 6] = self.derivatives(0.0, [0.0] * 8, self.alpha)[:6]
        A[:6, :6] = np.array([self.derivatives(0.0, unit, 0.0) for unit in np.eye(8)[:6].tolist()]).T[:6]
        return A

    def switches(self) -> list[Switch]:
        """Return the switches that may change in this phase."""
        chain, on = self.chain, self.on
        watched = [Switch("touching", self.touching, lambda _, y: y[0])]
        if self.touching and self.d > 0:
            watched.append(Switch("pressed", on["pressed"], self._sign_of_force, SLACK))
        if self.touching and on["pressed"]:
            watched.append(Switch("loading", on["loading"], self._slope_of_force, SLACK))
            if chain.command.detection_time is None and chain.command.threshold < inf:
                threshold = chain.command.threshold / self.scales.force
                watched.append(Switch("alarm", False, lambda _, y: self.force(y) - threshold))
        if chain.friction and on["sliding"]:
            watched.append(Switch("sliding", True, self.object_velocity, SLACK))
            if self.touching:
                watched.append(Switch("gaining", on["gaining"], lambda _, y: self.force(y) - self.friction, STEADY))
        elif chain.friction and self.touching:
            watched.append(Switch("sliding", False, lambda _, y: self.force(y) - self.friction))
        if chain.bistable is not None:
            length, speed, law = self.scales.length, self.scales.length / self.scales.time, chain.bistable
            push = law.k_s * POSITION_SLACK
            watched += [
                Switch("front", on["front"], lambda _, y: law.front(length * y[2], speed * y[3]), push),
                Switch("rear", on["rear"], lambda _, y: law.rear(length * y[2], speed * y[3]), push),
            ]
            if not isinstance(law, StoppedSpring):
                watched.append(
                    Switch("alignment", on["alignment"], lambda _, y: law.x0 - length * y[2], POSITION_SLACK)
                )
        return watched

    def _sign_of_force(self, _: float, y: list[float]) -> float:
        """Return the contact force divided by delta^min(m, n)."""
        u, m, n = max(y[0], 0.0), self.m, self.n
        return float(u ** (m - n) + self.d * y[1] if n < m else 1 + self.d * u ** (n - m) * y[1])

    def _slope_of_force(self, tau: float, y: list[float]) -> float:
        """Return the rate of the contact force, divided by a positive factor."""
        u, v, m, n, d = max(y[0], 0.0), y[1], self.m, self.n, self.d
        if d == 0:
            return v
        v_dot = self.derivatives(tau, y, self.alpha)[1]
        low = min(m, n) if n else 1.0
        damping = v_dot if n == 0 else n * u ** (n - low) * v * v + u ** (n - low + 1) * v_dot
        return float(m * u ** (m - low) * v + d * damping)
