"""Every way to compute an approach that is timed here: its solution, and how long a call takes.

Times are processor times of the one thread that each contender uses: what else runs on the machine would lengthen long
calls, SciPy's, more than the best of many short ones.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from time import thread_time
from timeit import timeit
from typing import Any
from unittest.mock import patch

import numpy as np

import impact_gym as ig
from experiments import reference
from experiments.reference.motion import Motion
from experiments.speed_vs_error import by_hand, peer, taylor
from experiments.speed_vs_error.quantities import Solution
from experiments.speed_vs_error.scenes import Approach

OURS, SCIPY, MUJOCO, HEYOKA = "impact_gym", "SciPy", "MuJoCo", "heyoka Taylor"
METHODS = ("RK45", "DOP853", "LSODA", "Radau")
NAMES = (OURS, *(f"{SCIPY} {method}" for method in METHODS), *by_hand.METHODS, MUJOCO, HEYOKA)
PACKAGES = {MUJOCO: "mujoco", HEYOKA: "heyoka"}
MISSING = {name: package for name, package in PACKAGES.items() if find_spec(package) is None}
"""Who takes no part because its package, of the extra `peers`, is not installed."""
RTOLS = tuple(float(f"1e-{k}") for k in range(3, 13))


@dataclass(frozen=True)
class Grid:
    """Which tolerances and steps are tried."""

    rtols: tuple[float, ...] = RTOLS
    scipy_rtols: tuple[float, ...] = RTOLS
    steps: tuple[float, ...] = tuple(float(f"{step:.2g}") for step in np.geomspace(1e-3, 1e-6, 10))  # s
    mujoco_steps: tuple[float, ...] = (1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5)  # s
    taylor_tolerances: tuple[float, ...] = (1e-3, 1e-6, 1e-9, 1e-12, 1e-15)

    def settings(self) -> list[tuple[str, float]]:
        """Return who is tried at which tolerance or step, ours first."""
        tried = {OURS: self.rtols, **{f"{SCIPY} {method}": self.scipy_rtols for method in METHODS}}
        tried |= {method: self.steps for method in by_hand.METHODS}
        tried |= {MUJOCO: self.mujoco_steps, HEYOKA: self.taylor_tolerances}
        return [(name, setting) for name in tried if name not in MISSING for setting in tried[name]]


@dataclass(frozen=True)
class Contender:
    """One solver at one setting, on one approach."""

    name: str
    setting: float  # rtol, or step in s
    solve: Callable[[], Solution]
    seconds: Callable[[int], float]  # mean time of so many calls


def contender(approach: Approach, name: str, setting: float, fit: peer.Fit | None = None) -> Contender:
    """Return one of `NAMES` at a tolerance or step (s); MuJoCo needs its fit.

    Ours is timed from the scene to the outcome, heyoka without making and compiling its integrators, a fixed step
    without turning the scene into numbers, MuJoCo's steps without building the model and reading the state.
    """
    if name.startswith(SCIPY):
        return scipy(name, approach, setting)
    if name in by_hand.METHODS:
        march = partial(by_hand.march, *by_hand.arguments(name, approach, setting))
        return Contender(name, setting, partial(by_hand.solve, name, approach, setting), repeated(march))
    if name == MUJOCO:
        assert fit is not None
        model = peer.Model(approach, fit, setting)
        solution = model.run()
        return Contender(name, setting, lambda: solution, repeated(model.repeat))
    if name == HEYOKA:
        solve = taylor.Run(approach, setting).solve
        return Contender(name, setting, solve, repeated(solve))
    seconds = repeated(partial(ig.simulate, *approach.run, setting))
    return Contender(name, setting, partial(approach.solved, rtol=setting), seconds)


def repeated(function: Callable[[], Any]) -> Callable[[int], float]:
    """Return what times so many calls, s each."""
    # with garbage collection, as programs run
    return lambda calls: timeit(function, "import gc; gc.enable()", timer=thread_time, number=calls) / calls


class _Clocked(Motion):
    """The reference's run, with the time that all of them spend in contacts."""

    spent = 0.0  # s

    def move(self, t: float, until: float, touching: bool) -> None:
        begun = thread_time()
        super().move(t, until, touching)
        if touching:
            _Clocked.spent += thread_time() - begun


def scipy(name: str, approach: Approach, rtol: float) -> Contender:
    """One of SciPy's integrators, driven by the reference; its contacts alone are timed.

    The reference flies by the matrix exponential, or at rtol 1e-12 where there is no closed form: neither is what this
    contender is about, so its flights are exact and free of charge.
    """
    solutions: list[Solution] = []  # what was timed need not be computed again

    def run() -> Solution:
        solutions.append(approach.solved(reference.simulate, rtol=rtol, method=name.removeprefix(f"{SCIPY} ")))
        return solutions[-1]

    def seconds(calls: int) -> float:
        _Clocked.spent = 0.0
        with patch.object(reference, "_Run", _Clocked):  # one code path for what is timed and what is trusted
            for _ in range(calls):
                run()
        return _Clocked.spent / calls

    return Contender(name, rtol, lambda: solutions[-1] if solutions else run(), seconds)
