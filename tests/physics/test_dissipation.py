"""What restitution a damping factor delivers, against Lambert's W in many digits, and what the solver makes of it."""

import math
from itertools import product

import mpmath
import numpy as np
import pytest

import impact_gym as ig
from impact_gym.physics import dissipation

LAWS = ("exact", *dissipation.PUBLISHED)
RESTITUTIONS = np.unique(np.concatenate([np.geomspace(1e-3, 1.0, 80), 1.0 - np.geomspace(1e-15, 0.5, 60)]))


def lambert(damping):
    """e_eff of the closed form, 60 digits."""
    with mpmath.workdps(60):
        d = mpmath.mpf(damping)
        return (1 + mpmath.lambertw(-(1 + d) * mpmath.exp(-(1 + d))).real) / d if d else mpmath.mpf(1)


def test_the_delivered_restitution_is_the_closed_form_to_fourteen_digits():
    for damping in np.concatenate([np.geomspace(1e-12, 1500.0, 200), [0.0, 0.2999999, 0.3, 0.3000001]]):
        assert float(abs(dissipation.delivered(damping) / lambert(damping) - 1)) < 2e-15


@pytest.mark.parametrize("law", LAWS)
def test_the_effective_restitution_of_each_law_is_right_to_1e_14(law):
    effective = ig.effective_restitution(law, RESTITUTIONS)
    for nominal, value in zip(RESTITUTIONS.tolist(), effective.tolist(), strict=True):
        expected = mpmath.mpf(nominal) if law == "exact" else lambert(dissipation.PUBLISHED[law](nominal))
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
def test_the_table_of_the_working_notes(restitution, hu_guo, effective, exact):
    assert dissipation.damping_factor("hu-guo", restitution) == pytest.approx(hu_guo, abs=5.1e-7)
    assert ig.effective_restitution("hu-guo", restitution) == pytest.approx(effective, abs=6e-11)
    assert dissipation.damping_factor("exact", restitution) == pytest.approx(exact, rel=2e-6)


@pytest.mark.parametrize("law", LAWS)
def test_the_first_order_of_each_law_near_an_elastic_contact(law):
    # 1 - e_eff = 2/3 d: right where d = 3/2 (1 - e); flores (8/5) and gonthier (2) give it up for small restitutions
    slope = (1.0 - ig.effective_restitution(law, 1.0 - 1e-6)) / 1e-6
    assert slope == pytest.approx({"flores": 16 / 15, "gonthier": 4 / 3}.get(law, 1.0), abs=1e-5)


def test_laws_written_for_nearly_elastic_contacts_cannot_deliver_a_small_restitution():
    # at e = 0 their damping is finite: 3/2, 3/4 and 3/2
    for law in ("hunt-crossley", "lankarani-nikravesh", "herbert-mcwhannell"):
        assert ig.effective_restitution(law, 1e-3) > 0.45
    for law in ("hu-guo", "gonthier", "flores"):
        assert ig.effective_restitution(law, 1e-3) < 2e-3


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("restitution", [0.05, 0.4, 0.9, 1.0])
def test_a_simulated_contact_delivers_the_closed_form(law, restitution):
    contact = ig.Contact(1e5, restitution, dissipation=law)
    outcome = ig.simulate(SCENE(contact), ig.Trapezoid(1.0, 8.0), duration=0.6, rtol=1e-11)
    expected = ig.effective_restitution(law, restitution)
    assert outcome.contacts[0].separation_velocity == pytest.approx(expected, rel=1e-10)


def SCENE(contact, tool_mass=0.125, coupling=ig.Rigid(), distance=0.2505):  # noqa: N802, B008 - reads as the scene of a contact
    return ig.Scene(ig.Tool(tool_mass), ig.Object(0.25, distance), contact, coupling)


def by_lambert(damping):
    return lambda e: float(lambert(damping(mpmath.mpf(e))))


GRID = {  # contact law: how the tool's restitution follows from the nominal one, by the closed form of its authors
    "Hooke": ({"dissipation": "exact", "stiffness_exponent": 1.0, "damping_exponent": 0.0}, float),
    "Hertz": ({"dissipation": "exact"}, float),
    "Flores": ({"dissipation": "flores"}, by_lambert(lambda e: 8 / mpmath.mpf(5) * (1 - e) / e)),
    "Hu-Guo": ({"dissipation": "hu-guo"}, by_lambert(lambda e: 3 / mpmath.mpf(2) * (1 - e) / e)),
}
RESTITUTION_GRID = pytest.mark.parametrize(("law", "restitution"), list(product(GRID, (0.25, 0.5, 0.75, 1.0))))
"""That of Project Chrono's test of the normal restitution, which asks for 1e-3."""


