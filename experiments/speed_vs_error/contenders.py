"""Every way to compute an approach that is timed here: its answer, and how long a call takes.

Times are processor times of the one thread that each contender uses: what else runs on the machine would lengthen long
calls, SciPy's, more than the best of many short ones.
"""

from collections.abc import Callable
from dataclasses import dataclass
from time import thread_time
from typing import Any
from unittest.mock import patch

import numpy as np

import impact_gym as ig
from experiments import reference
from experiments.speed_vs_error import by_hand, peer, taylor
from experiments.speed_vs_error.quantities import Answer, answer_of
from experiments.speed_vs_error.scenes import Approach

OURS, SCIPY, MUJOCO, HEYOKA = "impact_gym", "SciPy", "MuJoCo", "heyoka Taylor"
METHODS = ("RK45", "DOP853", "LSODA", "Radau")
NAMES = (OURS, *(f"{SCIPY} {method}" for method in METHODS), *by_hand.METHODS, MUJOCO, HEYOKA)


@dataclass(frozen=True)
class Grid:
    """Which tolerances and steps are tried."""

    rtols: tuple[float, ...] = tuple(float(f"1e-{k}") for k in range(3, 13))
    scipy_rtols: tuple[float, ...] = tuple(float(f"1e-{k}") for k in range(3, 13))
    steps: tuple[float, ...] = tuple(float(f"{step:.2g}") for step in np.geomspace(1e-3, 1e-6, 10))  # s
    mujoco_steps: tuple[float, ...] = (1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5)  # s
    taylor_tolerances: tuple[float, ...] = (1e-3, 1e-6, 1e-9, 1e-12, 1e-15)


@dataclass(frozen=True)
class Contender:
    """One solver at one setting, on one approach."""

    name: str
    setting: float  # rtol, or step in s
    solve: Callable[[], Answer]
    seconds: Callable[[int], float]  # mean time of so many calls


def repeated(function: Callable[[], Any]) -> Callable[[int], float]:
    """Return what times so many calls, s each."""

    def seconds(calls: int) -> float:
        begun = thread_time()
        for _ in range(calls):
            function()
        return (thread_time() - begun) / calls

    return seconds


def ours(approach: Approach, rtol: float) -> Contender:
    """Our whole run, from the scene to the outcome."""

    def run() -> ig.Outcome:
        return ig.simulate(approach.scene, approach.motion, approach.duration, rtol=rtol)

    return Contender(OURS, rtol, lambda: answer_of(run(), approach.duration), repeated(run))


class _Clocked(reference._Run):
    """The reference's run, with the time that it spends in contacts."""

    spent = 0.0  # s

    def move(self, t: float, z: Any, touching: bool) -> tuple[float, Any, bool]:
        begun = thread_time()
        after = super().move(t, z, touching)
        if touching:
            _Clocked.spent += thread_time() - begun
        return after


def scipy(method: str, approach: Approach, rtol: float) -> Contender:
    """One of SciPy's integrators, driven by the reference; its contacts alone are timed.

    The reference flies by the matrix exponential, or at rtol 1e-12 where there is no closed form: neither is what this
    contender is about, so its flights are exact and free of charge.
    """
    outcomes: list[reference.Reference] = []  # the last, so that what was timed need not be computed again

    def run() -> reference.Reference:
        outcomes[:] = [reference.simulate(approach.scene, approach.motion, approach.duration, rtol=rtol, method=method)]
        return outcomes[0]

    def seconds(calls: int) -> float:
        _Clocked.spent = 0.0
        with patch.object(reference, "_Run", _Clocked):  # one code path for what is timed and what is trusted
            for _ in range(calls):
                run()
        return _Clocked.spent / calls

    def solve() -> Answer:
        return answer_of(outcomes[0] if outcomes else run(), approach.duration)

    return Contender(f"{SCIPY} {method}", rtol, solve, seconds)


def hand_written(method: str, approach: Approach, step: float) -> Contender:
    """A fixed step, compiled; the scene is turned into numbers beforehand, free of charge."""
    arguments = by_hand.arguments(method, approach, step)
    return Contender(
        method, step, lambda: by_hand.solve(method, approach, step), repeated(lambda: by_hand.march(*arguments))
    )


def mujoco(approach: Approach, fit: peer.Fit, step: float) -> Contender:
    """MuJoCo's steps alone: building the model and reading the state are free of charge."""
    model = peer.Model(approach, fit, step)
    answer = model.run()
    return Contender(MUJOCO, step, lambda: answer, repeated(model.repeat))


def heyoka(approach: Approach, tolerance: float) -> Contender:
    """The whole run by heyoka; making and compiling its integrators is free of charge."""
    run = taylor.Run(approach, tolerance)
    return Contender(HEYOKA, tolerance, run.solve, repeated(run.solve))


def settings(grid: Grid) -> list[tuple[str, float]]:
    """Return who is tried at which tolerance or step, ours first."""
    tried = [(OURS, rtol) for rtol in grid.rtols]
    tried += [(f"{SCIPY} {method}", rtol) for method in METHODS for rtol in grid.scipy_rtols]
    tried += [(method, step) for method in by_hand.METHODS for step in grid.steps]
    tried += [(MUJOCO, step) for step in grid.mujoco_steps if not peer.missing()]
    return tried + [(HEYOKA, tolerance) for tolerance in grid.taylor_tolerances if not taylor.missing()]


def contender(approach: Approach, name: str, setting: float, fit: peer.Fit | None = None) -> Contender:
    """Return one of `NAMES` at a tolerance or step (s); MuJoCo needs its fit."""
    if name in by_hand.METHODS:
        return hand_written(name, approach, setting)
    if name == MUJOCO:
        assert fit is not None
        return mujoco(approach, fit, setting)
    if name in (OURS, HEYOKA):
        return ours(approach, setting) if name == OURS else heyoka(approach, setting)
    return scipy(name.removeprefix(f"{SCIPY} "), approach, setting)
