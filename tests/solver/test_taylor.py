"""Whole approaches against Taylor series of order 20 and more: heyoka's, which shares nothing with the solver."""

import pytest
from scenes import MOTION, scene

import impact_gym as ig
from experiments.speed_vs_error import taylor
from experiments.speed_vs_error.quantities import solution_of
from experiments.speed_vs_error.scenes import Approach

pytest.importorskip("heyoka")

TIGHT = 1e-16  # of the series' truncation


@pytest.mark.parametrize("e", [1.0, 0.8, 0.5])
@pytest.mark.parametrize("motion", [MOTION, ig.Trapezoid(3.0, 8.0, ig.Brake(5.0)), ig.Trapezoid(1.2, 12.0, ig.Brake())])
@pytest.mark.parametrize(
    "coupling",
    [ig.Rigid(), ig.SpringDamper(150.0, 0.4), ig.SpringDamper(50.0, 1.0), ig.Bistable()],
    ids=str,
)
def test_an_approach_is_that_of_taylor_series(coupling, motion, e):
    chain = scene(1e5, e, coupling)
    ours = solution_of(ig.simulate(chain, motion, 1.0, rtol=1e-13), 1.0)
    series = taylor.Run(Approach("7", "", chain, motion, 1.0), TIGHT).solve()
    assert (ours.contacts, ours.passes) == (series.contacts, series.passes)
    for name in ("velocity", "peak_force", "contact_duration", "detection_time"):
        assert getattr(ours, name) == pytest.approx(getattr(series, name), rel=1e-13)
