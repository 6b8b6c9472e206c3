"""MuJoCo's own contact law, fitted to each scene."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.optimize import minimize

import impact_gym as ig
from agents.jobs import Result
from experiments.lab.tables import Gather, Row, result_of, solver_and
from experiments.speed_vs_error import by_hand, peer
from experiments.speed_vs_error.contenders import MISSING, MUJOCO
from experiments.speed_vs_error.peer import Fit, Model
from experiments.speed_vs_error.quantities import Solution, as_json, from_json
from experiments.speed_vs_error.scenes import SOURCES, Approach, approach_of

STEP = 1e-5  # s
GOOD = (1e-4, 1e-2)  # errors that weigh the same: V_p in m/s, relative duration


def fitted(approach: Approach, truth: Solution, evaluations: int) -> Fit:
    """Return the contact with which duration and V_p come closest to the truth, by the simplex method of Nelder, Mead.

    Only the time from just before the first contact to just after the last is simulated.
    """
    outcome = ig.simulate(*approach.run)
    first, last = outcome.contacts[0], outcome.contacts[-1]
    length = (first.end or approach.duration) - first.start
    begin = first.start - 10 * STEP
    end = min((last.end or approach.duration) + 0.2 * truth.contact_duration, approach.duration)
    trace = ig.simulate(approach.scene, approach.motion, begin, trace=True).trace
    flange = np.array([trace.flange_position[-1], trace.flange_velocity[-1]])
    tool = np.array([trace.tool_position[-1], trace.tool_velocity[-1]])
    start = np.stack([flange, tool - flange, np.zeros(2)], axis=1)

    def cost(logarithms: Any) -> float:
        fit = Fit(*np.exp(logarithms).tolist())
        solution = Model(approach, fit, STEP, (begin, end), start).run()
        if not (math.isfinite(solution.velocity) and solution.contact_duration > 0.0):
            return 1e9
        misses = (solution.velocity - truth.velocity, math.log(solution.contact_duration / truth.contact_duration))
        wrong = abs(solution.contacts - truth.contacts) + abs(solution.passes - truth.passes)
        return sum(abs(miss) / good for miss, good in zip(misses, GOOD, strict=True)) + 10.0 * wrong

    # half a period of a free oscillation whose amplitude falls by the restitution of the first contact
    ratio = min(max(first.separation_velocity / first.approach_velocity, 1e-2), 0.999)
    frequency = math.hypot(math.pi, math.log(ratio)) / length
    guess = np.log([frequency**2, -2.0 * math.log(ratio) / length])
    simplex = guess + np.array([[0.0, 0.0], [-1.0, 0.0], [0.0, -1.0]])
    found = minimize(cost, guess, method="Nelder-Mead", options={"maxfev": evaluations, "initial_simplex": simplex})
    return Fit(*np.exp(found.x).tolist())


def fit(scene: str, truth: Mapping[str, float | None], evaluations: int) -> Result:
    """Return the row of a scene."""
    approach = approach_of(scene)
    about = {"scene": scene, "description": approach.description}
    return result_of([about | asdict(fitted(approach, from_json(truth), evaluations))])


def rows(gather: Gather, truths: Mapping[str, Solution], evaluations: int) -> list[Row]:
    """Return the rows of MuJoCo's contact in these scenes, none without MuJoCo."""
    if MUJOCO in MISSING:
        return []
    depends = solver_and(by_hand.__name__, peer.__name__, __name__, *SOURCES)
    asked = [{"scene": name, "truth": as_json(truth), "evaluations": evaluations} for name, truth in truths.items()]
    return gather("fits of MuJoCo's contact", fit, asked, depends)
