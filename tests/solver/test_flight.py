"""Flight: the closed form of a free tool against the matrix exponential, and the first touch of the object.

The bounds of the search for a touch, too: the energy of the coupling, and how far the tool can still move.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
from impact_gym.kernels import free_decay
from kernel_access import kernels
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.optimize import brentq
from solver_scenes import random_mechanism

import impact_gym as ig
from impact_gym.to_kernel import mount_to_kernel

TOOL_MASS = 0.125  # kg
FREQUENCY = 35.0  # rad/s
DAMPING_RATIOS = [0.0, 0.3, 0.9, 1 - 1e-9, 1.0, 1 + 1e-9, 1.1, 3.0, 50.0]


def law_of(coupling, robot=None):
    return kernels().laws_of(np.array([mount_to_kernel(TOOL_MASS, coupling, robot)[0]], kernels().MOUNT))


def spring(frequency, damping_ratio):
    return law_of(ig.SpringDamper(TOOL_MASS * frequency**2, damping_ratio))


def chain(*, flange_velocity=0.9, deflection=0.004, deflection_rate=-0.3, gap=0.08, object_velocity=0.2):
    record = np.zeros(1, kernels().CHAIN)
    record["flange_position"], record["flange_velocity"] = 0.02, flange_velocity
    record["deflection"], record["deflection_rate"] = deflection, deflection_rate
    record["penetration"], record["penetration_rate"] = -gap, flange_velocity + deflection_rate - object_velocity
    return record


def state_of(record):
    names = "flange_position", "flange_velocity", "deflection", "deflection_rate", "penetration", "penetration_rate"
    return np.array([record[name][0] for name in names])


@pytest.mark.parametrize("damping_ratio", DAMPING_RATIOS)
def test_free_decay_is_the_matrix_exponential(damping_ratio):
    change = math.sqrt(1e-3 / max(abs(damping_ratio**2 - 1), 1e-9))  # here the formula changes: no jump there
    for angle in (1e-6, 1e-2, 0.03162, 0.5, 3.0, 40.0, change * (1 - 1e-12), change * (1 + 1e-12)):
        exact = expm(np.array([[0.0, 1.0], [-1.0, -2 * damping_ratio]]) * angle)  # in units of the frequency
        for position, velocity in np.eye(2):
            end = free_decay(FREQUENCY, damping_ratio, position, FREQUENCY * velocity, angle / FREQUENCY)
            assert [end[0], end[1] / FREQUENCY] == pytest.approx(exact @ [position, velocity], rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("damping_ratio", [None, *DAMPING_RATIOS], ids=str)  # None: a rigid coupling
def test_drift_under_an_acceleration_is_the_matrix_exponential(damping_ratio):
    law, flight, stretch = law_of(ig.Rigid()), chain(deflection=0.0, deflection_rate=0.0), np.zeros(2)
    if damping_ratio is not None:
        law, flight = spring(FREQUENCY, damping_ratio), chain()
        stretch = np.array([-(FREQUENCY**2), -2 * damping_ratio * FREQUENCY])
    acceleration, times, start = 8.0, (0.07, 0.04), state_of(flight)
    for time in times:
        kernels().drift_once(law, flight, acceleration, time)
    matrix = np.zeros((7, 7))  # of that state and 1
    matrix[0, 1] = matrix[2, 3] = matrix[4, 5] = 1.0
    matrix[1, 6], matrix[3, 2:4] = acceleration, stretch
    matrix[3, 6] = -acceleration if stretch.any() else 0.0
    matrix[5] = matrix[1] + matrix[3]  # the object does not accelerate
    assert state_of(flight) == pytest.approx((expm(matrix * sum(times)) @ [*start, 1.0])[:6], rel=1e-11, abs=1e-12)
    assert flight["time"] == pytest.approx(sum(times), rel=1e-12)


class Path:
    """Penetration of one flight, vectorised: the closed form of a textbook."""

    def __init__(self, frequency, damping_ratio, acceleration, y, y_dot, start, closing):
        self.decay, self.split = damping_ratio * frequency, np.sqrt(complex(damping_ratio**2 - 1)) * frequency
        self.z, self.y_dot = y + acceleration / frequency**2, y_dot
        self.start, self.closing, self.acceleration = start, closing, acceleration

    def parts(self, time):
        """The solutions that begin as (1, -decay) and (0, 1)."""
        if self.split == 0:  # critically damped
            return np.exp(-self.decay * time), time * np.exp(-self.decay * time)
        slow, fast = np.exp((self.split - self.decay) * time), np.exp(-(self.split + self.decay) * time)
        return ((slow + fast) / 2).real, ((slow - fast) / (2 * self.split)).real

    def __call__(self, time):
        even, odd = self.parts(time)
        swing = self.z * (even - 1) + (self.y_dot + self.decay * self.z) * odd
        return self.start + swing + time * (self.closing + 0.5 * self.acceleration * time)

    def rate(self, time):
        even, odd = self.parts(time)
        stiffness = self.decay**2 - (self.split**2).real
        swing = self.y_dot * even - (self.decay * self.y_dot + stiffness * self.z) * odd
        return swing + self.closing + self.acceleration * time

    def extrema(self, horizon):
        time = np.linspace(0.0, horizon, 4000)
        rate = self.rate(time)
        turns = np.flatnonzero(np.sign(rate[1:]) * np.sign(rate[:-1]) < 0)
        return [brentq(self.rate, time[i], time[i + 1], xtol=1e-16) for i in turns]

    def first_touch(self, horizon):
        """The first upward zero; between extrema the path is monotone."""
        for left, right in pairwise([0.0, *self.extrema(horizon), horizon]):
            if self(right) > 0 >= self(left):
                return brentq(self, left, right, xtol=1e-16)
        return math.inf


def random_flight(random, start=None):
    """Law, acceleration, path and initial record of a random flight."""
    frequency = 10 ** random.uniform(1, 2.5)
    light, heavy, beyond = random.uniform([0, 0.2, 1.02], [0.2, 0.98, 4])
    damping_ratio = random.choice([0.0, light, heavy, 1.0, beyond])
    acceleration = random.choice([0.0, random.uniform(-20, 20)])
    closing = random.uniform(-0.5, 1.0)
    y_dot = random.uniform(-1.0, 1.0)
    y = random.uniform(-1.0, 1.0) / frequency
    if start is None:
        start = -random.choice([0.0, 10 ** random.uniform(-5, -1)])
        if start == 0.0 and closing + y_dot > 0:  # bodies that touch at the start separate
            closing = -y_dot - random.uniform(0, 0.5)
    record = chain(flange_velocity=closing + 0.3, deflection=y, deflection_rate=y_dot, gap=-start, object_velocity=0.3)
    path = Path(frequency, damping_ratio, acceleration, y, y_dot, start, closing)
    return spring(float(frequency), float(damping_ratio)), float(acceleration), path, record


def test_first_touch_of_a_random_flight_is_that_of_its_path():
    random, touches = np.random.default_rng(3), 0
    for _ in range(600):
        law, acceleration, path, record = random_flight(random)
        horizon = random.uniform(0.01, 0.6)
        expected, touch = path.first_touch(horizon), kernels().first_touch(law, record, acceleration, horizon)
        assert math.isinf(touch) == math.isinf(expected)
        if math.isfinite(touch):
            touches += 1
            assert path(touch) == pytest.approx(0.0, abs=1e-14)
            assert touch == pytest.approx(expected, abs=1e-9)
    assert touches > 200


@pytest.mark.parametrize("margin", [1e-3, 1e-6, 1e-12])
def test_first_touch_tells_a_graze_from_a_near_miss(margin):
    # shift a random flight so that its highest peak just reaches the object, or just misses it
    random = np.random.default_rng(4)
    horizon, grazes = 0.6, 0
    for _ in range(300):
        law, acceleration, path, record = random_flight(random, start=-1.0)
        height = max((path(t) for t in path.extrema(horizon)), default=-1.0) + 1.0
        if height <= 2 * margin or path(horizon) + 1.0 >= height:
            continue
        record["penetration"] = path.start = -height - margin
        assert kernels().first_touch(law, record, acceleration, horizon) == math.inf
        record["penetration"] = path.start = -height + margin
        touch = kernels().first_touch(law, record, acceleration, horizon)
        assert path(touch) == pytest.approx(0.0, abs=1e-14)
        assert path.rate(touch) > 0
        assert touch == pytest.approx(path.first_touch(horizon), abs=1e-8)
        grazes += 1
    assert grazes > 50


@pytest.mark.parametrize("margin", [0.1, 1e-9])
def test_undamped_tool_reaches_just_as_far_as_its_energy_allows(margin):
    random = np.random.default_rng(6)  # flange and object rest, so the tool gets to hypot(y, y' / omega)
    for _ in range(100):
        y, y_dot, frequency = random.uniform(-0.05, 0.05), random.uniform(-1, 1), 10 ** random.uniform(0, 2.5)
        reach, law = math.hypot(y, y_dot / frequency), spring(frequency, 0.0)
        for beyond in (True, False):
            gap = reach * (1 + margin if beyond else 1 - margin) - y
            record = chain(flange_velocity=0.0, deflection=y, deflection_rate=y_dot, gap=gap, object_velocity=0.0)
            assert kernels().never_touches(law, record) == beyond
            assert math.isinf(kernels().first_touch(law, record, 0.0, 7.0 / frequency)) == beyond


def rigid_touch(rate, acceleration, gap, horizon):
    record = chain(flange_velocity=rate, deflection=0.0, deflection_rate=0.0, gap=gap, object_velocity=0.0)
    return kernels().first_touch(law_of(ig.Rigid()), record, acceleration, horizon)


def test_first_touch_of_a_rigid_tool_is_the_root_of_a_parabola():
    random, touches = np.random.default_rng(5), 0
    for _ in range(800):
        acceleration = float(random.choice([0.0, random.uniform(-20, 20)]))
        rate, gap = float(random.uniform(-1, 1.5)), float(random.choice([0.0, 10 ** random.uniform(-9, 0)]))
        if gap == 0.0:
            rate = -abs(rate)
        horizon = random.uniform(0.01, 1.0)
        roots = np.roots([0.5 * acceleration, rate, -gap] if gap else [0.5 * acceleration, rate])  # no gap: not t = 0
        rising = [t.real for t in roots if t.imag == 0 and 0 < t.real <= horizon and rate + acceleration * t.real > 0]
        touch, first = rigid_touch(rate, acceleration, gap, horizon), min(rising, default=math.inf)
        assert touch == pytest.approx(first, rel=1e-6, abs=1e-15)
        if rising:
            touches += 1
            terms = rate * touch, 0.5 * acceleration * touch**2  # they cancel but for rounding
            assert abs(sum(terms) - gap) <= 4 * np.finfo(float).eps * (abs(terms[0]) + abs(terms[1]))
    assert touches > 100
    # a tool at rest against the object touches it as soon as it accelerates
    assert rigid_touch(rate=0.0, acceleration=1.0, gap=0.0, horizon=1.0) == 0.0


def holding(coupling, stretch):
    """Force of coupling and stops on a slow tool, N."""
    if isinstance(coupling, ig.SpringDamper):
        beyond = max(abs(stretch) - coupling.stroke, 0.0) * np.sign(stretch)
        return -coupling.stiffness * stretch - 1e5 * beyond
    x = coupling.rest + stretch
    beyond = max(x - coupling.front_stop, 0.0) - max(coupling.rear_stop - x, 0.0)
    return coupling.force(x) - coupling.stop_stiffness * beyond


SOFT_STOPS = [ig.Bistable(front_stop=x, stop_stiffness=k) for x, k in ((1e-4, 300.0), (5e-3, 100.0), (5e-3, 30.0))]
COUPLINGS = [random_mechanism(np.random.default_rng(seed)) for seed in range(4)]
COUPLINGS += [ig.SpringDamper(80.0, 0.5, stroke=0.01), *SOFT_STOPS]


@pytest.mark.parametrize("coupling", COUPLINGS, ids=lambda coupling: type(coupling).__name__)
def test_energy_of_a_coupling_is_its_work_and_bounds_its_reach(coupling):
    law, random = law_of(coupling), np.random.default_rng(7)
    if isinstance(coupling, ig.Bistable):
        low, high = (stop - coupling.rest for stop in (coupling.rear_stop, coupling.front_stop))
    else:
        low, high = -coupling.stroke, coupling.stroke
    at_rest = kernels().energy_and_reach(law, 0.0, 0.0)[0]
    for stretch in random.uniform(low - 2e-3, high + 2e-3, 12):
        energy = kernels().energy_and_reach(law, stretch, 0.0)[0]
        work = -quad(lambda s: holding(coupling, s), 0.0, stretch, points=[low, high], epsabs=1e-13, limit=200)[0]
        assert energy - at_rest == pytest.approx(work, rel=1e-7, abs=1e-9)
        for kinetic in (1e-4, 1e-2, 1.0):
            reach = kernels().energy_and_reach(law, stretch, kinetic)[1]
            allowed = energy + kinetic
            if isinstance(coupling, ig.Bistable) and stretch < -coupling.rest == reach:  # it cannot pass the alignment
                assert coupling.energy(0.0) > allowed
                continue
            beyond = np.linspace(max(reach, stretch), max(reach, stretch) + 0.01, 50)[1:]
            assert min(kernels().energy_and_reach(law, s, 0.0)[0] for s in beyond) > allowed * (1 - 1e-9)
    if coupling not in SOFT_STOPS:  # from rest against a stop or a spring the bound is close
        reach, stiffness = kernels().energy_and_reach(law, 0.0, 1e-4)[1], -holding(coupling, 1e-6) / 1e-6
        assert reach == pytest.approx(math.sqrt(2e-4 / stiffness), rel=0.05)


def test_reach_on_a_robot_is_a_bound_at_most_five_times_too_far():
    coupling, robot, random = ig.SpringDamper(150.0, 0.0), ig.Robot(5.0, 5e3, 0.0), np.random.default_rng(3)
    law, shares = law_of(coupling, robot), []
    k, k_r, m_r = coupling.stiffness, robot.stiffness, robot.mass
    rates = np.array(
        [[0, 1, 0, 0], [-k / TOOL_MASS, 0, k / TOOL_MASS, 0], [0, 0, 0, 1], [k / m_r, 0, -(k + k_r) / m_r, 0]]
    )
    frequencies, modes = np.linalg.eig(rates)
    waves = np.exp(np.linspace(0.0, 20.0, 20_000)[:, None] * frequencies) * modes[0]
    for _ in range(40):
        y, y_dot, q, q_dot = random.standard_normal(4) * [0.01, 0.3, 0.003, 0.3] * random.choice([0.1, 1.0], 4)
        record = chain(deflection=y, deflection_rate=y_dot)
        record["flange_offset"], record["flange_offset_rate"] = q, q_dot
        swing = (waves @ np.linalg.solve(modes, [y, y_dot, q, q_dot])).real
        shares.append(swing.max() / kernels().swing_reach(law, record))
    assert 0.7 < max(shares) <= 1.0
    assert min(shares) > 0.2
