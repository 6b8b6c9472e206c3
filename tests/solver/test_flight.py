"""Flight: the closed form of a free tool against the matrix exponential, and no touch of the object stepped over."""

import math
from itertools import pairwise

import numpy as np
import pytest
from impact_gym.kernels import CHAIN, HOLDER, decay_basis, drift_once, first_touch, free_decay, laws_of
from scipy.linalg import expm
from scipy.optimize import brentq

import impact_gym as ig
from impact_gym.lowering import holder

TOOL_MASS = 0.125  # kg
DAMPING_RATIOS = [0.0, 0.3, 1 - 1e-9, 1.0, 1 + 1e-9, 3.0, 50.0]


def law_of(coupling):
    return laws_of(np.array([holder(TOOL_MASS, coupling)[0]], HOLDER))


def spring(frequency, damping_ratio):
    return law_of(ig.SpringDamper(TOOL_MASS * frequency**2, damping_ratio))


@pytest.mark.parametrize("damping_ratio", DAMPING_RATIOS)
@pytest.mark.parametrize("angle", [1e-6, 1e-2, 0.03162, 0.5, 3.0, 40.0])
def test_the_free_tool_moves_as_the_matrix_exponential(damping_ratio, angle):
    frequency = 35.0
    time = angle / frequency
    # scaled by the frequency, so that the entries are of one size
    exact = expm(np.array([[0.0, 1.0], [-1.0, -2 * damping_ratio]]) * angle)
    for start in np.eye(2):
        position, velocity = free_decay(frequency, damping_ratio, start[0], frequency * start[1], time)
        assert [position, velocity / frequency] == pytest.approx(exact @ start, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("damping_ratio", DAMPING_RATIOS)
def test_the_free_tool_obeys_its_equation_of_motion(damping_ratio):
    frequency, h = 35.0, 1e-4
    time = np.arange(1, 200) * 1e-3
    z, z_dot = np.array([free_decay(frequency, damping_ratio, 0.01, -0.4, t) for t in time]).T
    late, late_dot = np.array([free_decay(frequency, damping_ratio, 0.01, -0.4, t + h) for t in time]).T
    early, early_dot = np.array([free_decay(frequency, damping_ratio, 0.01, -0.4, t - h) for t in time]).T
    fastest = frequency * (damping_ratio + math.sqrt(max(damping_ratio**2 - 1, 1.0)))
    truncation = (fastest * h) ** 2  # of the central difference
    assert (late - early) / (2 * h) == pytest.approx(z_dot, abs=truncation * np.abs(z_dot).max() + 1e-10)
    restoring = frequency**2 * z + 2 * damping_ratio * frequency * z_dot
    assert (late_dot - early_dot) / (2 * h) == pytest.approx(
        -restoring, abs=truncation * np.abs(restoring).max() + 1e-8
    )


def test_the_decay_has_no_step_where_its_formulas_change_over():
    frequency = 20.0
    for damping_ratio in (0.9, 1.1):
        square = abs(damping_ratio**2 - 1) * frequency**2
        time = math.sqrt(1e-3 / square)
        before, after = (decay_basis(frequency, damping_ratio, time * (1 + s)) for s in (-1e-12, 1e-12))
        assert before == pytest.approx(after, rel=1e-11)


@pytest.mark.parametrize(
    "coupling", [ig.Rigid(), *(ig.SpringDamper(TOOL_MASS * 35.0**2, ratio) for ratio in DAMPING_RATIOS)], ids=str
)
def test_two_half_flights_are_one_flight(coupling):
    law = law_of(coupling)
    once, twice = chain(), chain()
    drift_once(law, once, 8.0, 0.2)
    drift_once(law, twice, 8.0, 0.07)
    drift_once(law, twice, 8.0, 0.13)
    for name in FLIGHT_FIELDS:
        assert once[name] == pytest.approx(twice[name], rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("damping_ratio", DAMPING_RATIOS)
def test_flight_with_a_flange_speeding_up_is_the_matrix_exponential(damping_ratio):
    law, acceleration, time = spring(35.0, damping_ratio), 8.0, 0.11
    flight = chain()
    start = flight.copy()
    drift_once(law, flight, acceleration, time)
    # (flange, flange', tool, tool', object, object', 1)
    k, c = 35.0**2, 2 * damping_ratio * 35.0
    matrix = np.zeros((7, 7))
    matrix[0, 1] = matrix[2, 3] = matrix[4, 5] = 1.0
    matrix[1, 6] = acceleration
    matrix[3, :4] = [k, c, -k, -c]
    state = expm(matrix * time) @ [*positions(start), 1.0]
    assert positions(flight) == pytest.approx(state[:6], rel=1e-11, abs=1e-12)


FLIGHT_FIELDS = (
    "time", "flange_position", "flange_velocity", "deflection", "deflection_rate", "penetration", "penetration_rate",
)  # fmt: skip


def chain(*, flange_velocity=0.9, deflection=0.004, deflection_rate=-0.3, gap=0.08, object_velocity=0.2):
    record = np.zeros(1, CHAIN)
    record["flange_position"] = 0.02
    record["flange_velocity"] = flange_velocity
    record["deflection"] = deflection
    record["deflection_rate"] = deflection_rate
    record["penetration"] = -gap
    record["penetration_rate"] = flange_velocity + deflection_rate - object_velocity
    return record


def positions(record):
    """Position and velocity of flange, tool and object."""
    record = record[0]
    tool = record["flange_position"] + record["deflection"]
    tool_velocity = record["flange_velocity"] + record["deflection_rate"]
    return [
        record["flange_position"],
        record["flange_velocity"],
        tool,
        tool_velocity,
        tool - record["penetration"],
        tool_velocity - record["penetration_rate"],
    ]


class Path:
    """Penetration of one flight, vectorised; the closed form of a textbook, written down apart from the package."""

    def __init__(self, frequency, damping_ratio, acceleration, y, y_dot, start, closing):
        self.decay = damping_ratio * frequency
        z = y + acceleration / frequency**2
        if damping_ratio == 1:  # (b + a t) exp(-decay t)
            self.a, self.b, self.split = y_dot + self.decay * z, z, None
        else:  # a exp((split - decay) t) + b exp((-split - decay) t)
            self.split = np.sqrt(complex(damping_ratio**2 - 1)) * frequency
            self.a = (y_dot + (self.decay + self.split) * z) / (2 * self.split)
            self.b = z - self.a
        self.start, self.closing, self.acceleration, self.z = start, closing, acceleration, z

    def __call__(self, time):
        if self.split is None:
            z = (self.b + self.a * time) * np.exp(-self.decay * time)
        else:
            terms = (
                self.a * np.exp((self.split - self.decay) * time),
                self.b * np.exp(-(self.split + self.decay) * time),
            )
            z = sum(terms).real
        return self.start + (z - self.z) + time * (self.closing + 0.5 * self.acceleration * time)

    def rate(self, time):
        if self.split is None:
            z_dot = (self.a - self.decay * (self.b + self.a * time)) * np.exp(-self.decay * time)
        else:
            slow, fast = self.split - self.decay, -self.split - self.decay
            z_dot = (self.a * slow * np.exp(slow * time) + self.b * fast * np.exp(fast * time)).real
        return z_dot + self.closing + self.acceleration * time

    def extrema(self, horizon, samples=4000):
        time = np.linspace(0.0, horizon, samples)
        rate = self.rate(time)
        turns = np.flatnonzero(np.sign(rate[1:]) * np.sign(rate[:-1]) < 0)
        return [brentq(self.rate, time[i], time[i + 1], xtol=1e-16) for i in turns]

    def first_touch(self, horizon):
        """First upward zero, sought between extrema, where the path is monotone."""
        marks = [0.0, *self.extrema(horizon), horizon]
        for left, right in pairwise(marks):
            if self(right) > 0 >= self(left):
                return brentq(self, left, right, xtol=1e-16)
        return math.inf


def random_flight(random, start=None):
    """Law, acceleration and path of a random flight, and the record it starts from."""
    frequency = 10 ** random.uniform(1, 2.5)
    damping_ratio = random.choice(
        [0.0, random.uniform(0, 0.2), random.uniform(0.2, 0.98), 1.0, random.uniform(1.02, 4)]
    )
    acceleration = random.choice([0.0, random.uniform(-20, 20)])
    closing = random.uniform(-0.5, 1.0)
    y_dot = random.uniform(-1.0, 1.0)
    y = random.uniform(-1.0, 1.0) / frequency
    if start is None:
        start = -random.choice([0.0, 10 ** random.uniform(-5, -1)])
        if start == 0.0 and closing + y_dot > 0:  # in touch: then they are parting
            closing = -y_dot - random.uniform(0, 0.5)
    record = chain(flange_velocity=closing + 0.3, deflection=y, deflection_rate=y_dot, gap=-start, object_velocity=0.3)
    path = Path(frequency, damping_ratio, acceleration, y, y_dot, start, closing)
    return spring(float(frequency), float(damping_ratio)), float(acceleration), path, record


def test_the_first_touch_of_a_random_flight_is_found():
    random = np.random.default_rng(3)
    touches = 0
    for _ in range(1500):
        law, acceleration, path, record = random_flight(random)
        horizon = random.uniform(0.01, 0.6)
        expected = path.first_touch(horizon)
        found = first_touch(law, record, acceleration, horizon)
        if math.isinf(expected) or math.isinf(found):
            assert found == expected
            continue
        touches += 1
        assert path(found) == pytest.approx(0.0, abs=1e-14)
        assert found == pytest.approx(expected, abs=1e-9)
    assert touches > 500


@pytest.mark.parametrize("margin", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_graze_is_told_from_a_near_miss(margin):
    # shift a random flight until the highest of its peaks just reaches the object, or just does not
    random = np.random.default_rng(4)
    horizon, grazes = 0.6, 0
    for _ in range(600):
        law, acceleration, path, record = random_flight(random, start=-1.0)
        peaks = [path(t) for t in path.extrema(horizon)]
        height = max(peaks, default=-1.0) + 1.0
        if height <= 2 * margin or path(horizon) + 1.0 >= height:
            continue
        record["penetration"] = path.start = -height - margin
        assert first_touch(law, record, acceleration, horizon) == math.inf
        record["penetration"] = path.start = -height + margin
        found = first_touch(law, record, acceleration, horizon)
        assert path(found) == pytest.approx(0.0, abs=1e-14)
        assert path.rate(found) > 0
        assert found == pytest.approx(path.first_touch(horizon), abs=1e-8)
        grazes += 1
    assert grazes > 100


def test_the_first_touch_of_a_rigid_tool_is_the_root_of_a_parabola():
    law = law_of(ig.Rigid())
    random = np.random.default_rng(5)
    touches = 0
    for _ in range(2000):
        acceleration = float(random.choice([0.0, random.uniform(-20, 20)]))
        rate = float(random.uniform(-1, 1.5))
        gap = float(random.choice([0.0, 10 ** random.uniform(-9, 0)]))
        if gap == 0.0:
            rate = -abs(rate)
        horizon = random.uniform(0.01, 1.0)
        # in touch and parting, the other root is t = 0
        roots = np.roots([0.5 * acceleration, rate, -gap] if gap else [0.5 * acceleration, rate])
        rising = [
            t.real for t in roots if abs(t.imag) == 0 and 0 < t.real <= horizon and rate + acceleration * t.real > 0
        ]
        record = chain(flange_velocity=0.3 + rate, deflection=0.0, deflection_rate=0.0, gap=gap, object_velocity=0.3)
        record["penetration_rate"] = rate
        found = first_touch(law, record, acceleration, horizon)
        if not rising:
            assert found == math.inf
            continue
        touches += 1
        assert found == pytest.approx(min(rising), rel=1e-6, abs=1e-15)
        # a root as good as rounding allows: the terms of the parabola cancel to their last digit
        terms = rate * found, 0.5 * acceleration * found**2
        assert sum(terms) == pytest.approx(gap, rel=0, abs=4 * np.finfo(float).eps * (abs(terms[0]) + abs(terms[1])))
    assert touches > 300


def test_a_rigid_tool_at_rest_against_the_object_touches_it_as_soon_as_it_speeds_up():
    record = chain(flange_velocity=0.3, deflection=0.0, deflection_rate=0.0, gap=0.0, object_velocity=0.3)
    record["penetration_rate"] = 0.0
    assert first_touch(law_of(ig.Rigid()), record, 1.0, 1.0) == 0.0
