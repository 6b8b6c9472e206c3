"""The bistable mechanism and its two stops (paper, eq. 23-24; the stops' law is the project's own)."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot, sqrt
from typing import Any

import numpy as np
from scipy.optimize import brentq


class BistableForce:
    """Force on the tool, N, by the deflection u = x_f - x_t (m), 0 at rest against the front stop, and its rate."""

    def __init__(self, coupling: Any, tool_mass: float) -> None:
        self.k, self.L0, self.H = coupling.stiffness, coupling.free_length, coupling.height
        self.k_s = coupling.stop_stiffness
        self.c_s = 2 * coupling.stop_damping_ratio * sqrt(self.k_s * tool_mass)
        tight = {"xtol": 1e-300, "rtol": 4 * np.finfo(float).eps}
        # the spring force is below k L0 everywhere, so that the stop holds it before p = k L0 / k_s
        limits = (0.0, self.k * self.L0 / self.k_s)
        self.p_front = brentq(lambda p: self.spring(coupling.front_stop + p) - self.k_s * p, *limits, **tight)  # m
        self.x0 = coupling.front_stop + self.p_front  # m, slider from the alignment at rest
        self.p_rear = coupling.rear_stop - self.x0  # m, negative: into the rear stop at rest

    def position(self, u: float) -> float:
        """Slider from the vertical alignment, m."""
        return self.x0 - u

    def spring(self, x: float) -> float:
        """F_T of the slider at x, N."""
        L = hypot(self.H, x)
        return self.k * (self.L0 - L) * x / L

    def front(self, u: float, u_dot: float) -> float:
        """Positive while the front stop pushes: penetrated, and k_s p + c_s p' > 0."""
        p = self.p_front - u
        return min(self.k_s * p, self.k_s * p - self.c_s * u_dot)

    def rear(self, u: float, u_dot: float) -> float:
        """Positive while the rear stop pushes."""
        p = self.p_rear + u
        return min(self.k_s * p, self.k_s * p + self.c_s * u_dot)

    def force(self, u: float, u_dot: float, on: Mapping[str, bool]) -> float:
        """Spring and the stops that are on, N."""
        T = self.spring(self.x0 - u)
        if on["front"]:
            T -= self.k_s * (self.p_front - u) - self.c_s * u_dot
        if on["rear"]:
            T += self.k_s * (self.p_rear + u) + self.c_s * u_dot
        return T

    def slopes(self, u: float, on: Mapping[str, bool]) -> tuple[float, float]:
        """Derivatives of `force` by u (N/m) and u' (N s/m)."""
        stops = on["front"] + on["rear"]
        L = hypot(self.H, self.x0 - u)
        return self.k * (1 - self.L0 * self.H**2 / L**3) + stops * self.k_s, stops * self.c_s

    def energy(self, u: float) -> float:
        """Of the spring and of the stops that are penetrated, J."""
        spring = self.k / 2 * (hypot(self.H, self.position(u)) - self.L0) ** 2
        return spring + self.k_s / 2 * (max(self.p_front - u, 0.0) ** 2 + max(self.p_rear + u, 0.0) ** 2)

    def rest(self, front: bool) -> float:
        """Deflection at which a stop holds the mechanism, m."""
        if front:
            return 0.0
        held = brentq(
            lambda u: self.spring(self.position(u)) + self.k_s * (self.p_rear + u), -self.p_rear, 1 - self.p_rear
        )
        return float(held)
