"""Statistics of studies, costs, and texts and charts of their pages."""

from dataclasses import astuple

import numpy as np
import pytest
from matplotlib.figure import Figure

from agents.evaluate.specs import pairs
from experiments.lab import charts, grid
from experiments.lab.page import typeset
from experiments.lab.parts import percent
from experiments.lab.statistics import Estimate, Resamples, along, estimate, reduction, tolerated
from impact_gym.render import palette


@pytest.mark.parametrize(("of_seeds", "of_scenarios", "scenarios"), [(1.0, 0.0, 40), (0.3, 5.0, 40), (1.0, 1.0, 10)])
def test_resamples_vary_with_seeds_and_scenarios(of_seeds, of_scenarios, scenarios):
    """x = a_seed + b_scenario: the variance of the mean is var(a) / seeds + var(b) / scenarios, both unbiased."""
    rng = np.random.default_rng(1)
    seeds, drawn = 10, rng.standard_normal(scenarios)
    a, b = of_seeds * drawn[:seeds], of_scenarios * drawn[:scenarios]  # resampled independently, though alike
    values, resamples = a[:, None] + b, Resamples(scenarios, resamples=20_000)
    means = resamples.means(values)
    assert means[0] == pytest.approx(a.mean() + b.mean())
    assert means[1:].var() == pytest.approx(a.var(ddof=1) / seeds + b.var(ddof=1) / scenarios, rel=0.05)
    both = resamples.means(np.stack([values, 2.0 * values], axis=1))  # weights are between seeds and scenarios
    assert both == pytest.approx(np.stack([means, 2.0 * means], axis=1))


def test_comparison_cancels_what_is_shared():
    hard = np.random.default_rng(2).uniform(1.0, 10.0, 500)
    recipe, same, less = map(Resamples(500).means, (np.tile(0.4 * hard, (7, 1)), hard, hard - 0.25))
    assert astuple(reduction(recipe, same)) == pytest.approx((0.6, 0.6, 0.6))
    assert astuple(estimate(same - less)) == pytest.approx((0.25, 0.25, 0.25))


def test_estimates_and_curves_are_read_as_by_hand():
    with_gap = estimate(np.concatenate([[1.0], np.linspace(0.0, 2.0, 101), [np.nan, np.inf]]))  # without a value
    assert astuple(-with_gap) == pytest.approx((-1.0, -1.95, -0.05))
    x, y = np.tile([3.0, 1.0, 2.0], (4, 1)), np.tile([9.0, 1.0, 4.0], (4, 1))
    assert along(x, y, np.array([1.5, 2.75, 0.0, 5.0])) == pytest.approx([2.5, 7.75, 1.0, 9.0])


@pytest.mark.parametrize(("n", "factor"), [(5, 4.203), (10, 2.911), (30, 2.220), (50, 2.065)])
def test_tolerated_has_the_factor_of_the_tables(n, factor):
    """One-sided, 95 % content and confidence: M. G. Natrella, Experimental Statistics, NBS Handbook 91, table A-7."""
    scores = np.random.default_rng(6).normal(3.0, 2.0, n)
    assert (scores.mean() - tolerated(scores)) / scores.std(ddof=1) == pytest.approx(factor, abs=6e-4)
    assert np.isnan(tolerated(scores[:1]))


def test_cost_charges_time_and_misses_of_the_environment():
    scenarios = {"ranges": pairs({"distance": [0.2, 1.5]}), "seed": 1, "count": 20}
    rows = grid.play({"baseline": "paper-trapezoid"}, {"missed_cost": 5.0}, scenarios, [1.0, 3.0])
    assert 0 < rows["missed"].sum() < len(rows) == 40
    by_hand = rows["object_velocity"] + rows["weight"] * rows["approach_time"] + 5.0 * rows["missed"]
    assert rows["cost"].to_numpy() == pytest.approx(by_hand.to_numpy())


def test_texts_and_charts_are_typeset(tmp_path):
    assert typeset("V_p [1, 2] < N/m^1.5") == "V<sub>p</sub> [1,\N{NO-BREAK SPACE}2] &lt; N/m<sup>1.5</sup>"
    assert percent(Estimate(0.1234, 0.1, 0.2)) == "12.3 % [10.0, 20.0]"
    figure = Figure()
    figure.subplots().plot([0, 1], color=palette.POLICY)
    drawn, again = (charts.save(figure, tmp_path / f"{k}.svg").read_text() for k in range(2))
    assert drawn == again
    assert "dc:date" not in drawn
    assert f"--policy: {palette.COLOURS['policy'][1].lower()};" in drawn  # on a dark page
