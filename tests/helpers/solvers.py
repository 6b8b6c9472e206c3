"""The fast solver and the slow one, for tests of what both must come to."""

import pytest

import impact_gym as ig
from experiments import reference


def fast(scene, motion, duration, rtol=1e-12):
    return ig.simulate(scene, motion, duration, rtol)


def slow(scene, motion, duration, rtol=1e-11):
    return reference.simulate(scene, motion, duration, rtol)


BOTH = pytest.mark.parametrize("simulate", [fast, slow])
