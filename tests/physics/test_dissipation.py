"""What restitution a damping factor delivers, against Lambert's W in many digits, and what the solver makes of it."""

import mpmath
import numpy as np
import pytest
from scenes import CRUISE, scene
from solvers import BOTH, fast

import impact_gym as ig
from experiments.reference.laws import CLOSURES
from impact_gym.physics import dissipation

RESTITUTIONS = np.unique(np.concatenate([np.geomspace(1e-3, 1.0, 80), 1.0 - np.geomspace(1e-15, 0.5, 60)]))


def lambert(damping):
    """e_eff of the closed form, 60 digits."""
    with mpmath.workdps(60):
        d = mpmath.mpf(damping)
        return (1 + mpmath.lambertw(-(1 + d) * mpmath.exp(-(1 + d))).real) / d if d else mpmath.mpf(1)


def test_delivered_is_the_closed_form_to_fourteen_digits():
    for damping in np.concatenate([np.geomspace(1e-12, 1500.0, 200), [0.0, 0.2999999, 0.3, 0.3000001]]):
        assert float(abs(dissipation.delivered(damping) / lambert(damping) - 1)) < 2e-15


@pytest.mark.parametrize("law", ["exact", *CLOSURES])
def test_effective_restitution_of_each_law_is_right_to_1e_14(law):
    effective = ig.effective_restitution(law, RESTITUTIONS)
    for nominal, value in zip(RESTITUTIONS.tolist(), effective.tolist(), strict=True):
        expected = nominal if law == "exact" else lambert(CLOSURES[law](nominal))
        assert float(abs(mpmath.mpf(value) - expected)) < 1e-14 * float(expected)


@pytest.mark.parametrize(
    ("restitution", "hu_guo", "effective", "exact"),
    [  # physics.md, 'Equations'
        (0.01, 148.5, 0.00673400673, 100.000),
        (0.05, 28.5, 0.0350877193, 20.0000),
        (0.1, 13.5, 0.0740735324, 9.99816),
        (0.3, 3.5, 0.2706584586, 3.08708),
        (0.5, 1.5, 0.4877412560, 1.432750533),
        (0.7, 0.642857, 0.6972969681, 0.634828),
        (0.9, 0.166667, 0.8998999431, 0.166482),
    ],
)
def test_damping_factor_is_that_of_the_working_notes(restitution, hu_guo, effective, exact):
    assert dissipation.damping_factor("hu-guo", restitution) == pytest.approx(hu_guo, abs=5.1e-7)
    assert ig.effective_restitution("hu-guo", restitution) == pytest.approx(effective, abs=6e-11)
    assert dissipation.damping_factor("exact", restitution) == pytest.approx(exact, rel=2e-6)


HOOKE = {"dissipation": "exact", "stiffness_exponent": 1.0, "damping_exponent": 0.0}
HERTZ = [{"dissipation": law} for law in ("exact", *CLOSURES)]
OTHER_POWERS = [law | {"stiffness_exponent": m, "damping_exponent": m} for law in HERTZ for m in (1.0, 3.0)]
RESTITUTIONS_OF_CONTACTS = (0.01, 0.02, 0.05, 0.1, 0.25, 0.4, 0.5, 0.75, 0.9, 1.0)
"""With those of Project Chrono's test of the normal restitution, which asks for 1e-3."""


@BOTH
@pytest.mark.parametrize("law", [HOOKE, *HERTZ, *OTHER_POWERS], ids=str)
def test_object_rebounds_from_a_moving_wall_with_the_restitution_of_each_law_whatever_the_scales(simulate, law):
    random, power = np.random.default_rng(1), law.get("stiffness_exponent", 1.5)
    for restitution in RESTITUTIONS_OF_CONTACTS:
        others = 10 ** random.uniform([2, -3.6, -2], [10, 2.4, 1.5], (8, 3))
        for stiffness, mass, speed in [(1e5, 0.25, 1.0), *(others.tolist() if simulate is fast else [])]:
            t0 = (mass * speed**2 / stiffness) ** (1 / (power + 1)) / speed
            wall = scene(stiffness, restitution, m_p=mass, distance=0.2505 * speed, **law)
            (hit,) = simulate(wall, ig.Trapezoid(speed, 8.0 * speed), 0.32 + 1000 * t0).contacts
            delivered = ig.effective_restitution(law["dissipation"], restitution)
            assert hit.start == pytest.approx(0.2505 + 1 / 16, rel=1e-14)
            assert hit.approach_velocity == pytest.approx(speed, rel=1e-12)
            assert hit.separation_velocity / speed == pytest.approx(delivered, rel=1e-10 if simulate is fast else 1e-9)
            assert hit.object_velocity / speed == pytest.approx(1 + delivered, rel=1e-9)
            assert simulate is not fast or hit.momentum_error < 1e-12


@BOTH
@pytest.mark.parametrize(
    ("m", "n"),
    [(1.0, 0.0), (1.0, 1.0), (1.5, 1.5), (2.0, 2.0), (2.0, 1.5), (1.5, 1.0), (1.5, 2.0), (1.2, 1.7), (1.5, 0.0)],
)
@pytest.mark.parametrize(("e", "m_p"), [(0.1, 0.25), (0.5, 0.25), (0.5, 2.5), (0.6, 0.25), (0.9, 0.25), (1.0, 0.25)])
def test_exact_delivers_the_restitution_whatever_the_exponents(simulate, m, n, e, m_p):
    exact = scene(1e5, e, m_p=m_p, dissipation="exact", stiffness_exponent=m, damping_exponent=n)
    (contact,) = simulate(exact, CRUISE, 1.5).contacts
    assert contact.separation_velocity == pytest.approx(e, rel=1e-9)


@pytest.mark.parametrize("zeta", [0.05, 0.4, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 1.5, 1e3])
def test_delivered_linear_leaves_when_its_force_would_pull(zeta):
    # x'' + 2 zeta x' + x = 0, x' = 1: the force 2 zeta x' + x ends at omega_d t = pi - 2 arcsin(zeta), with -x' = e
    with mpmath.workdps(50):
        z = mpmath.mpf(zeta)
        root = mpmath.sqrt(1 - z * z)  # imaginary above critical damping
        e = mpmath.exp(-2 * z * mpmath.acos(z) / root).real if zeta != 1.0 else mpmath.exp(-2)
    assert dissipation.delivered_linear(2.0 * zeta) == pytest.approx(float(e), rel=1e-9)


def test_effective_restitution_keeps_the_shape_of_its_argument():
    assert isinstance(ig.effective_restitution("hu-guo", 0.5), float)
    assert ig.effective_restitution("hu-guo", [[0.5, 0.6]]).shape == (1, 2)
