"""Laws: the dissipation of a contact, the parameters of the robot, and the forces of couplings with stops."""

from collections.abc import Callable, Mapping
from functools import cache
from math import exp, hypot, log, sqrt
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

CLOSURES: dict[str, Callable[[float], float]] = {
    "hu-guo": lambda e: 1.5 * (1 - e) / e,  # paper, eq. 7; Hu and Guo 2015
    "hunt-crossley": lambda e: 1.5 * (1 - e),  # Hunt and Crossley 1975
    "lankarani-nikravesh": lambda e: 0.75 * (1 - e * e),  # Lankarani and Nikravesh 1990
    "flores": lambda e: 1.6 * (1 - e) / e,  # Flores, Machado, Silva and Martins 2011
    "gonthier": lambda e: (1 - e * e) / e,  # Gonthier, McPhee, Lange and Piedboeuf 2004
    "herbert-mcwhannell": lambda e: 6 * (1 - e) / ((2 * e - 1) ** 2 + 3),  # Herbert and McWhannell 1977
}
STIFF = 1e3  # damping factor d above which an implicit method integrates an isolated contact
RobotLaw = Callable[[float], tuple[float, float, float]]
"""Function from the commanded position (m) to the robot's mass (kg), stiffness (N/m) and damping (N s/m)."""


def damping_factor(name: str, e: float, m: float, n: float) -> float:
    """Return the factor d of the contact force u^m + d u^n u', for the restitution e and the law `name`.

    Penetration u and force are in the units of a contact, see `experiments.reference`. With "exact" the restitution
    of an isolated contact is exactly e. ValueError: no law has this name.
    """
    if name in CLOSURES:
        return CLOSURES[name](e)
    if name not in ("exact", "fixed"):  # "fixed" is "exact" at the reference velocity
        raise ValueError(f"reference: dissipation must be one of {[*CLOSURES, 'exact', 'fixed']}, got {name!r}")
    return _exact_factor(e, m, n) if e < 1 else 0.0


@cache
def _exact_factor(e: float, m: float, n: float) -> float:
    upper = 1.0
    while _isolated_restitution(upper, m, n) > e:
        upper *= 4
    ends = log((1 - e) / 10), log(upper)
    return exp(brentq(lambda x: log(_isolated_restitution(exp(x), m, n) / e), *ends, xtol=1e-13))


def _isolated_restitution(d: float, m: float, n: float) -> float:
    """Return -u' at the end of the contact u'' = -u^m - d u^n u' with u(0) = 0 and u'(0) = 1.

    If n < m, the contact ends when u'' = 0, otherwise when u = 0.
    """

    def rates(_: float, y: list[float]) -> tuple[float, float]:
        u = max(float(y[0]), 0.0)
        return y[1], -(u**m + d * u**n * y[1])

    def end(_: float, y: list[float]) -> float:
        return float(max(y[0], 0.0) ** (m - n) + d * y[1] if n < m else y[0])

    end.terminal, end.direction = True, -1  # type: ignore[attr-defined]  # read by solve_ivp
    method = "Radau" if d > STIFF else "DOP853"
    run = solve_ivp(rates, (0.0, np.inf), [0.0, 1.0], method, events=end, rtol=1e-13, atol=1e-15, first_step=1e-6)
    return -float(run.y[1, -1])


def robot_law(robot: Any) -> RobotLaw:
    """Return the law of a robot: fixed parameters, or a spline of a table, constant beyond its ends (paper, eq. 16)."""
    parameters = robot.mass, robot.stiffness, robot.damping
    if not hasattr(robot, "position"):
        return lambda _: parameters
    low, high = robot.position[0], robot.position[-1]
    spline = CubicSpline(robot.position, np.column_stack(parameters), bc_type="not-a-knot")
    return lambda x_r: spline(min(max(x_r, low), high)).tolist()


class BistableForce:
    """The bistable mechanism (paper, eq. 23-24), and its stops: linear springs and dampers that only push.

    The force on the tool (N) depends on the deflection u (m) and on u'. At rest at the front stop, u is 0. The slider
    carries the tool; at its alignment, the spring is perpendicular to the slider's path.
    """

    def __init__(self, coupling: Any, tool_mass: float) -> None:
        self.k, self.L0, self.H = coupling.stiffness, coupling.free_length, coupling.height
        self.k_s, self.steepest = coupling.stop_stiffness, self.k * (self.L0 / self.H - 1)  # N/m
        self.c_s = 2 * coupling.stop_damping_ratio * sqrt(self.k_s * tool_mass)
        # the force of the spring is below k L0 for x > 0, so the stop balances it at a penetration below k L0 / k_s
        limits = (0.0, self.k * self.L0 / self.k_s)
        tight = {"xtol": 1e-300, "rtol": 4 * np.finfo(float).eps}
        # m, penetration of the front stop at rest
        self.p_front = brentq(lambda p: self.spring(coupling.front_stop + p) - self.k_s * p, *limits, **tight)
        self.x0 = coupling.front_stop + self.p_front  # m, from the alignment to the slider at rest
        self.p_rear = coupling.rear_stop - self.x0  # m, penetration of the rear stop at u = 0, below 0

    def spring(self, x: float) -> float:
        """Return the force (N) of the spring on the tool, with the slider at x (m) from its alignment."""
        L = hypot(self.H, x)
        return self.k * (self.L0 - L) * x / L

    def front(self, u: float, u_dot: float) -> float:
        """Return a number that is positive while penetration and force of the front stop are positive."""
        p = self.p_front - u
        return min(self.k_s * p, self.k_s * p - self.c_s * u_dot)

    def rear(self, u: float, u_dot: float) -> float:
        """Return a number that is positive while penetration and force of the rear stop are positive."""
        p = self.p_rear + u
        return min(self.k_s * p, self.k_s * p + self.c_s * u_dot)

    def force(self, u: float, u_dot: float, on: Mapping[str, bool]) -> float:
        """Return the force of the spring and of the stops that are on (N)."""
        T = self.spring(self.x0 - u)
        if on["front"]:
            T -= self.k_s * (self.p_front - u) - self.c_s * u_dot
        if on["rear"]:
            T += self.k_s * (self.p_rear + u) + self.c_s * u_dot
        return T


class StoppedSpring(BistableForce):
    """A linear spring and damper with stops at both ends of the travel, like those of `BistableForce`."""

    def __init__(self, coupling: Any, tool_mass: float, stop_stiffness: float = 1e5, stop_damping: float = 1.0) -> None:
        self.k = self.steepest = coupling.stiffness
        self.c = 2 * coupling.damping_ratio * sqrt(self.k * tool_mass)
        self.k_s, self.c_s = stop_stiffness, 2 * stop_damping * sqrt(stop_stiffness * tool_mass)
        self.x0, self.p_front, self.p_rear = 0.0, -coupling.stroke, -coupling.stroke

    def spring(self, x: float) -> float:
        """Return the force of the spring alone (N)."""
        return -self.k * x

    def force(self, u: float, u_dot: float, on: Mapping[str, bool]) -> float:
        """Return the force of spring, damper and the stops that are on (N)."""
        return super().force(u, u_dot, on) + self.c * u_dot
