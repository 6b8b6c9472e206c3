"""MuJoCo's own contact law, fitted to each scene."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

import impact_gym as ig
from experiments.lab.tables import Row
from experiments.speed_vs_error.peer import Fit, Model, missing
from experiments.speed_vs_error.quantities import Answer
from experiments.speed_vs_error.scenes import Approach
from experiments.speed_vs_error.truth import filled

STEP = 1e-5  # s
GOOD = (1e-4, 1e-2)  # errors that weigh the same: V_p in m/s, relative duration


def fitted(approach: Approach, truth: Answer, evaluations: int) -> Fit:
    """Return the contact with which duration and V_p come closest to the truth, by the simplex method of Nelder, Mead.

    Only the time from just before the first contact to just after the last is simulated.
    """
    outcome = ig.simulate(approach.scene, approach.motion, approach.duration)
    first, last = outcome.contacts[0], outcome.contacts[-1]
    length = (first.end or approach.duration) - first.start
    begin = first.start - 10 * STEP
    end = min((last.end or approach.duration) + 0.2 * truth.contact_duration, approach.duration)
    trace = ig.simulate(approach.scene, approach.motion, begin, trace=True).trace
    x_f, v_f, x_t, v_t = (
        float(getattr(trace, name)[-1])
        for name in ("flange_position", "flange_velocity", "tool_position", "tool_velocity")
    )
    start = np.array([[x_f, x_t - x_f, 0.0], [v_f, v_t - v_f, 0.0]])

    def cost(logarithms: Any) -> float:
        fit = Fit(*np.exp(logarithms).tolist())
        answer = Model(approach, fit, STEP, (begin, end), start).run()
        if not (math.isfinite(answer.velocity) and answer.contact_duration > 0.0):
            return 1e9
        misses = (answer.velocity - truth.velocity, math.log(answer.contact_duration / truth.contact_duration))
        wrong = abs(answer.contacts - truth.contacts) + abs(answer.passes - truth.passes)
        return sum(abs(miss) / good for miss, good in zip(misses, GOOD, strict=True)) + 10.0 * wrong

    # half a period of a free oscillation whose amplitude falls by the restitution of the first contact
    ratio = min(max(first.separation_velocity / first.approach_velocity, 1e-2), 0.999)
    frequency = math.hypot(math.pi, math.log(ratio)) / length
    guess = np.log([frequency**2, -2.0 * math.log(ratio) / length])
    simplex = guess + np.array([[0.0, 0.0], [-1.0, 0.0], [0.0, -1.0]])
    found = minimize(cost, guess, method="Nelder-Mead", options={"maxfev": evaluations, "initial_simplex": simplex})
    return Fit(*np.exp(found.x).tolist())


def _row(approach: Approach, truth: dict[str, Answer], evaluations: int) -> Row:
    return asdict(fitted(approach, truth[approach.name], evaluations))


def fits(
    path: Path, approaches: Sequence[Approach], truth: dict[str, Answer], evaluations: int, again: bool
) -> dict[str, Fit]:
    """Return MuJoCo's contact by the name of the scene, none without MuJoCo; fit what the table does not have."""
    if missing():
        return {}
    function = partial(_row, truth=truth, evaluations=evaluations)
    rows = filled(path, approaches, function, "fits of MuJoCo's contact", again)
    return {name: Fit(row["stiffness"], row["damping"]) for name, row in rows.items()}
