"""The theory that the report draws beside what was learned."""

import numpy as np
import pytest
from scipy.optimize import minimize

from agents.baselines.profile import constant_deceleration_of
from experiments.report.learned import _theory


@pytest.mark.parametrize("weight", [0.7, 4.0])
def test_even_braking_is_what_a_direct_search_finds_best(weight):
    """Mean of c v(x) + w T(x) over x uniform in the range, T the time from its near end: by a search over speeds."""
    near, far, c, cells = 0.15, 0.35, 0.5, 40
    edges = np.linspace(near, far, cells + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])

    def loss(log_speeds):
        speeds = np.exp(log_speeds)
        ends = np.cumsum((edges[1] - edges[0]) / speeds)
        times = ends - 0.5 * (edges[1] - edges[0]) / speeds
        return np.mean(c * speeds + weight * times)

    best = np.exp(minimize(loss, np.zeros(cells), method="BFGS", options={"gtol": 1e-9}).x)
    drawn = _theory(weight, c, middle, best)
    assert drawn["velocity"].to_numpy() == pytest.approx(best, rel=1e-3)
    assert drawn["deceleration"][0] == pytest.approx(weight / (2 * c), rel=1e-3)
    assert drawn["r_squared"][0] > 0.9999


def test_a_fit_sees_only_what_lies_between():
    x = np.linspace(0.0, 0.5, 501)
    speed = np.where((x >= 0.15) & (x <= 0.35), np.sqrt(np.maximum(2 * 1.5 * (0.4 - x), 0)), 3.0)
    shape = constant_deceleration_of(x, speed, (0.15, 0.35))
    assert (shape.deceleration, shape.end) == pytest.approx((1.5, 0.4))
