"""The bistable mechanism: its spring against calculus, its slider against conservation laws and the closed form."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import BOTH, scene
from scipy.integrate import quad
from scipy.optimize import brentq

import impact_gym as ig
from experiments.reference.laws import BistableForce

MECHANISM = ig.Bistable()
TOOL_MASS = 0.125
FAR = 1e3  # m, an object that the tool never reaches


def approach(*, speed=1.0, acceleration=8.0, distance=0.2505, duration=1.5):
    """The outcome, and the slider's position from the alignment, m; at rest the stop bears the preload."""
    motion = ig.Trapezoid(speed, acceleration, ig.Brake(deceleration=8.0))
    outcome = ig.simulate(scene(1e3, 0.1, MECHANISM, distance=distance), motion, duration, 1e-10, trace=True)
    return outcome, outcome.trace.tool_position - outcome.trace.flange_position + MECHANISM.rest


def test_force_is_minus_the_slope_of_the_energy():
    x, h = np.linspace(-0.08, 0.08, 41), 1e-6
    slope = (MECHANISM.energy(x + h) - MECHANISM.energy(x - h)) / (2 * h)
    assert MECHANISM.force(x) == pytest.approx(-slope, abs=1e-8)


@pytest.mark.parametrize("force", [MECHANISM.force, np.vectorize(BistableForce(MECHANISM, TOOL_MASS).spring)])
def test_force_has_the_numbers_of_fig_22(force):
    x = np.linspace(0.0, 0.07, 100_001)
    barrier = quad(force, 0.0, MECHANISM.stroke)[0]
    assert force(x).max() == pytest.approx(1.0817, abs=5e-5)
    assert x[force(x).argmax()] == pytest.approx(25.69e-3, abs=5e-6)
    assert x[1:][force(x[1:]) > 0].max() == pytest.approx(64.156e-3, abs=1e-6)
    assert barrier == pytest.approx(44.1e-3, abs=5e-6)
    assert MECHANISM.energy(0.0) == pytest.approx(barrier, rel=1e-9)
    assert MECHANISM.stroke == pytest.approx(64.156e-3, abs=5e-7)
    assert force(MECHANISM.stroke * np.array([-1.0, 0.0, 1.0])) == pytest.approx([0.0] * 3, abs=1e-14)


def test_mechanism_starts_at_rest_under_its_preload():
    outcome, x = approach(acceleration=1e-6, distance=FAR, duration=1.0)
    trace = outcome.trace
    assert trace.coupling_force[trace.time == 0.0] == pytest.approx(0.0, abs=1e-12)
    assert x == pytest.approx(MECHANISM.rest, abs=1e-11)
    assert np.abs(trace.tool_velocity - trace.flange_velocity).max() < 1e-9


@pytest.mark.parametrize("stop_stiffness", [1e2, 1e5, 1e9])
def test_slider_rests_where_its_front_stop_bears_the_preload(stop_stiffness):
    rng = np.random.default_rng(8)
    for _ in range(200):
        height = rng.uniform(0.005, 0.06)
        mechanism = ig.Bistable(rng.uniform(20.0, 2000.0), rng.uniform(1.05, 2.0) * height, height, 1e-6, -1e-6)
        front = mechanism.stroke * rng.uniform(0.01, 0.99)
        mechanism = replace(mechanism, front_stop=front, stop_stiffness=stop_stiffness)

        def net(x, mechanism=mechanism):
            return mechanism.force(x) - mechanism.stop_stiffness * (x - mechanism.front_stop)

        exact = brentq(net, front, mechanism.stroke, xtol=1e-300, rtol=8.9e-16)
        assert mechanism.rest == pytest.approx(exact, rel=1e-14)


@pytest.mark.parametrize(("share", "pressed", "held"), [(0.87, True, True), (0.97, False, True), (1.03, False, False)])
def test_mechanism_leaves_the_front_stop_if_the_flange_accelerates_faster_than_the_preload_holds(share, pressed, held):
    # The preload can accelerate the tool by preload / tool mass. After a sudden start the stop (zeta = 1) overshoots by
    # exp(-2), so the slider leaves it for a moment from a share of 1 / (1 + exp(-2)) = 0.8808 on.
    acceleration = share * MECHANISM.force(MECHANISM.front_stop) / TOOL_MASS
    _, x = approach(speed=0.5, acceleration=acceleration, distance=FAR, duration=0.5 / acceleration)
    assert np.all(x > MECHANISM.front_stop) == pressed  # throughout
    assert (x[-1] > MECHANISM.front_stop) == held


@pytest.mark.parametrize("speed", [0.3, 1.0, 2.0])
def test_stops_never_pull(speed):
    outcome, x = approach(speed=speed, duration=3.0)
    stop = outcome.trace.coupling_force - MECHANISM.force(x)
    assert np.all(stop[x > 0] <= 1e-9)
    assert np.all(stop[x < 0] >= -1e-9)
    assert np.all(np.abs(stop[(x > MECHANISM.rear_stop) & (x < MECHANISM.front_stop)]) < 1e-6)


@BOTH
@pytest.mark.parametrize("zeta", [0.0, 0.1, 0.3, 0.5, 1.0, 2.0, 4.0])
def test_stop_returns_what_a_spring_and_damper_that_never_pulls_returns(simulate, zeta):
    # exp(-2 zeta arccos(zeta) / sqrt(1 - zeta^2)), so exp(-2) = 0.1353 at zeta = 1: not 'completely inelastic'.
    # The spring is so weak that the tool stands still until the rear stop hits it at the flange's speed, 1 m/s.
    weak = ig.Bistable(stiffness=1e-9, front_stop=5e-3, rear_stop=-5e-3, stop_damping_ratio=zeta)
    outcome = simulate(scene(coupling=weak, distance=50.0), ig.Trapezoid(1.0, 1e3), 0.017)
    assert outcome.tool_velocity - 1 == pytest.approx(ig.physics.dissipation.delivered_linear(2 * zeta), rel=1e-7)
    assert len(outcome.snap_through) == 1
