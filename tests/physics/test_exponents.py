"""Contacts with free exponents (paper, eq. 5): against closed forms, quadrature and the Hertz kernels."""

import math

import numpy as np
import pytest
from impact_gym.kernels import APPROACH
from scipy.special import beta

import impact_gym as ig
from impact_gym.lowering import contact_law

MASS = 0.25
EXPONENTS = [1.0, 1.2, 1.5, 2.0, 3.0]


def collide(contact, *, speed=1.0, rtol=1e-10, coupling=None, brake=None, duration=1.0, trace=False):
    scene = ig.Scene(ig.Tool(0.125), ig.Object(MASS, 0.2505), contact, coupling or ig.Rigid())
    return ig.simulate(scene, ig.Trapezoid(speed, 8.0, brake), duration, rtol, trace)


@pytest.mark.parametrize("m", EXPONENTS)
def test_an_elastic_contact_of_any_exponent_has_the_depth_force_and_duration_of_its_energy(m):
    # (m + 1) / 2 M v^2 = k_c delta^(m + 1) at the deepest; duration = 2 integral d(delta) / sqrt(v^2 - ...) is a beta
    k_c, v = 1e4, 0.8
    outcome = collide(ig.Contact(k_c, 1.0, stiffness_exponent=m, damping_exponent=m), speed=v, trace=True)
    (contact,) = outcome.contacts
    deepest = ((m + 1) / 2 * MASS * v * v / k_c) ** (1 / (m + 1))
    assert contact.peak_force == pytest.approx(k_c * deepest**m, rel=1e-9)
    duration = 2 * deepest / v * beta(1 / (m + 1), 0.5) / (m + 1)
    assert contact.end - contact.start == pytest.approx(duration, rel=1e-9)
    assert contact.separation_velocity == pytest.approx(v, rel=1e-9)
    assert outcome.object_velocity == pytest.approx(2 * v, rel=1e-9)


@pytest.mark.parametrize("zeta", [0.1, 0.45, 0.8, 1.2])
def test_the_linear_contact_is_the_linear_oscillator(zeta):
    k, v = 1e4, 1.0
    e = float(ig.physics.dissipation.delivered_linear(2 * zeta))
    contact = ig.Contact(k, e, "exact", stiffness_exponent=1.0, damping_exponent=0.0)
    outcome = collide(contact, trace=True)
    (first,) = outcome.contacts
    w = math.sqrt(k / MASS)
    times = np.linspace(0.0, 4.0 / w, 200_001)
    wd = w * np.emath.sqrt(1 - zeta**2)
    x = (np.exp(-zeta * w * times) * np.sin(wd * times) / wd).real * v
    x_dot = np.gradient(x, times)
    force = k * x + 2 * zeta * math.sqrt(k * MASS) * x_dot
    ends = times[np.argmax(force[5:] <= 0.0) + 5]  # then the surfaces part at -x_dot faster than they recover
    left = np.interp(ends, times, x)
    assert first.separation_velocity == pytest.approx(e * v, rel=1e-9)
    assert first.end - first.start == pytest.approx(ends + left / (e * v), rel=1e-4)
    assert first.peak_force == pytest.approx(force[:-5].max(), rel=1e-4)
    touching = (outcome.trace.time > first.start) & (outcome.trace.time < first.start + 0.9 * ends)
    expected = np.interp(outcome.trace.time[touching] - first.start, times, force)
    assert outcome.trace.contact_force[touching] == pytest.approx(expected, abs=2e-3 * first.peak_force)
    assert (outcome.trace.contact_force >= 0.0).all()


def test_a_linear_contact_is_felt_at_once():
    contact = ig.Contact(1e4, 0.3, "exact", stiffness_exponent=1.0, damping_exponent=0.0)
    outcome = collide(contact, brake=ig.Brake())
    assert outcome.detection_time == outcome.contacts[0].start


def test_exponents_of_three_halves_have_a_fast_branch_that_says_the_same():
    for e in (0.1, 0.5, 1.0):
        hertz = collide(ig.Contact(1e5, e), coupling=ig.SpringDamper(150.0), brake=ig.Brake(), rtol=1e-11)
        almost = ig.Contact(1e5, e, stiffness_exponent=1.5 + 1e-13, damping_exponent=1.5 + 1e-13)
        assert dict(zip(APPROACH["contact"].names, contact_law(almost), strict=True))["twice_m"] == -1
        power = collide(almost, coupling=ig.SpringDamper(150.0), brake=ig.Brake(), rtol=1e-11)
        assert power.object_velocity == pytest.approx(hertz.object_velocity, rel=1e-9)
        assert power.peak_force == pytest.approx(hertz.peak_force, rel=1e-9)
        assert power.detection_time == pytest.approx(hertz.detection_time, rel=1e-10)


@pytest.mark.parametrize(
    ("m", "n"), [(1.0, 0.0), (1.2, 1.2), (1.5, 1.0), (1.5, 0.0), (2.0, 3.0), (1.0, 2.0), (2.5, 1.0)]
)
@pytest.mark.parametrize("coupling", [ig.Rigid(), ig.SpringDamper(150.0), ig.Bistable()], ids=str)
def test_momentum_and_energy_hold_for_any_exponents(m, n, coupling):
    contact = ig.Contact(1e4, 0.3, stiffness_exponent=m, damping_exponent=n)
    outcome = collide(contact, coupling=coupling, brake=ig.Brake(), trace=True, rtol=1e-8)
    assert outcome.momentum_error < 1e-9
    assert (outcome.trace.contact_force >= 0.0).all()
    for each in outcome.contacts:
        assert each.peak_force >= 0.0
    if isinstance(coupling, ig.Rigid):
        assert outcome.contacts[0].separation_velocity <= 1.0 + 1e-9  # the flange holds its speed until the alarm


@pytest.mark.parametrize(("m", "n"), [(1.0, 0.0), (1.2, 1.2), (1.5, 1.0), (2.0, 3.0)])
def test_the_answer_converges_with_rtol(m, n):
    contact = ig.Contact(1e4, 0.3, stiffness_exponent=m, damping_exponent=n)

    def final(rtol):
        return collide(contact, coupling=ig.SpringDamper(150.0), brake=ig.Brake(), rtol=rtol).object_velocity

    exact = final(1e-13)
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
        assert abs(final(rtol) - exact) < 2 * rtol


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"stiffness_exponent": 0.99}, "stiffness_exponent"),
        ({"stiffness_exponent": 11.0}, "stiffness_exponent"),
        ({"stiffness_exponent": math.nan}, "stiffness_exponent"),
        ({"damping_exponent": 0.5}, "damping_exponent"),
        ({"damping_exponent": -1.0}, "damping_exponent"),
        ({"damping_exponent": math.inf}, "damping_exponent"),
    ],
)
def test_exponents_out_of_range_are_refused(change, field):
    with pytest.raises(ValueError, match=rf"Contact\.{field}"):
        ig.Contact(1e5, 0.5, **change)


@pytest.mark.parametrize("field", ["stiffness_exponent", "damping_exponent"])
@pytest.mark.parametrize("value", ["1.5", None, True])
def test_exponents_that_are_no_numbers_are_refused(field, value):
    with pytest.raises(TypeError, match=rf"Contact\.{field}"):
        ig.Contact(1e5, 0.5, **{field: value})