@RESTITUTION_GRID
@pytest.mark.parametrize("stiffness", [1e3, 1e6, 1e9])
def test_an_object_rebounds_from_a_wall_that_moves_with_the_restitution_of_each_law(law, restitution, stiffness):
    options, delivered = GRID[law]
    contact = ig.Contact(stiffness, restitution, **options)
    (hit,) = ig.simulate(SCENE(contact), ig.Trapezoid(1.0, 8.0), duration=1.0, rtol=1e-10).contacts
    assert hit.start == pytest.approx(0.2505 + 1 / 16, rel=1e-14)
    assert hit.separation_velocity == pytest.approx(delivered(restitution), rel=1e-9)
    assert hit.object_velocity == pytest.approx(1 + delivered(restitution), rel=1e-9)


@RESTITUTION_GRID
@pytest.mark.parametrize("tool_mass", [0.01, 0.125, 2.5])
def test_a_free_tool_and_its_object_part_with_the_restitution_of_each_law(law, restitution, tool_mass):
    """On a soft spring that is relaxed at the impact, half a period after the flange set out: it has not pushed yet.

    What it does meanwhile is of the order (omega t0)^2 < 1e-11 of what the contact does.
    """
    options, delivered = GRID[law]
    contact = ig.Contact(1e12 if law == "Hooke" else 1e14, restitution, **options)
    omega, speed, ramp = 0.5, 1.0, 1 / 8  # 1/s, m/s, s
    coupling, distance = ig.SpringDamper(tool_mass * omega**2, 0.0), math.pi * speed / omega
    scene, motion = SCENE(contact, tool_mass, coupling, distance), ig.Trapezoid(speed, speed / ramp)
    hit = ig.simulate(scene, motion, math.pi / omega + 0.1, rtol=1e-11).contacts[0]
    # y'' + omega^2 y = -a during the ramp: the tool swings about the flange from the middle of the ramp on
    assert hit.start == pytest.approx(math.pi / omega + ramp / 2, rel=1e-12)
    arrival = speed * (1 + math.sin(omega * ramp / 2) / (omega * ramp / 2))
    assert hit.approach_velocity == pytest.approx(arrival, rel=1e-12)
    e, share = delivered(restitution), tool_mass / (tool_mass + 0.25)
    assert hit.separation_velocity == pytest.approx(e * arrival, rel=1e-9)
    assert hit.object_velocity == pytest.approx(share * (1 + e) * arrival, rel=1e-9)  # momentum


@pytest.mark.parametrize(("m", "n"), [(1.0, 0.0), (1.0, 1.0), (2.0, 2.0), (1.5, 1.0), (1.2, 1.7), (1.5, 0.0)])
@pytest.mark.parametrize("restitution", [0.1, 0.6, 1.0])
def test_exact_delivers_the_restitution_whatever_the_exponents(m, n, restitution):
    contact = ig.Contact(1e5, restitution, "exact", stiffness_exponent=m, damping_exponent=n)
    outcome = ig.simulate(SCENE(contact), ig.Trapezoid(1.0, 8.0), duration=0.7, rtol=1e-10)
    assert outcome.contacts[0].separation_velocity == pytest.approx(restitution, rel=1e-9)


@pytest.mark.parametrize("zeta", [0.05, 0.4, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 1.5])
def test_the_linear_contact_leaves_when_its_force_would_pull(zeta):
    # x'' + 2 zeta x' + x = 0, x' = 1: the force 2 zeta x' + x ends at omega_d t = pi - 2 arcsin(zeta), with -x' = e
    with mpmath.workdps(50):
        z = mpmath.mpf(zeta)
        root = mpmath.sqrt(1 - z * z)  # imaginary above critical damping
        e = mpmath.exp(-2 * z * mpmath.acos(z) / root).real if zeta != 1.0 else mpmath.exp(-2)
    assert dissipation.delivered_linear(2.0 * zeta) == pytest.approx(float(e), rel=1e-9)
    if zeta == 0.4:
        wd = math.sqrt(1 - zeta**2)
        t = (math.pi - 2 * math.asin(zeta)) / wd
        x = math.exp(-zeta * t) * math.sin(wd * t) / wd
        v = math.exp(-zeta * t) * (math.cos(wd * t) - zeta / wd * math.sin(wd * t))
        assert x + 2 * zeta * v == pytest.approx(0.0, abs=1e-14)
        assert -v == pytest.approx(float(e), rel=1e-14)


def test_a_linear_contact_at_high_damping_loses_as_one_over_four_zeta_squared():
    assert dissipation.delivered_linear(2.0 * 1e3) == pytest.approx(1 / (4 * 1e6), rel=1e-5)


@pytest.mark.parametrize(("law", "restitution"), [("hertz", 0.5), ("exact", 0.0), ("exact", 1.5), ("exact", math.nan)])
def test_bad_arguments_are_named(law, restitution):
    with pytest.raises(ValueError, match="law" if law == "hertz" else "restitution"):
        ig.effective_restitution(law, restitution)


def test_the_shape_of_the_argument_is_kept():
    assert isinstance(ig.effective_restitution("hu-guo", 0.5), float)
    assert ig.effective_restitution("hu-guo", [[0.5, 0.6]]).shape == (1, 2)
