"""Peak force, alarm, duration and separation against closed forms, to the tolerance that was asked for."""

from itertools import product

import numpy as np
import pytest
from scipy.special import beta, betainc
from solver_scenes import log_uniform, scene

import impact_gym as ig


@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
def test_peak_end_and_alarm_of_a_contact_are_of_a_closed_form(rtol):
    """In random elastic contacts with a tool of imposed motion. Energy is conserved, so all times are beta functions.

    From v^2 - delta_dot^2 = 2/n k/m delta^n with n = 5/2 of Hertz, or another, and x = (delta / deepest)^n:
    t(delta) = deepest/v / n B(x; 1/n, 1/2), which is half the duration at x = 1.
    """
    for seed, share in product(range(30), (1e-3, 0.5, 0.9, 0.999, 1 - 2 * rtol, 1 + 2 * rtol)):
        random = np.random.default_rng([13, seed])
        v, acceleration = random.uniform(0.2, 1.5), random.uniform(2, 20)
        mass, stiffness = log_uniform(random, 0.05, 2.5), log_uniform(random, 1e3, 1e7)
        exponent = (1.5, 1.0, 1.5, 2.0, 1.5, 3.0)[seed % 6]
        distance, n = v**2 / (2 * acceleration) + random.uniform(0.01, 0.2), exponent + 1
        start = distance / v + v / (2 * acceleration)
        deepest = (n / 2 * mass * v**2 / stiffness) ** (1 / n)
        peak, duration = stiffness * deepest**exponent, 2 / n * deepest / v * beta(1 / n, 0.5)
        powers = {"stiffness_exponent": exponent, "damping_exponent": exponent}
        elastic = scene(stiffness, 1.0, m_p=mass, distance=distance, **powers)
        motion = ig.Trapezoid(v, acceleration, ig.Brake(share * peak, delay=1.0))
        outcome = ig.simulate(elastic, motion, start + 2 * duration, rtol)
        (contact,) = outcome.contacts
        assert contact.peak_force == pytest.approx(peak, rel=rtol)
        assert contact.end - contact.start == pytest.approx(duration, rel=rtol + 1e-12 / duration)  # of a clock at 1 s
        assert contact.separation_velocity == pytest.approx(v, rel=rtol + 1e-12)
        if share > 1:
            assert outcome.detection_time is None
        else:  # as early or late as with a force that is wrong by rtol of its peak
            x = np.clip([share - rtol, share + rtol], 0.0, 1.0) ** (n / exponent)
            early, late = start + 0.5 * duration * betainc(1 / n, 0.5, x)
            assert early - 1e-14 < outcome.detection_time < late + 1e-14
