"""The approach in a room that moves: flange, tool and object have its velocity from the start.

A scene begins at rest, so that the public functions offer no other frame; the kernels do.
"""

import math

import numpy as np
from impact_gym.kernels import APPROACH, CHAIN, approach_rows

from experiments.speed_vs_error.scenes import Approach
from impact_gym.lowering import LOCAL_SHARE, approach_plan
from impact_gym.simulation import MAX_STEPS, NOTHING_RECORDED


def velocity_in_frame(approach: Approach, boost: float, rtol: float) -> float:
    """V_p as someone at rest in a room of velocity `boost` (m/s) finds it, m/s; nan if the run does not finish."""
    plan, table = approach_plan(approach.scene, approach.motion, approach.duration)
    plans, chains = np.array([plan], APPROACH), np.empty(1, CHAIN)
    plans["frame"] = boost
    approach_rows(plans, table, chains, 0, 1, LOCAL_SHARE * rtol, MAX_STEPS, NOTHING_RECORDED)
    (end,) = chains
    object_velocity = end["flange_velocity"] + end["deflection_rate"] - end["penetration_rate"]
    if end["status"] < 0:
        return math.nan
    return float(object_velocity) - boost if end["contacts"] else 0.0
