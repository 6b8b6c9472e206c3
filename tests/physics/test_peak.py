"""The peak force in closed form against printed numbers, simulated contacts and the work of a push."""

import numpy as np
import pytest
from golden import SHAPES
from scenes import log_uniform, scene

import impact_gym as ig
from impact_gym.physics.dissipation import damping_factor
from impact_gym.physics.peak import peak_factor, permitted_speed

RANDOM = np.random.default_rng(5)


def random_contact():
    """Stiffness (N/m^1.5), restitution, object mass (kg)."""
    return log_uniform(RANDOM, 1e3, 1e7), RANDOM.uniform(0.02, 1.0), log_uniform(RANDOM, 0.02, 5.0)


@pytest.mark.parametrize("restitution", SHAPES)
def test_peak_factor_is_that_of_the_independent_solver(restitution):
    assert peak_factor(damping_factor("hu-guo", restitution)) == pytest.approx(SHAPES[restitution][2], rel=1e-9)


def test_peak_factor_is_worst_at_one_end_of_a_range_of_dampings():
    factors = np.array([peak_factor(d) for d in np.geomspace(1e-7, 1e5, 2000)])
    lowest = factors.argmin()
    assert 0 < lowest < 1999
    assert np.all(np.diff(factors[:lowest]) <= 1e-14)
    assert np.all(np.diff(factors[lowest:]) > 0)


def loading_time(limit, k_c, speed):
    """Longer than the force takes to its peak (s): five times the deepest penetration at the approach velocity."""
    return 5.0 * (limit / k_c) ** (2 / 3) / speed


def test_permitted_speed_of_a_rigid_tool_reaches_the_limit_and_no_more():
    for _ in range(100):
        k_c, e, mass = random_contact()
        limit = log_uniform(RANDOM, 1.0, 1000.0)
        speed = permitted_speed(limit, mass, k_c, damping_factor("hu-guo", e))
        motion = ig.Trapezoid(speed, 2.0 * speed**2)  # at its speed after the first 0.25 m
        outcome = ig.simulate(scene(k_c, e, m_p=mass), motion, 0.51 / speed + loading_time(limit, k_c, speed))
        assert outcome.peak_force == pytest.approx(limit, rel=1e-6)


def test_permitted_speed_under_a_push_that_grows_with_it_is_that_under_the_push_it_grows_to():
    for push, rate in RANDOM.uniform([0.0, 0.0], [1.0, 10.0], (50, 2)):  # N, N s/m
        k_c, e, mass = random_contact()
        contact = 10.0, mass, k_c, damping_factor("hu-guo", e)
        speed = permitted_speed(*contact, push, rate)
        assert permitted_speed(*contact, push + rate * speed) == pytest.approx(speed, rel=1e-12)


def under_a_push(k_c, e, mass, share):
    """The peak (N) of a rigid tool that meets the object at the permitted speed, its acceleration a push; the limit."""
    limit = log_uniform(RANDOM, 1.0, 1000.0)
    push = share * limit / 2.5
    speed = permitted_speed(limit, mass, k_c, damping_factor("hu-guo", e), push)
    acceleration = push / mass
    met = scene(k_c, e, m_p=mass, distance=speed**2 / (2.0 * acceleration))
    duration = speed / acceleration + loading_time(limit, k_c, speed)
    return ig.simulate(met, ig.Trapezoid(1e6, acceleration), duration).peak_force, limit


def test_permitted_speed_under_a_push_stays_below_the_limit_and_an_elastic_contact_reaches_it():
    for share in RANDOM.uniform(0.01, 0.95, 200):
        peak, limit = under_a_push(*random_contact(), share)
        assert peak <= limit * (1.0 + 1e-6)
    for share in RANDOM.uniform(0.01, 0.6, 50):
        k_c, _, mass = random_contact()
        peak, limit = under_a_push(k_c, 1.0, mass, share)
        assert peak == pytest.approx(limit, rel=1e-5)
