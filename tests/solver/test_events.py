"""Peak force, alarm, duration and separation against closed forms, to the tolerance that was asked for."""

from itertools import product

import numpy as np
import pytest
from scipy.special import beta, betainc
from solver_scenes import log_uniform, scene

import impact_gym as ig

ROUNDING = 1e-12  # of a clock at 1 s, over the durations below


class Elastic:
    """A random elastic contact with a tool of imposed motion. Energy is conserved, so all times are beta functions.

    From v^2 - delta_dot^2 = 2/n k/m delta^n with n = 5/2 of Hertz, or another, and x = (delta / deepest)^n:
    t(delta) = deepest/v / n B(x; 1/n, 1/2), which is half the duration at x = 1.
    """

    def __init__(self, seed):
        random = np.random.default_rng([13, seed])
        self.speed, self.acceleration = random.uniform(0.2, 1.5), random.uniform(2, 20)
        self.mass, self.stiffness = log_uniform(random, 0.05, 2.5), log_uniform(random, 1e3, 1e7)
        self.exponent = (1.5, 1.0, 1.5, 2.0, 1.5, 3.0)[seed % 6]
        self.distance = self.speed**2 / (2 * self.acceleration) + random.uniform(0.01, 0.2)
        self.start = self.distance / self.speed + self.speed / (2 * self.acceleration)
        self.n = self.exponent + 1
        deepest = (self.n / 2 * self.mass * self.speed**2 / self.stiffness) ** (1 / self.n)
        self.peak = self.stiffness * deepest**self.exponent
        self.duration = 2 / self.n * deepest / self.speed * beta(1 / self.n, 0.5)

    def rises_to(self, force):
        """Time (s) from the onset until the contact has this force (N)."""
        x = min(max(force / self.peak, 0.0), 1.0) ** (self.n / self.exponent)
        return 0.5 * self.duration * betainc(1 / self.n, 0.5, x)

    def run(self, threshold, rtol):
        powers = {"stiffness_exponent": self.exponent, "damping_exponent": self.exponent}
        elastic = scene(self.stiffness, 1.0, m_p=self.mass, distance=self.distance, **powers)
        motion = ig.Trapezoid(self.speed, self.acceleration, ig.Brake(threshold, delay=1.0))
        return ig.simulate(elastic, motion, self.start + 2 * self.duration, rtol)


@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
def test_peak_end_and_alarm_of_a_contact_are_of_a_closed_form(rtol):
    for seed, share in product(range(30), (1e-3, 0.5, 0.9, 0.999, 1 - 2 * rtol, 1 + 2 * rtol)):
        case = Elastic(seed)
        outcome = case.run(share * case.peak, rtol)
        (contact,) = outcome.contacts
        assert contact.start == pytest.approx(case.start, rel=1e-14)
        assert contact.peak_force == pytest.approx(case.peak, rel=rtol)
        assert contact.end - contact.start == pytest.approx(case.duration, rel=rtol + ROUNDING / case.duration)
        assert contact.separation_velocity == pytest.approx(case.speed, rel=rtol + ROUNDING)
        if share > 1:
            assert outcome.detection_time is None
        else:  # as early or late as with a force that is wrong by rtol of its peak
            early, late = (case.rises_to((share + side * rtol) * case.peak) for side in (-1, 1))
            assert early - 1e-14 < outcome.detection_time - case.start < late + 1e-14
