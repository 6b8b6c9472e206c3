"""Smooth pieces of every chain, in contact and in flight, and states to step from."""

from itertools import product

import numpy as np
from impact_gym.kernels import APPROACH, CHAIN, step_once

import impact_gym as ig
from impact_gym.lowering import approach_plan

TABLE = ig.RobotTable([0.0, 0.1, 0.2, 0.3, 0.5], [3, 4, 5, 4, 6], [1e4, 2e4, 3e4, 2e4, 2e4], [10, 20, 30, 20, 20])
COUPLINGS = {"rigid": ig.Rigid(), "spring": ig.SpringDamper(150.0, 0.4), "bistable": ig.Bistable()}
ROBOTS = {"": None, " on a robot": ig.Robot(5, 1e5, 100), " on a table": TABLE}
HERTZ = ig.Contact(1e3, 0.5, "exact")
ACCELERATION = 3.0  # m/s^2, of the flange
WIDTHS = {"rigid": 4, "spring": 7, "rigid on a robot": 7}  # of scaled states; of all others 10


def names():
    """Every coupling on every robot, in contact, and in flight where that is integrated, pressed by every stop."""
    for coupling, robot in product(COUPLINGS, ROBOTS):
        chain = coupling + robot
        stops = ("", ", front stop", ", rear stop") if coupling == "bistable" else ("",)
        for phase, stop in product(("contact",) if chain in WIDTHS else ("contact", "flight"), stops):
            yield f"{chain}, {phase}{stop}"


def piece(name, contact=HERTZ, coupling=None):
    """Plan, table, chain, acceleration of the flange, and whether it flies: what `step_once` takes."""
    chain, phase, *stop = name.split(", ")
    robot = next(robot for robot in reversed(ROBOTS) if chain.endswith(robot))
    coupling = coupling or COUPLINGS[chain.removesuffix(robot)]
    scene = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.3), contact, coupling, ROBOTS[robot])
    plan, table = approach_plan(scene, ig.Trapezoid(1.0, 8.0), 1.0)
    row = np.zeros(1, CHAIN)
    row["units"] = (0.01, 0.02, 0.5, 3.0)  # as unlike each other as they may be: not those of a contact
    row["holding"] = row["side"] = 1
    row["flange_position"], row["flange_velocity"] = 0.14, 0.8
    row["pressed"] = {"": 0, "front stop": 1, "rear stop": -1}["".join(stop)]
    return np.array([plan], APPROACH), table, row, ACCELERATION, phase == "flight"


def state(name, seed=0):
    width = WIDTHS.get(name.split(", ")[0], 10)
    return np.random.default_rng(seed).uniform(0.2, 1.5, width)


def rates_of(of):
    """The rates of a piece as a function of the state."""
    return lambda x: step_once(*of, np.ascontiguousarray(x), 1e-3, False)["rate"]


SPRING_PIECE = "spring, contact"
STATES = {name: state(name) for name in names()}
