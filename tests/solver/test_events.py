"""What is found on the integrator's polynomial and no longer landed on, or landed on by one step: peak force, alarm,
clamp, separation. Each against a closed form, to the tolerance asked for.
"""

import cmath
import math
from itertools import product

import numpy as np
import pytest
from scenes import log_uniform, scene
from scipy.optimize import brentq
from scipy.special import beta, betainc

import impact_gym as ig

ROUNDING = 1e-12  # of a clock at 1 s, over the durations below
EVERY_TOLERANCE = pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-10])


class Elastic:
    """A random contact without loss with a tool of imposed motion: energy conserved, so all times are beta functions.

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
        self.deepest = (self.n / 2 * self.mass * self.speed**2 / self.stiffness) ** (1 / self.n)
        self.peak = self.stiffness * self.deepest**self.exponent
        self.duration = 2 / self.n * self.deepest / self.speed * beta(1 / self.n, 0.5)

    def rises_to(self, share):
        """Time from the onset at which the force is this share of its peak, s."""
        x = min(max(share, 0.0), 1.0) ** (self.n / self.exponent)
        return 0.5 * self.duration * betainc(1 / self.n, 0.5, x)

    def run(self, threshold, rtol):
        powers = {"stiffness_exponent": self.exponent, "damping_exponent": self.exponent}
        elastic = scene(self.stiffness, 1.0, m_p=self.mass, distance=self.distance, **powers)
        motion = ig.Trapezoid(self.speed, self.acceleration, ig.Brake(threshold, delay=1.0))
        return ig.simulate(elastic, motion, self.start + 2 * self.duration, rtol)


@EVERY_TOLERANCE
def test_peak_duration_and_separation_of_a_contact_without_loss_are_those_of_its_energy(rtol):
    for seed in range(100):
        case = Elastic(seed)
        (contact,) = case.run(threshold=0.3 * case.peak, rtol=rtol).contacts
        close = rtol + ROUNDING / case.duration
        assert contact.start == pytest.approx(case.start, rel=1e-14)
        assert contact.peak_force == pytest.approx(case.peak, rel=rtol)
        assert contact.end - contact.start == pytest.approx(case.duration, rel=close)
        assert contact.separation_velocity == pytest.approx(case.speed, rel=rtol)


@EVERY_TOLERANCE
@pytest.mark.parametrize("share", [1e-3, 0.1, 0.5, 0.9, 0.999])
def test_alarm_comes_when_the_force_has_risen_to_its_threshold(share, rtol):
    for seed in range(50):
        case = Elastic(seed)
        felt = case.run(share * case.peak, rtol).detection_time - case.start
        # as late as a force that is wrong by rtol of its peak makes it
        early, late = case.rises_to(share - rtol), case.rises_to(share + rtol)
        assert early - 1e-14 < felt < late + 1e-14


@EVERY_TOLERANCE
def test_alarm_comes_for_a_threshold_just_below_the_peak_and_not_just_above(rtol):
    for seed, margin in product(range(50), (2 * rtol, 1e-3)):
        case = Elastic(seed)
        below, above = (case.run(case.peak * (1 + side * margin), rtol) for side in (-1, 1))
        assert above.detection_time is None
        assert abs(below.detection_time - case.start - 0.5 * case.duration) < case.duration * margin**0.5
        # nothing but the alarm differs, and none of it the motion
        assert below.peak_force == pytest.approx(above.peak_force, rel=2 * rtol)


LINEAR = {"dissipation": "exact", "stiffness_exponent": 1.0, "damping_exponent": 0.0}


class Oscillator:
    """A linear contact, x'' + 2 zeta x' + x = 0 from x = 0, x' = 1, in its own time and force.

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
        self.clamped = ((math.pi - 2 * self.phi) / self.w).real
        self.restitution = -self.derivative(1, self.clamped)
        self.duration = self.clamped + self.derivative(0, self.clamped) / self.restitution  # then they drift apart
        self.summit = ((0.5 * math.pi - 3 * self.phi) / self.w).real if self.zeta < 0.5 else 0.0  # it falls from there
        self.peak = self.force(self.summit)
        self.second = math.sqrt(self.mass / self.stiffness)  # s, of its time
        self.newton = math.sqrt(self.mass * self.stiffness) * self.speed  # N, of its force
        self.start = 0.2 / self.speed + self.speed / 20  # s

    def derivative(self, n, t):
        return (np.exp(-self.zeta * t) * np.sin(self.w * t + n * (0.5 * math.pi + self.phi)) / self.w).real

    def force(self, t, push=0.0):
        """Of the contact, where a push of that size drives the motion, x'' + 2 zeta x' + x = push."""
        return push - self.derivative(2, t) - push * self.derivative(1, t)

    def growth(self, t, push):
        return -self.derivative(3, t) - push * self.derivative(2, t)

    def rises_to(self, force):
        """Time at which it has grown to that."""
        if not self.force(0.0) < force < self.peak:
            return 0.0 if force < self.peak else self.summit
        return brentq(lambda t: self.force(t) - force, 0.0, self.summit, xtol=1e-15)

    def run(self, threshold, rtol, **options):
        linear = scene(self.stiffness, self.restitution, m_p=self.mass, distance=0.2, **LINEAR)
        motion = ig.Trapezoid(self.speed, 10.0, ig.Brake(threshold * self.newton, delay=1.0))
        return ig.simulate(linear, motion, self.start + 2 * self.duration * self.second, rtol, **options)


