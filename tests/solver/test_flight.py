"""Flight: closed forms against the matrix exponential; the first touch, and the bounds with which it is searched."""

import math

import mpmath
import numpy as np
import pytest
from kernel_access import kernels
from scipy.linalg import expm
from solver_scenes import random_mechanism, stored_energy

import impact_gym as ig
from impact_gym.pack import pack_mount

TOOL_MASS = 0.125  # kg
FREQUENCY = 35.0  # rad/s
DAMPING_RATIOS = [0.0, 0.3, 0.9, 1 - 1e-9, 1.0, 1 + 1e-9, 1.1, 3.0, 50.0]
STATE = "flange_position", "flange_velocity", "deflection", "deflection_rate", "penetration", "penetration_rate"


def model_of(coupling, robot=None):
    return kernels().models_of(pack_mount(TOOL_MASS, coupling, robot)[0])


def spring(frequency, damping_ratio):
    return model_of(ig.SpringDamper(TOOL_MASS * frequency**2, damping_ratio))


def chain(*, flange_velocity=0.9, deflection=0.004, deflection_rate=-0.3, gap=0.08, object_velocity=0.2):
    record = np.zeros(1, kernels().CHAIN)
    closing = flange_velocity + deflection_rate - object_velocity
    record[[*STATE]] = 0.02, flange_velocity, deflection, deflection_rate, -gap, closing
    return record


def equations(acceleration, frequency=None, damping_ratio=0.0):
    """A of z' = A z with z = (STATE, 1); without a frequency the coupling is rigid."""
    matrix = np.zeros((7, 7))
    matrix[0, 1] = matrix[2, 3] = matrix[4, 5] = 1.0
    matrix[1, 6] = acceleration
    if frequency is not None:
        matrix[3, 2], matrix[3, 3], matrix[3, 6] = -(frequency**2), -2 * damping_ratio * frequency, -acceleration
    matrix[5] = matrix[1] + matrix[3]  # the object does not accelerate
    return matrix


def state_of(record):
    return np.array([*record[[*STATE]][0].tolist(), 1.0])


@pytest.mark.parametrize("damping_ratio", [None, *DAMPING_RATIOS], ids=str)  # None: a rigid coupling
def test_drift_under_an_acceleration_is_the_matrix_exponential(damping_ratio):
    model, of_spring, still = spring(FREQUENCY, damping_ratio or 0.0), (FREQUENCY, damping_ratio), {"deflection": 1.0}
    if damping_ratio is None:
        model, of_spring, still = model_of(ig.Rigid()), (), {"deflection": 0.0, "deflection_rate": 0.0}
    change = math.sqrt(1e-3 / max(abs((damping_ratio or 0.0) ** 2 - 1), 1e-9))  # here the formula changes
    for angle in (1e-6, 1e-2, 0.03162, 0.5, 3.0, 40.0, change * (1 - 1e-12), change * (1 + 1e-12)):
        flight, time = chain(**still), angle / FREQUENCY
        with mpmath.workdps(40):  # the rounding errors of SciPy's expm depend on its version
            matrix = mpmath.expm(mpmath.matrix(equations(8.0, *of_spring).tolist()) * time)
            exact = [float(number) for number in matrix * mpmath.matrix(state_of(flight).tolist())]
        kernels().drift_once(model, flight, 8.0, time)
        assert state_of(flight) == pytest.approx(exact, rel=1e-12, abs=1e-14)
        assert flight["time"] == pytest.approx(time, rel=1e-12)


