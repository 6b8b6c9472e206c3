"""Peak force, alarm, clamp and separation against closed forms, to the tolerance that was asked for."""

import cmath
import math
from itertools import product

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import beta, betainc
from solver_scenes import log_uniform, scene

import impact_gym as ig

ROUNDING = 1e-12  # of a clock at 1 s, over the durations below
EVERY_TOLERANCE = pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])


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
        self.least, self.peak = 0.0, self.stiffness * deepest**self.exponent
        self.duration = 2 / self.n * deepest / self.speed * beta(1 / self.n, 0.5)
        self.separation_velocity = self.speed

    def rises_to(self, force):
        """Time (s) from the onset until the contact has this force (N)."""
        x = min(max(force / self.peak, 0.0), 1.0) ** (self.n / self.exponent)
        return 0.5 * self.duration * betainc(1 / self.n, 0.5, x)

    def run(self, threshold, rtol):
        powers = {"stiffness_exponent": self.exponent, "damping_exponent": self.exponent}
        elastic = scene(self.stiffness, 1.0, m_p=self.mass, distance=self.distance, **powers)
        motion = ig.Trapezoid(self.speed, self.acceleration, ig.Brake(threshold, delay=1.0))
        return ig.simulate(elastic, motion, self.start + 2 * self.duration, rtol)


LINEAR = {"dissipation": "exact", "stiffness_exponent": 1.0, "damping_exponent": 0.0}


class Oscillator:
    """A linear contact, x'' + 2 zeta x' + x = 0 from x = 0, x' = 1, in its own units of time and force.

    With zeta = sin(phi), complex above critical damping, each derivative turns the phase by pi/2 + phi,
    x^(n) = exp(-zeta t) sin(w t + n (pi/2 + phi)) / w.
    The force -x'' is largest where x''' = 0, at w t = pi/2 - 3 phi, and zero, where it is clamped, at w t = pi - 2 phi.
    """

    def __init__(self, seed, zeta=(0.01, 1.5)):
        random = np.random.default_rng([14, seed])
        self.zeta = random.uniform(*zeta)
        self.phi = cmath.asin(self.zeta)
        self.w = cmath.cos(self.phi)
        self.speed, self.mass = random.uniform(0.2, 1.5), random.uniform(0.1, 2)
        self.stiffness = random.uniform(1e3, 1e5)
        self.second = math.sqrt(self.mass / self.stiffness)  # s, its unit of time
        self.newton = math.sqrt(self.mass * self.stiffness) * self.speed  # N, its unit of force
        self.clamped = ((math.pi - 2 * self.phi) / self.w).real
        self.restitution = -self.derivative(1, self.clamped)
        drift = self.derivative(0, self.clamped) / self.restitution  # without any force
        self.duration = (self.clamped + drift) * self.second
        self.summit = ((0.5 * math.pi - 3 * self.phi) / self.w).real if self.zeta < 0.5 else 0.0  # then it only falls
        self.least, self.peak = (self.newton * self.force(t) for t in (0.0, self.summit))
        self.start = 0.2 / self.speed + self.speed / 20  # s
        self.separation_velocity = self.restitution * self.speed

    def derivative(self, n, t):
        return (np.exp(-self.zeta * t) * np.sin(self.w * t + n * (0.5 * math.pi + self.phi)) / self.w).real

    def force(self, t):
        return -self.derivative(2, t)

    def rises_to(self, force):
        """Time (s) from the onset until the contact has this force (N)."""
        if not self.least < force < self.peak:
            return 0.0 if force < self.peak else self.summit * self.second
        return brentq(lambda t: self.force(t) - force / self.newton, 0.0, self.summit, xtol=1e-15) * self.second

    def run(self, threshold, rtol, **options):
        linear = scene(self.stiffness, self.restitution, m_p=self.mass, distance=0.2, **LINEAR)
        motion = ig.Trapezoid(self.speed, 10.0, ig.Brake(threshold, delay=1.0))
        return ig.simulate(linear, motion, self.start + 2 * self.duration, rtol, **options)


@EVERY_TOLERANCE
@pytest.mark.parametrize("kind", [Elastic, Oscillator])
def test_peak_duration_and_separation_are_those_of_a_closed_form(kind, rtol):
    for seed in range(60):
        case = kind(seed)
        (contact,) = case.run(0.3 * case.peak, rtol).contacts
        assert contact.start == pytest.approx(case.start, rel=1e-14)
        assert contact.peak_force == pytest.approx(case.peak, rel=rtol)
        assert contact.end - contact.start == pytest.approx(case.duration, rel=rtol + ROUNDING / case.duration)
        assert contact.separation_velocity == pytest.approx(case.separation_velocity, rel=rtol + ROUNDING)


@EVERY_TOLERANCE
@pytest.mark.parametrize("share", [1e-3, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("kind", [Elastic, lambda seed: Oscillator(seed, zeta=(0.01, 0.49))], ids=["elastic", "damped"])
def test_alarm_comes_when_the_force_has_risen_to_its_threshold(kind, share, rtol):
    for seed in range(30):
        case = kind(seed)
        threshold = case.least + share * (case.peak - case.least)
        delay = case.run(threshold, rtol).detection_time - case.start
        # as early or late as with a force that is wrong by rtol of its peak
        early, late = (case.rises_to(threshold + side * rtol * case.peak) for side in (-1, 1))
        assert early - 1e-14 < delay < late + 1e-14


@EVERY_TOLERANCE
def test_alarm_comes_just_below_the_peak_and_not_just_above(rtol):
    for seed, margin in product(range(50), (2 * rtol, 1e-3)):
        case = Elastic(seed)
        below, above = (case.run(case.peak * (1 + side * margin), rtol) for side in (-1, 1))
        assert above.detection_time is None
        assert abs(below.detection_time - case.start - 0.5 * case.duration) < case.duration * margin**0.5
        # the two runs differ in the alarm alone, not in the motion
        assert below.peak_force == pytest.approx(above.peak_force, rel=2 * rtol)


@EVERY_TOLERANCE
@pytest.mark.parametrize("share", [0.0, 0.99])  # of the force at the onset
def test_linear_contact_has_the_force_of_an_oscillator(share, rtol):
    for seed in range(20):
        case = Oscillator(seed)
        outcome = case.run(share * case.least, rtol, trace=True)
        (contact,), trace = outcome.contacts, outcome.trace
        assert outcome.detection_time == contact.start
        time = (trace.time - contact.start) / case.second
        touching = (time > 0.0) & (time < case.clamped)
        expected = case.newton * case.force(time[touching])
        assert np.abs(trace.contact_force[touching] - expected).max() <= (rtol + 1e-9) * contact.peak_force
        assert np.all(trace.contact_force >= 0.0)
