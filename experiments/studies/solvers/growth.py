"""Our time for one approach against five quantities that it may depend on."""

import math
from collections.abc import Sequence
from time import thread_time

import numpy as np

import impact_gym as ig
from experiments.lab.scenes import MOTION, OBJECT_MASS, TOOL_MASS, scene
from experiments.lab.study import Row
from experiments.studies.solvers.approaches import approach_of

SPRING = ig.SpringDamper(50.0)
GROWTH: dict[str, tuple[str, tuple[float, ...]]] = {
    "rows": ("approaches in one call (-)", tuple(4.0**k for k in range(9))),
    "contacts": ("contacts of the approach (-)", tuple(map(float, range(1, 7)))),
    "stiffness": ("contact stiffness (N/m^1.5)", tuple(10.0**k for k in range(2, 10))),
    "mass ratio": ("mass of object over tool (-)", tuple(10.0**k for k in range(-2, 4))),
    "rtol": ("rtol (-)", tuple(10.0**-k for k in range(3, 13))),
}
"""Quantities, each with its axis and values."""
ROUNDS, LEAST = 5, 5e-3  # timings of each value, of which the best counts; least duration of a timing, s


def grown(quantity: str, values: Sequence[float]) -> list[Row]:
    """Return the best time of an approach for each value of a quantity; in each round all values are timed in turn."""
    best = dict.fromkeys(values, math.inf)
    for _ in range(ROUNDS):
        for value in values:
            best[value] = min(best[value], timing(quantity, value))
    return [{"value": value, "microseconds": 1e6 * seconds} for value, seconds in best.items()]


def timing(quantity: str, value: float) -> float:
    """Return the time of an approach (s), the mean over calls that together take at least LEAST."""
    stiffness, rtol = value if quantity == "stiffness" else 1e5, value if quantity == "rtol" else 1e-8
    mass = value * TOOL_MASS if quantity == "mass ratio" else OBJECT_MASS
    chain, duration = scene(stiffness, 0.7, SPRING, object_mass=mass), 1.5
    if quantity == "contacts":
        multiple = approach_of("multiple")
        chain = multiple.scene
        duration = ig.simulate(*multiple.run).contacts[int(value) - 1].end or duration
    masses, calls, begun = np.full(int(value) if quantity == "rows" else 1, OBJECT_MASS), 0, thread_time()
    while not calls or thread_time() - begun < LEAST:
        if quantity == "rows":
            ig.sweep(chain, MOTION, {"object.mass": masses}, duration, rtol, threads=1)
        else:
            ig.simulate(chain, MOTION, duration, rtol)
        calls += 1
    return (thread_time() - begun) / calls / len(masses)