def test_first_touch_of_a_random_flight_is_on_its_path():
    random, touches, samples = np.random.default_rng(3), 0, 600  # the fastest oscillation has 19 in a period
    for _ in range(500):
        frequency, (light, heavy, beyond) = 10 ** random.uniform(1, 2.5), random.uniform([0, 0.2, 1.02], [0.2, 0.98, 4])
        of_spring = frequency, random.choice([0.0, light, heavy, 1.0, beyond])
        acceleration = random.choice([0.0, random.uniform(-20, 20)])
        closing, y_dot = random.uniform([-0.5, -1], [1, 1])
        y, model = random.uniform(-1.0, 1.0) / frequency, spring(*of_spring)
        if random.random() < 0.2:
            y, y_dot, model, of_spring = 0.0, 0.0, model_of(ig.Rigid()), ()
        gap = 10 ** random.uniform(-5, -1)
        if random.random() < 0.5:
            gap = 0.0
            if closing + y_dot > 0:  # bodies that touch at the start separate
                closing = -y_dot - random.uniform(0, 0.5)
        record = chain(flange_velocity=closing + 0.3, deflection=y, deflection_rate=y_dot, gap=gap, object_velocity=0.3)
        matrix, h = equations(acceleration, *of_spring), random.uniform(0.01, 0.6) / samples
        states, step = [state_of(record)], expm(matrix * h)
        for _ in range(samples):
            states.append(step @ states[-1])
        touch = kernels().first_touch(model, record, float(acceleration), samples * h)
        inside = np.flatnonzero(np.array(states)[1:, 4] > 1e-15)
        assert touch <= (h * (inside[0] + 1) if len(inside) else math.inf)
        if math.isfinite(touch):
            touches += 1
            there = expm(matrix * touch) @ states[0]
            assert there[4] == pytest.approx(0.0, abs=1e-14)
            assert there[5] > -1e-9
    assert touches > 150
    at_rest = chain(flange_velocity=0.0, deflection=0.0, deflection_rate=0.0, gap=0.0, object_velocity=0.0)
    assert kernels().first_touch(model_of(ig.Rigid()), at_rest, 1.0, 1.0) == 0.0  # as soon as it accelerates


@pytest.mark.parametrize("margin", [0.1, 1e-6, 1e-9])
def test_undamped_tool_reaches_just_as_far_as_its_energy_allows(margin):
    random = np.random.default_rng(6)  # flange and object rest, so the tool gets to hypot(y, y' / omega)
    for _ in range(100):
        y, y_dot, frequency = random.uniform(-0.05, 0.05), random.uniform(-1, 1), 10 ** random.uniform(0, 2.5)
        reach, model = math.hypot(y, y_dot / frequency), spring(frequency, 0.0)
        for beyond in (True, False):
            gap = reach * (1 + margin if beyond else 1 - margin) - y
            record = chain(flange_velocity=0.0, deflection=y, deflection_rate=y_dot, gap=gap, object_velocity=0.0)
            assert kernels().never_touches(model, record) == beyond
            assert math.isinf(kernels().first_touch(model, record, 0.0, 7.0 / frequency)) == beyond


SPRINGS = [ig.SpringDamper(80.0, 0.5, stroke=0.01)]
MECHANISMS = [random_mechanism(np.random.default_rng(seed)) for seed in range(4)]
SOFT = [ig.Bistable(front_stop=x, stop_stiffness=k) for x, k in ((1e-4, 300.0), (5e-3, 100.0), (5e-3, 30.0))]


@pytest.mark.parametrize("coupling", [*SPRINGS, *MECHANISMS, *SOFT], ids=lambda coupling: type(coupling).__name__)
def test_energy_of_a_coupling_bounds_its_reach(coupling):
    bistable, model, low, high = isinstance(coupling, ig.Bistable), model_of(coupling), -0.012, 0.012
    if bistable:
        low, high = coupling.rear_stop - coupling.rest - 2e-3, coupling.front_stop - coupling.rest + 2e-3
    of_kernel, at_rest = kernels().energy_and_reach, stored_energy(coupling, 0.0)
    for stretch in np.random.default_rng(7).uniform(low, high, 12):
        energy = stored_energy(coupling, stretch)
        gained = of_kernel(model, stretch, 0.0)[0] - of_kernel(model, 0.0, 0.0)[0]
        assert gained == pytest.approx(energy - at_rest, rel=1e-9, abs=1e-12)
        for kinetic in (1e-4, 1e-2, 1.0):
            reach = of_kernel(model, stretch, kinetic)[1]
            if bistable and stretch < -coupling.rest == reach:  # it cannot pass the alignment
                assert stored_energy(coupling, -coupling.rest) > energy + kinetic
                continue
            beyond = max(reach, stretch) + np.linspace(0.0, 0.01, 50)[1:]
            assert stored_energy(coupling, beyond).min() > (energy + kinetic) * (1 - 1e-9)
    if coupling not in SOFT:  # from rest against a stop or a spring the bound is close
        stiffness = coupling.stop_stiffness if bistable else coupling.stiffness
        assert of_kernel(model, 0.0, 1e-4)[1] == pytest.approx(math.sqrt(2e-4 / stiffness), rel=0.05)
