"""The tableau of the integrator against the order conditions, and its order as observed."""

import math
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from impact_gym.physics.contact import Hertz
from impact_gym.physics.coupling import RigidLaw
from impact_gym.solver import dop853
from impact_gym.solver.collision import Collision


@cache
def trees(order):
    """Rooted trees of `order` nodes, each the sorted tuple of its subtrees."""
    found = set()

    def grow(children, left):
        if left == 0:
            found.add(tuple(sorted(children)))
        for size in range(1, left + 1):
            for child in trees(size):
                grow((*children, child), left - size)

    grow((), order - 1)
    return found


def size_and_density(tree):
    size, density = 1, 1
    for child in tree:
        child_size, child_density = size_and_density(child)
        size, density = size + child_size, density * child_density
    return size, size * density


def stage_weights(matrix, tree):
    weights = np.ones(len(matrix))
    for child in tree:
        weights = weights * (matrix @ stage_weights(matrix, child))
    return weights


def square_tableau():
    """Stage matrix with the last stage, the rate at the end of the step, as row and column."""
    return np.hstack([dop853.A, np.zeros((dop853.STAGES, 1))])


def test_the_nodes_are_those_of_the_8_5_3_pair():
    root = math.sqrt(6)
    nodes = [0, (12 - 2 * root) / 135, (6 - root) / 45, (6 - root) / 30, (6 + root) / 30, 1 / 3, 1 / 4, 4 / 13]
    nodes += [127 / 195, 3 / 5, 6 / 7, 1, 1]
    assert dop853.A.sum(axis=1) == pytest.approx(nodes, abs=4e-15)


@pytest.mark.parametrize(("order", "count"), [(1, 1), (2, 1), (3, 2), (4, 4), (5, 9), (6, 20), (7, 48), (8, 115)])
def test_the_tableau_satisfies_every_order_condition(order, count):
    matrix = square_tableau()
    weights = matrix[-1]
    assert len(trees(order)) == count
    for tree in trees(order):
        of_stages = stage_weights(matrix, tree)
        rounding = 1e-15 * np.abs(weights) @ (1 + np.abs(of_stages)) * 50
        assert weights @ of_stages == pytest.approx(1 / size_and_density(tree)[1], abs=rounding)


@pytest.mark.parametrize(("estimate", "order"), [(dop853.E5, 5), (dop853.E3, 3)])
def test_the_error_weights_vanish_up_to_their_order_and_not_beyond(estimate, order):
    matrix = square_tableau()
    residual = {n: max(abs(estimate @ stage_weights(matrix, tree)) for tree in trees(n)) for n in range(1, order + 2)}
    assert all(residual[n] < 1e-14 for n in range(1, order + 1))
    assert residual[order + 1] > 1e-5


def test_fixed_steps_converge_with_order_eight():
    damping, length = 0.5, 3.0
    collision, law = Collision(Hertz(1.0, damping), 0.0, 0.0, 0.0, 0.0, math.inf), RigidLaw(1.0)

    def rates(_, state):
        z, w, *_ = state
        f = z**3 * (1 + damping * w)
        return [w / 2, -z * f, z, z * f]

    exact = solve_ivp(rates, (0.0, length), [0.0, 1.0, 0.0, 0.0], "DOP853", rtol=3e-14, atol=1e-15).y[:, -1]

    def error(steps):
        work = np.zeros((dop853.ROWS, 4))
        work[dop853.STATE] = [0.0, 1.0, 0.0, 0.0]
        work[0] = rates(0.0, work[dop853.STATE])
        for _ in range(steps):
            dop853.attempt(law, collision, work, length / steps)
            work[dop853.STATE], work[0] = work[dop853.TRIAL], work[dop853.STAGES - 1]
        return np.abs(work[dop853.STATE] - exact).max()

    steps = np.array([6, 8, 12, 16])
    order, _ = np.polyfit(np.log(steps), -np.log([error(n) for n in steps]), 1)
    assert 7.5 < order < 9.5
