"""Chains that the tests of the stability study share: the paper's motion, every coupling with every robot."""

import os
import time

import numpy as np

import impact_gym as ig
from experiments.lab.tables import result_of
from experiments.paper.scenes import DISTANCE, MECHANISM, MOTION
from experiments.speed_vs_error.scenes import Approach

COUPLINGS = {"rigid": ig.Rigid(), "spring": ig.SpringDamper(150.0, 0.5), "bistable": MECHANISM}
POSITIONS = np.linspace(0.0, 0.35, 6)
COLUMNS = POSITIONS, 4 + 3 * POSITIONS**2, 1.5e5 * (1 + POSITIONS), 40 + 100 * POSITIONS
TABLE = ig.RobotTable(*(tuple(column.tolist()) for column in COLUMNS))
ROBOTS = {"rigid robot": None, "robot": ig.Robot(5.0, 1.5e5, 50.0), "robot table": TABLE}


def approach_of(coupling=None, robot=None, k_c=1e5, e=0.5, motion=MOTION, **law):
    contact = ig.Contact(k_c, e, **law)
    scene = ig.Scene(ig.Tool(0.125), ig.Object(0.25, DISTANCE), contact, coupling or ig.Rigid(), robot)
    return Approach("7", "planted", scene, motion, 0.8)


def asleep(scene, seconds):
    """Take a job's time; end the process where that is negative."""
    if seconds < 0.0:
        os._exit(3)
    time.sleep(seconds)
    return result_of([{"scene": scene, "failure": "", "seconds": seconds}])
