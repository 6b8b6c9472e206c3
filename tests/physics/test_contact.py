"""One contact against closed forms; what a damping delivers."""

import mpmath
import numpy as np
import pytest
from solver_scenes import scene

import impact_gym as ig
from experiments.reference import laws
from impact_gym.physics import dissipation

STIFFNESS, T0 = 1e5, (0.25 / 1e5) ** 0.4  # N/m^1.5; s, with an object of 0.25 kg at 1 m/s
CRITICAL_PUSH = {0.9: 0.826855, 0.5: 0.201167, 0.1: 0.018308}  # by restitution; above it the contact never ends


@pytest.mark.parametrize(("restitution", "critical"), CRITICAL_PUSH.items())
def test_pushed_contact_lasts_above_the_critical_push(restitution, critical):
    for push in (critical - 1e-6, critical + 1e-6, 1.1 * critical):  # a constant acceleration, in v/t0
        acceleration = push / T0
        met, motion = scene(STIFFNESS, restitution, distance=0.5 / acceleration), ig.Trapezoid(50.0, acceleration)
        contact = ig.simulate(met, motion, 1 / acceleration + 40 * T0, 1e-12).contacts[0]  # does not reach 50 m/s
        assert contact.approach_velocity == pytest.approx(1.0, rel=1e-14)
        assert (contact.end is None) == (push > critical)


RESTITUTIONS = np.unique(np.concatenate([np.geomspace(1e-3, 1.0, 80), 1.0 - np.geomspace(1e-15, 0.5, 60)]))


def lambert(damping):
    """The effective restitution by its closed form, 60 digits."""
    with mpmath.workdps(60):
        d = mpmath.mpf(damping)
        return (1 + mpmath.lambertw(-(1 + d) * mpmath.exp(-(1 + d))).real) / d if d else mpmath.mpf(1)


@pytest.mark.parametrize("law", ["exact", *laws.CLOSURES])
def test_effective_restitution_of_each_law_is_right_to_2e_15(law):
    effective = ig.effective_restitution(law, RESTITUTIONS[:, None])
    assert effective.shape == (len(RESTITUTIONS), 1)
    assert isinstance(ig.effective_restitution(law, 0.5), float)
    for nominal, value in zip(RESTITUTIONS.tolist(), effective[:, 0].tolist(), strict=True):
        expected = nominal if law == "exact" else lambert(laws.CLOSURES[law](nominal))
        assert float(abs(mpmath.mpf(value) - expected)) < 2e-15 * float(expected)
        delivered = lambert(dissipation.damping_factor(law, nominal))
        assert float(abs(delivered - expected)) < 1e-13 * float(expected)


HOOKE = {"dissipation": "exact", "stiffness_exponent": 1.0, "damping_exponent": 0.0}
HERTZ = [{"dissipation": law} for law in ("exact", *laws.CLOSURES)]
OTHER_POWERS = [law | {"stiffness_exponent": m, "damping_exponent": m} for law in HERTZ for m in (1.0, 3.0)]
MIXED = [HOOKE | {"stiffness_exponent": m, "damping_exponent": n}
         for m, n in ((1.5, 1.0), (1.2, 1.7), (1.5, 0.0), (1.5, 2.0), (2.0, 1.5), (2.0, 2.0))]  # fmt: skip
# with those of Project Chrono's test of the normal restitution, which requires 1e-3
RESTITUTIONS_OF_CONTACTS = 0.01, 0.02, 0.05, 0.1, 0.25, 0.4, 0.5, 0.75, 0.9, 1.0


@pytest.mark.parametrize("law", [HOOKE, *HERTZ, *OTHER_POWERS, *MIXED], ids=str)
def test_restitution_is_that_of_the_law_whatever_the_scales(law):
    """A wall that moves at `speed` meets an object."""
    random, name = np.random.default_rng(1), law["dissipation"]
    m, n = (law.get(f"{part}_exponent", 1.5) for part in ("stiffness", "damping"))
    for restitution in RESTITUTIONS_OF_CONTACTS:
        delivered = ig.effective_restitution(name, restitution)
        if restitution in (0.1, 0.5, 1.0):  # the independent solver needs seconds for smaller ones
            ours, independent = (each.damping_factor(name, restitution, m, n) for each in (dissipation, laws))
            assert ours == pytest.approx(independent, rel=1e-9)
        scales = 10 ** random.uniform([2, -3.6, -2], [10, 2.4, 1.5], (5, 3))
        for stiffness, mass, speed in [(1e5, 0.25, 1.0), *scales.tolist()]:
            t0 = (mass * speed**2 / stiffness) ** (1 / (m + 1)) / speed
            struck = scene(stiffness, restitution, m_p=mass, distance=0.2505 * speed, **law)
            (hit,) = ig.simulate(struck, ig.Trapezoid(speed, 8.0 * speed), 0.32 + 1000 * t0, 1e-12).contacts
            assert hit.start == pytest.approx(0.2505 + 1 / 16, rel=1e-14)
            assert hit.approach_velocity == pytest.approx(speed, rel=1e-12)
            assert hit.separation_velocity / speed == pytest.approx(delivered, rel=1e-10)
            assert hit.object_velocity / speed == pytest.approx(1 + delivered, rel=1e-9)


@pytest.mark.parametrize("zeta", [0.05, 0.4, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 1.5, 1e3])
def test_delivered_linear_is_that_of_an_oscillator(zeta):
    # x'' + 2 zeta x' + x = 0, x' = 1: the force 2 zeta x' + x ends at omega_d t = pi - 2 arcsin(zeta), with -x' = e
    with mpmath.workdps(50):
        z = mpmath.mpf(zeta)
        root = mpmath.sqrt(1 - z * z)  # imaginary above critical damping
        e = mpmath.exp(-2 * z * mpmath.acos(z) / root).real if zeta != 1.0 else mpmath.exp(-2)
    assert dissipation.delivered_linear(2.0 * zeta) == pytest.approx(float(e), rel=1e-9)


SHARES = {"hunt-crossley": 1, "lankarani-nikravesh": 1, "herbert-mcwhannell": 1, "hu-guo": 1, "exact": 1}
SHARES |= {"gonthier": 4 / 3, "flores": 16 / 15}
"""(2/3) d / (1 - e) for e near 1, by hand, from the formula for d in the source."""


def test_law_near_e_1_has_the_loss_that_follows_from_its_formula():
    assert SHARES.keys() - {"exact"} == dissipation.PUBLISHED.keys() == laws.CLOSURES.keys()
    for law, share in SHARES.items():  # where d is small, e_eff = 1 - 2/3 d
        lost = 1.0 - ig.effective_restitution(law, 1.0 - 1e-7)
        assert lost / 1e-7 == pytest.approx(share, rel=1e-6), law
