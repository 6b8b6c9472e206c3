"""Designs: laws of pads and of a tool in flight, limits, and plays of a design."""

from dataclasses import asdict

import numpy as np
import pytest
from scipy.optimize import brentq

import impact_gym as ig
from agents.baselines import BlindProfile, ConstantSpeed
from agents.baselines.tuned import read_tuned
from agents.evaluate.scenario_batch import TUNING_SEED, ScenarioBatch, Travel
from agents.setups import load_setup
from experiments.design.pads import PADS, on_pad, pad_of
from experiments.design.search import PENALTY, Candidate, Limits, SearchBudget, objective, play
from experiments.design.variables import SearchVariable, as_built, search_variables
from impact_gym.task import Task

PROFILE = list(read_tuned("blind-profile")["weights"]["2"]["parameters"].values())


@pytest.mark.parametrize("name", PADS)
def test_on_pad_has_one_force_the_sum_of_penetrations_and_the_losses_of_both_bodies(name):
    pad, restitution = pad_of(name), 0.8
    for stiffness in (1e3, 1e5, 1e7):
        together, rebound = on_pad(name, stiffness, restitution)
        for force in (0.1, 10.0):
            penetration = brentq(lambda x, k=together, f=force: k * x**1.5 - f, 0.0, 1.0, xtol=1e-16)
            pressed = [(force / k) ** (2 / 3) for k in (pad.stiffness, stiffness)]
            assert penetration == pytest.approx(sum(pressed))
            stored = 0.4 * force * np.array(pressed)
            lost = stored @ [1.0 - pad.restitution**2, 1.0 - restitution**2]
            assert (1.0 - rebound**2) * stored.sum() == pytest.approx(lost)
    assert on_pad(name, 1e-6, 0.7) == pytest.approx((1e-6, 0.7), rel=1e-4)  # an object far softer, far stiffer
    assert on_pad(name, 1e18, 0.7) == pytest.approx((pad.stiffness, pad.restitution), rel=1e-4)


@pytest.mark.parametrize("name", PADS)
def test_pad_of_is_a_dome_of_its_material_with_the_largest_restitution(name):
    pad, material = pad_of(name), ig.MATERIALS[name]
    edges = [4 / 3 * E / (1 - nu**2) * pad.radius**0.5 for E in material.young for nu in material.poisson]
    assert min(edges) * (1 - 1e-12) <= pad.stiffness <= max(edges) * (1 + 1e-12)
    assert pad.restitution == max(material.restitution)


@pytest.mark.parametrize(("stiffness", "damping_ratio"), [(300.0, 0.2), (120.0, 0.0), (80.0, 1.0)])
def test_travel_is_that_of_a_spring_and_damper_under_constant_acceleration(stiffness, damping_ratio):
    """After half a period it overshoots m a / k by exp(-pi zeta / sqrt(1 - zeta^2))."""
    coupling = {"type": "SpringDamper", "stiffness": stiffness, "damping_ratio": damping_ratio}
    environment = {"coupling": coupling, "scenario": {"distance": 0.5}, "acceleration_range": [1.0, 5.0]}
    travel = Travel(4)
    rule = ConstantSpeed(1.5, 5.0).for_task(Task(**environment))
    ScenarioBatch(TUNING_SEED, 4, rule.task, threads=1).play(rule, watch=travel)
    over = np.exp(-np.pi * damping_ratio / np.sqrt(1.0 - damping_ratio**2)) if damping_ratio < 1.0 else 0.0
    assert travel.deflection == pytest.approx(0.125 * 5.0 / stiffness * (1.0 + over), rel=0.01)
    assert (travel.stroke >= travel.deflection).all()


