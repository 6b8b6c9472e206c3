"""Contacts with free exponents (paper, eq. 5): against the Hertz kernels, and the balances they keep."""

import pytest
from impact_gym.kernels import APPROACH
from scenes import MOTION, scene

import impact_gym as ig
from impact_gym.lowering import contact_law

SPRING = ig.SpringDamper(150.0)


@pytest.mark.parametrize("e", [0.1, 0.5, 1.0])
def test_exponents_of_three_halves_have_a_fast_branch_that_says_the_same(e):
    almost = scene(1e5, e, SPRING, stiffness_exponent=1.5 + 1e-13, damping_exponent=1.5 + 1e-13)
    assert dict(zip(APPROACH["contact"].names, contact_law(almost.contact), strict=True))["twice_m"] == -1
    hertz, power = (ig.simulate(one, MOTION, 1.0, 1e-11) for one in (scene(1e5, e, SPRING), almost))
    assert power.object_velocity == pytest.approx(hertz.object_velocity, rel=1e-9)
    assert power.peak_force == pytest.approx(hertz.peak_force, rel=1e-9)
    assert power.detection_time == pytest.approx(hertz.detection_time, rel=1e-10)


@pytest.mark.parametrize(
    ("m", "n"), [(1.0, 0.0), (1.2, 1.2), (1.5, 1.0), (1.5, 0.0), (2.0, 3.0), (1.0, 2.0), (2.5, 1.0)]
)
@pytest.mark.parametrize("coupling", [ig.Rigid(), SPRING, ig.Bistable()], ids=str)
def test_momentum_and_energy_hold_for_any_exponents(m, n, coupling):
    any_law = scene(1e4, 0.3, coupling, stiffness_exponent=m, damping_exponent=n)
    outcome = ig.simulate(any_law, MOTION, 1.0, 1e-8, trace=True)
    assert outcome.momentum_error < 1e-9
    assert (outcome.trace.contact_force >= 0.0).all()
    assert all(contact.peak_force >= 0.0 for contact in outcome.contacts)
    if isinstance(coupling, ig.Rigid):
        assert outcome.contacts[0].separation_velocity <= 1.0 + 1e-9  # the flange holds its speed until the alarm


@pytest.mark.parametrize(("m", "n"), [(1.0, 0.0), (1.2, 1.2), (1.5, 1.0), (2.0, 3.0)])
def test_the_answer_converges_with_rtol(m, n):
    chain = scene(1e4, 0.3, SPRING, stiffness_exponent=m, damping_exponent=n)
    exact = ig.simulate(chain, MOTION, 1.0, 1e-13).object_velocity
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
        assert abs(ig.simulate(chain, MOTION, 1.0, rtol).object_velocity - exact) < 2 * rtol
