"""A log of a blow by our own solver, for the checks of a log before the fit."""

import numpy as np
from recorder import MOTION, scene

import impact_gym as ig

SCENE = scene(1e4, 0.5)
TIME = np.arange(0.303, 0.343, 1 / 4000)  # s
BLOW = ig.simulate(scene(1e5, 0.5), MOTION, 0.5, trace=True).trace
CLEAN = np.interp(TIME, BLOW.time, BLOW.contact_force)  # N
NOISE = np.random.default_rng(0).normal(size=len(TIME))
FORCE = CLEAN + 0.02 * CLEAN.max() * NOISE
FLAT = np.array([5.0, 4.0, 2.5, *[0.5] * 8, 2.5, 4.0, 5.0, 4.5, 4.0])  # N; the bottom is 4 resolutions deep


def put(values, place, value):
    """A copy with another value at one index."""
    values = values.copy()
    values[place] = value
    return values
