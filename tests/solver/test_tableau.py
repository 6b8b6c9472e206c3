"""The tableau of the explicit pair against the order conditions, and its steps as compiled against the tableau."""

import math
from functools import cache

import numpy as np
import pytest
from impact_gym.kernels import step_once
from pieces import SPRING_PIECE, STATES, piece, rates_of
from scipy.integrate import solve_ivp

from impact_gym.solver import tableau

STAGES = len(tableau.A)


def dense(rows):
    """Rows of weights by stage as a matrix."""
    return np.array([[row.get(stage, 0.0) for stage in range(STAGES)] for row in rows])


MATRIX, ERROR, DENSE = dense(tableau.A), dense(tableau.ERROR), dense(tableau.DENSE)
LAST = tableau.LAST


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


def test_the_nodes_are_those_of_the_8_5_3_pair():
    root = math.sqrt(6)
    nodes = [0, (12 - 2 * root) / 135, (6 - root) / 45, (6 - root) / 30, (6 + root) / 30, 1 / 3, 1 / 4, 4 / 13]
    nodes += [127 / 195, 3 / 5, 6 / 7, 1, 1, 1 / 10, 1 / 5, 7 / 9]
    assert MATRIX.sum(axis=1) == pytest.approx(nodes, abs=4e-15)


@pytest.mark.parametrize(("order", "count"), [(1, 1), (2, 1), (3, 2), (4, 4), (5, 9), (6, 20), (7, 48), (8, 115)])
def test_the_tableau_satisfies_every_order_condition(order, count):
    weights = MATRIX[LAST]
    assert len(trees(order)) == count
    for tree in trees(order):
        of_stages = stage_weights(MATRIX, tree)
        rounding = 1e-15 * np.abs(weights) @ (1 + np.abs(of_stages)) * 50
        assert weights @ of_stages == pytest.approx(1 / size_and_density(tree)[1], abs=rounding)


@pytest.mark.parametrize(("estimate", "order"), [(ERROR[0], 5), (ERROR[1], 3)])
def test_the_error_weights_vanish_up_to_their_order_and_not_beyond(estimate, order):
    residual = {n: max(abs(estimate @ stage_weights(MATRIX, tree)) for tree in trees(n)) for n in range(1, order + 2)}
    assert all(residual[n] < 1e-14 for n in range(1, order + 1))
    assert residual[order + 1] > 1e-5


def test_the_steps_that_are_checked_in_are_those_of_the_tableau():
    assert tableau.OUT.read_text(encoding="utf-8") == tableau.written()


@pytest.mark.parametrize("name", STATES)
def test_a_step_is_the_loop_over_the_tableau(name):
    # the slow, obvious form of what `solver/dop853.pxi` writes out, on the rates that the kernel gives
    of, x, h = piece(name), STATES[name], 0.02  # as far as the stops can be followed
    rates = rates_of(of)
    k = np.zeros((STAGES, len(x)))
    for stage in range(STAGES):
        k[stage] = rates(x + h * MATRIX[stage] @ k)
    end = x + h * MATRIX[LAST] @ k
    step = step_once(*of, x, h, False)
    assert step["rate"] == pytest.approx(k[0], rel=1e-15)
    assert step["end"] == pytest.approx(end, rel=1e-13, abs=1e-13)
    assert step["end_rate"] == pytest.approx(k[LAST], rel=1e-12, abs=1e-12)
    size = np.maximum(np.maximum(np.abs(x), np.abs(end)), 1.0)
    fifth, third = (np.sum((weights @ k / size) ** 2) for weights in ERROR)
    assert step["error"] == pytest.approx(h * fifth / math.sqrt((fifth + 0.01 * third) * len(x)), rel=1e-6)
    # dense output in the middle: Hairer's polynomial from both ends, their rates and four sums over the stages
    change, upper = end - x, h * DENSE @ k
    parts = [change, h * k[0] - change, 2 * change - h * (k[0] + k[LAST]), *upper]
    middle = np.zeros(len(x))
    for part in reversed(parts):
        middle = 0.5 * (middle + part)  # share and what is left of it are the same there
    assert step["middle"] == pytest.approx(x + middle, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(
    ("stiff", "what", "longest", "order"),
    [(False, "end", 0.2, 8.5), (False, "middle", 0.2, 7.5), (True, "end", 0.05, 5.6), (True, "error", 0.05, 4.8)],
)
def test_halving_the_step_shows_the_order_of_each_pair(stiff, what, longest, order):
    of, x = piece(SPRING_PIECE), STATES[SPRING_PIECE]
    rates = rates_of(of)
    errors = []
    for h in longest * 0.5 ** np.arange(3):
        found = step_once(*of, x, h, stiff)[what]  # an estimate of the error is one itself
        at = 0.5 * h if what == "middle" else h
        exact = solve_ivp(lambda _, y: rates(y), (0.0, at), x, "DOP853", rtol=3e-14, atol=1e-16).y[:, -1]
        errors.append(found if what == "error" else np.abs(found - exact).max())
    assert np.all(np.log2(np.divide(errors[:-1], errors[1:])) > order)  # of one step, so one more than the method's
