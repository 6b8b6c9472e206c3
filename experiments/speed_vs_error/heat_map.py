"""Error and steps over contact stiffness and damping factor: one contact of a tool behind a spring.

The tool is that of the environment (50 N/m, critically damped) under the paper's motion, brake included. The run ends
a tenth of a contact after the first contact, which so stays alone, or after 1.5 s if it has not ended by then.
"""

import math

import numpy as np

import impact_gym as ig
from agents.jobs import Result
from experiments import reference
from experiments.lab.tables import Gather, Row, result_of, solver_and
from experiments.paper.scenes import DURATION, MOTION, decoupled
from experiments.speed_vs_error.truth import RTOL

OUR_RTOL = 1e-8


def grid(points_per_two_decades: int) -> list[tuple[float, float]]:
    """Return (k_c, d): 1e2 to 1e10 N/m^1.5, and 1e-3 to 1e3."""
    stiffness = np.logspace(2, 10, 4 * points_per_two_decades + 1)
    damping = np.logspace(-3, 3, 3 * points_per_two_decades + 1)
    return [(float(f"{k_c:.4g}"), float(f"{d:.4g}")) for k_c in stiffness for d in damping]


def cell(k_c: float, d: float, reference_rtol: float) -> Result:
    """Return the row of one k_c (N/m^1.5) and d."""
    row = {"stiffness": k_c, "damping_factor": d, "velocity_error": math.nan, "steps": 0, "ended": 0, "failure": ""}
    scene = decoupled(k_c, 1.0 / (1.0 + d / 1.5), 50.0)  # paper, eq. 7, solved for e
    try:
        first = ig.simulate(scene, MOTION, DURATION, OUR_RTOL).contacts[0]
        duration = DURATION if first.end is None else min(first.end + 0.1 * (first.end - first.start), DURATION)
        outcome = ig.simulate(scene, MOTION, duration, OUR_RTOL)
    except RuntimeError as problem:
        return result_of([row | {"failure": str(problem)}])
    truth = reference.simulate(scene, MOTION, duration, rtol=reference_rtol)
    if len(truth.contacts) != len(outcome.contacts):
        return result_of([row | {"failure": f"{len(outcome.contacts)} contacts, not {len(truth.contacts)}"}])
    row["velocity_error"] = abs(outcome.object_velocity - truth.object_velocity)
    return result_of([row | {"steps": outcome.steps, "ended": int(outcome.contacts[0].end is not None)}])


def rows(gather: Gather, points_per_two_decades: int) -> list[Row]:
    """Return the rows of all cells."""
    depends = solver_and(reference.__name__, "experiments.paper.scenes", __name__)
    asked = [{"k_c": k_c, "d": d, "reference_rtol": RTOL} for k_c, d in grid(points_per_two_decades)]
    return gather("heat map", cell, asked, depends)
