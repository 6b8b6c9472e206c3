"""Integration of one smooth phase by SciPy's integrators, or of the flight of a linear chain by the exact solution.

`solve_ivp` compares the signs of an event function at both ends of a step, so it misses two zeros in one step. This
module also computes the event functions (gauges) inside each step, on the cubic through the states and slopes at both
ends. If a gauge has a zero or nearly has one on the cubic, the module seeks the zero on the integrator's interpolant.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import BDF, DOP853, LSODA, RK23, RK45, Radau
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

Vector = NDArray[np.float64]
SOLVERS: dict[str, Any] = {s.__name__: s for s in (RK23, RK45, DOP853, Radau, BDF, LSODA)}

# fractions of a step at which gauges are computed; 0.001 and 0.999 reveal an extremum near an end of the step
POINTS = np.array([0.0, 0.001, 0.3, 0.7, 0.999, 1.0])
LEFT, RIGHT = (1 - POINTS) ** 2, POINTS**2
HERMITE = np.array([(1 + 2 * POINTS) * LEFT, POINTS * LEFT, RIGHT * (3 - 2 * POINTS), RIGHT * (POINTS - 1)]).T
TIGHT = {"rtol": 4 * np.finfo(float).eps}  # tolerance of brentq


@dataclass
class Switch:
    """A part of the model that is on while `gauge`, a function of time and state, is positive."""

    name: str
    on: bool
    gauge: Callable[[float, list[float]], float]
    slack: float = 0.0  # the switch changes when the gauge has passed 0 by this amount, in the gauge's unit

    def margin(self, t: float, y: list[float]) -> float:
        """Return a number that is negative if the switch has changed."""
        return (self.gauge(t, y) if self.on else -self.gauge(t, y)) + self.slack


def advance(
    equations: Any, end: float, y: Vector, switches: list[Switch], method: str, rtol: float, atol: Vector,
    longest_step: float,
) -> tuple[float, Vector, Switch | None]:  # fmt: skip
    """Integrate from 0 to `end`, or to the first change of a switch; return time, state, and the switch or None."""
    options: dict[str, Any] = {"rtol": rtol, "atol": atol, "max_step": longest_step}

    def begin(start: float, y: Vector, end: float) -> Any:
        return SOLVERS[method](equations.rates, start, y, end, **options)

    def step(solver: Any) -> None:
        with np.errstate(over="ignore", invalid="ignore"):  # a trial step may overflow
            message = solver.step()
        if solver.status == "failed":
            raise RuntimeError(f"reference: {message}")

    solver = begin(0.0, y, end)
    slope = np.array(equations.rates(0.0, y))
    while solver.status == "running":
        y_old, slope_old = solver.y, slope
        step(solver)
        slope = np.array(equations.rates(solver.t, solver.y))
        turn = _first_turn(solver, y_old, slope_old, slope, switches)
        if turn is not None:
            tau, switch = turn
            # a step that ends at the event is more accurate than the interpolant
            last = begin(solver.t_old, y_old, tau)
            while last.status == "running":
                step(last)
            return tau, last.y.copy(), switch
    return end, solver.y.copy(), None


def _first_turn(
    solver: Any, y_old: Vector, slope_old: Vector, slope: Vector, switches: list[Switch]
) -> tuple[float, Switch] | None:
    """Return time and switch of the first change in the solver's last step; None: no switch changes."""
    start, h = solver.t_old, solver.t - solver.t_old
    points = (HERMITE @ np.array([y_old, h * slope_old, solver.y, h * slope])).tolist()
    times = (start + h * POINTS).tolist()
    turns: list[tuple[float, Switch]] = []
    dense = None
    for switch in switches:
        g = [switch.margin(s, y) for s, y in zip(times, points, strict=True)]
        if min(g[1:]) < 0 or any(_turns(*g[j - 1 : j + 2]) for j in range(1, len(g) - 1)):
            dense = dense or solver.dense_output()
            tau = _root(switch, dense, times, g)
            turns += [] if tau is None else [(tau, switch)]
    return min(turns, key=lambda turn: turn[0], default=None)


def _turns(left: float, middle: float, right: float) -> bool:
    """Return whether the middle of three successive margins is a minimum, near which the margin may be negative."""
    return middle < left and middle <= right and middle < 2 * (max(left, right) - middle)


def _root(switch: Switch, dense: Any, times: list[float], g: list[float]) -> float | None:
    """Return the time of the first change on the interpolant `dense`, or None. g: margins on the cubic at `times`."""

    def gauge(s: float) -> float:
        return switch.margin(s, dense(s).tolist())

    for j in range(1, len(times)):
        low = times[j]
        if not g[j] < 0:
            if j == len(times) - 1 or not _turns(*g[j - 1 : j + 2]):
                continue
            width = {"xatol": 1e-9 * (times[j + 1] - times[j - 1])}
            lowest = minimize_scalar(gauge, bounds=(times[j - 1], times[j + 1]), method="bounded", options=width)
            if not lowest.fun < 0:
                continue
            low = float(lowest.x)
        high = next((s for s in times[j - 1 :: -1] if gauge(s) > 0), None)
        if high is None:
            return times[0]
        if gauge(low) < 0:
            return float(brentq(gauge, high, low, xtol=1e-300, **TIGHT))
        if j == len(times) - 1:
            return low
    return None


def fly(A: Vector, z: Vector, t: float, t_end: float) -> tuple[float, Vector, bool]:
    """Solve z' = A z from t until z[0] rises through zero or until `t_end`; return time, state, whether z[0] rose."""
    n = ceil(max(8, 5 * (t_end - t) * np.abs(np.linalg.eigvals(A)).max()))  # at least 5 steps per time constant
    h = (t_end - t) / n
    P = expm(A * h)

    def element(s: float, z: Vector, k: int) -> float:
        return float((expm(A * s) @ z)[k])

    for i in range(n):
        z_next = P @ z
        turns = z[1] * z_next[1] < 0  # then z[0] may rise above zero and fall again in this step
        if turns or z_next[0] > 0:
            marks = [0.0, brentq(element, 0, h, (z, 1), 1e-18, **TIGHT), h] if turns else [0.0, h]
            for low, high in pairwise(marks):
                if element(low, z, 0) <= 0 < element(high, z, 0):
                    s = float(brentq(element, low, high, (z, 0), 1e-18, **TIGHT))
                    return t + i * h + s, expm(A * s) @ z, True
        z = z_next
    return t_end, z, False