def test_search_allows_for_more_than_the_tolerance_of_the_design():
    """A critically damped spring deflects by m a / k: within the limit at 5.5 %, but not at the 6 % of a search."""
    coupling = {"type": "SpringDamper", "stiffness": [300.0, 400.0], "damping_ratio": 1.0}
    environment = {"coupling": coupling, "scenario": {"distance": 0.5}, "acceleration_range": [1.0, 5.0]}
    environment["control_period"] = 0.002  # makes the cubic between two observations exact
    candidate = Candidate(environment, "ConstantSpeed")
    variables = [SearchVariable("coupling.stiffness", 300.0, 400.0)]
    candidates = np.array([np.log(350.0), 1.5, 5.0, 5.0]) * np.ones((4, 1, 1))

    def loss(off):
        limits = Limits(0.125 * 5.0 / (350.0 * (1.0 - off)))
        budget = SearchBudget(tolerance=0.05, scenarios=100, population=4)
        return objective(candidate, variables, 9.0, limits, budget)(candidates)[0, 0]

    assert loss(0.055) - loss(0.5) == pytest.approx(PENALTY * (0.945 / 0.94 - 1.0), rel=0.2)  # 100 designs, not all
    assert loss(0.06) == loss(0.5)


def test_excess_is_the_sum_of_shares_beyond_the_limits():
    stage, travel = ScenarioBatch(TUNING_SEED, 40, threads=1), Travel(40)
    played = stage.play(BlindProfile(PROFILE), watch=travel)
    peak, twice = np.quantile(played.peak_force, 0.95), (played.contact_count > 1).mean()
    assert 0.0 < twice < 0.5
    values = {"deflection": travel.deflection.max(), "stroke": travel.stroke.max(), "peak_force": peak}

    def excess(pad=None, **limits):
        return Limits(**{"deflection": None, **limits}).excess(played, travel, pad=pad)

    assert excess() == 0.0
    for name, value in values.items():
        assert excess(**{name: value / 1.5}) == pytest.approx(0.5)
        assert excess(**{name: value * 1.01}) == 0.0
    assert excess(touched_once=1.0 - twice / 2) == pytest.approx(1.0)
    assert excess(touched_once=0.5) == 0.0
    pad = pad_of("norbornene")  # may be pressed in by half its radius
    soft = pad._replace(stiffness=peak / (0.6 * pad.radius) ** 1.5)
    assert excess(soft) == pytest.approx(0.2)
    assert excess(soft._replace(stiffness=10.0 * soft.stiffness)) == 0.0


def test_play_draws_the_design_within_its_tolerance_in_each_scenario():
    design = {"coupling.stiffness": 80.0, "coupling.damping_ratio": 0.4}
    assert as_built({"coupling.rear_stop": -0.02}, 0.05) == {"coupling.rear_stop": pytest.approx([-0.021, -0.019])}
    candidate = asdict(Candidate({}, "BlindProfile", PROFILE, design))
    exact, built = (play(candidate, share, "validation", {}) for share in (0.0, 0.05))
    alone = ScenarioBatch.of("validation", None, Task().changed(design), threads=1).play(BlindProfile(PROFILE))
    exact, built = (frame["object_velocity"].to_numpy() for frame in (exact, built))
    assert np.array_equal(exact, alone.object_velocity)
    changes = built / exact - 1.0
    assert (changes != 0.0).all()
    assert np.abs(np.median(changes)) < np.quantile(np.abs(changes), 0.99) < 0.5


@pytest.mark.parametrize(("text", "start", "logarithmic"), [
    ("coupling.stiffness=20:80", 50.0, True),  # of linear-blind
    ("coupling.stiffness=100:400", 200.0, True),  # which is not in it
    ("coupling.damping_ratio=0.5:2", 1.0, False),
    ("coupling.damping_ratio=0:3", 1.0, False),
])  # fmt: skip
def test_free_number_is_searched_on_a_logarithmic_scale_if_wide_and_starts_at_the_set_ups_value(
    text, start, logarithmic
):
    (variable,) = search_variables([text], load_setup("linear-blind"))
    parameter = variable.parameter()
    assert variable.logarithmic is logarithmic
    assert variable.value(parameter.start) == pytest.approx(start)