@EVERY_TOLERANCE
@pytest.mark.parametrize("share", [0.0, 0.99])  # of the force that it begins with: felt at once
def test_peak_clamp_and_separation_of_a_linear_contact_are_those_of_the_oscillator(share, rtol):
    for seed in range(100):
        case = Oscillator(seed)
        outcome = case.run(share * case.force(0.0), rtol, trace=True)
        (contact,), trace = outcome.contacts, outcome.trace
        assert outcome.detection_time == contact.start == pytest.approx(case.start, rel=1e-14)
        assert contact.peak_force == pytest.approx(case.peak * case.newton, rel=rtol)
        assert contact.separation_velocity == pytest.approx(case.restitution * case.speed, rel=rtol + ROUNDING)
        lasted = case.duration * case.second
        assert contact.end - contact.start == pytest.approx(lasted, rel=rtol + ROUNDING / lasted)
        time = (trace.time - contact.start) / case.second
        touching = (time > 0.0) & (time < case.clamped)
        expected = case.newton * case.force(time[touching])
        assert trace.contact_force[touching] == pytest.approx(expected, abs=(rtol + 1e-9) * contact.peak_force)
        assert np.all(trace.contact_force >= 0.0)


@EVERY_TOLERANCE
def test_peak_of_a_linear_contact_under_a_push_is_that_of_the_oscillator(rtol):
    """Damping alone would let the force fall from the start; the flange, still speeding up, lets it rise."""
    for seed in range(50):
        case, random = Oscillator(seed, zeta=(0.5, 1.2)), np.random.default_rng([15, seed])
        push = 2 * case.zeta - (1 - 10 ** random.uniform(-3, -0.3)) / (2 * case.zeta)  # the slope it begins with
        speed, peak_at = 20.0 * case.second / push, brentq(case.growth, 0.0, 2.0, (push,), xtol=1e-15)
        linear = scene(case.stiffness, case.restitution, m_p=case.mass, distance=speed**2 / (2 * 20.0), **LINEAR)
        (contact,) = ig.simulate(linear, ig.Trapezoid(1e3, 20.0), (1 / push + 2) * case.second, rtol).contacts
        newton = math.sqrt(case.mass * case.stiffness) * speed
        assert contact.peak_force == pytest.approx(case.force(peak_at, push) * newton, rel=rtol)


@EVERY_TOLERANCE
def test_alarm_of_a_linear_contact_comes_when_the_oscillator_says(rtol):
    risen = 0
    for seed in range(200):
        case = Oscillator(seed)
        if case.summit == 0.0:  # it is largest at the onset
            continue
        low = case.force(0.0)
        threshold = low + 0.7 * (case.peak - low)
        felt = (case.run(threshold, rtol).detection_time - case.start) / case.second
        early, late = (case.rises_to(threshold + side * rtol * case.peak) for side in (-1, 1))
        assert early - 1e-14 / case.second < felt < late + 1e-14 / case.second
        risen += 1
    assert risen > 30
