"""Flight of a linear chain: the matrix exponential carries it, exactly."""

from __future__ import annotations

from itertools import pairwise
from math import ceil

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from experiments.reference.chain import UNITS, Chain, System
from experiments.reference.phases import Vector

TIGHT = {"xtol": 1e-18, "rtol": 4 * np.finfo(float).eps}  # brentq: s, relative


def fly(chain: Chain, t: float, z: Vector, t_end: float) -> tuple[float, Vector, bool]:
    """Fly until the faces meet or t_end; return when, the state and whether they met. z as in `System`, SI."""
    z = np.append(z, 1.0)
    while t < t_end:
        _, _, a, t_change = chain.command.at(t)
        A = matrix(chain, a)
        t_stop = min(t_change, t_end)
        n = ceil(max(8, 5 * (t_stop - t) * np.abs(np.linalg.eigvals(A)).max()))  # 5 per time constant
        h = (t_stop - t) / n
        P = expm(A * h)
        for i in range(n):
            z_next = P @ z
            s = _meeting(A, z, z_next, h)
            if s is not None:
                z = expm(A * s) @ z
                return t + i * h + s, np.append(0.0, z[1:6]), True
            z = z_next
        t = t_stop
    return t, z[:6], False


def matrix(chain: Chain, a: float) -> Vector:
    """The A of z' = A z, z = (delta, delta', u, u', w, w', 1): paper, eq. 8 and 17, without contact."""
    system, at_rest, A = System(chain, UNITS, touching=False), np.zeros(8), np.zeros((7, 7))
    system.alpha = a
    A[:6, :6], A[:6, 6] = system.jacobian(0.0, at_rest)[:6, :6], system.rates(0.0, at_rest)[:6]
    return A


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
