"""Closed forms: one contact, what a damping delivers, Hertz's stiffness, the instantaneous impact, the mechanism."""

import math
import re

import mpmath
import numpy as np
import pytest
from scipy.integrate import quad
from solver_scenes import scene

import impact_gym as ig
from impact_gym.experiments.reference import laws
from impact_gym.physics import dissipation, impact
from impact_gym.physics.hertz import GENT, rubber
from impact_gym.task import ScenarioRanges

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


STEEL = (206e9, 0.3)


@pytest.mark.parametrize(("tool", "thing"), [(STEEL, (3e9, 0.4)), ((3e9, 0.4), STEEL), ((1e30, 0.3), (2e6, 0.5))])
def test_hertz_is_the_closed_form_for_a_sphere_on_a_plane(tool, thing):
    radius, force = 0.02, 50.0
    k = ig.hertz(radius, *tool, *thing)
    modulus = 1.0 / sum((1 - poisson**2) / young for young, poisson in (tool, thing))
    approach = (9.0 * force**2 / (16.0 * radius * modulus**2)) ** (1 / 3)  # Johnson, Contact Mechanics, eq. 4.23
    assert k * approach**1.5 == pytest.approx(force, rel=1e-12)


def test_materials_have_physical_numbers_and_a_source():
    for name, material in ig.MATERIALS.items():
        assert re.search(r"\bread\b|not checked here", material.source), name
        assert 0 < material.young[0] <= material.young[1] < 1e12, name
        assert 0 <= material.poisson[0] <= material.poisson[1] <= 0.5, name
        digits = 17 if GENT in material.source else 2  # what sources print of a modulus
        assert [float(f"{young:.{digits}g}") for young in material.young] == list(material.young), name
        least, most = material.restitution or (0, 1)
        assert 0 <= least <= most <= 1, name


@pytest.mark.parametrize("shore", [20.0, 40.0, 60.0, 80.0])
def test_modulus_of_rubber_is_that_of_a_flat_durometer(shore):
    # ASTM D2240, type A: the indenter is a cone from 1.27 to 0.79 mm; 0.55 to 8.05 N; 2.54 mm deep at hardness 0
    radius, force, depth = (0.79e-3 + 1.27e-3) / 4, 0.55 + 0.075 * shore, 2.54e-3 * (1 - shore / 100)
    young = (1 - 0.5**2) * force / (2 * radius * depth)  # Johnson, Contact Mechanics, eq. 3.36, incompressible
    low, high = rubber(shore).young
    assert math.sqrt(low * high) == pytest.approx(young, rel=0.01)
    assert high / low == pytest.approx(1.2**2)
    if shore in (40.0, 60.0):
        assert math.sqrt(low * high) == pytest.approx({40.0: 1.7e6, 60.0: 3.6e6}[shore], rel=0.02)  # of Gent's table


def test_material_ranges_contain_a_pair_and_are_of_a_scenario():
    ranges = ig.material_ranges((0.01, 0.03), "rubber, Shore A 50", "steel")
    low, high = ranges["contact_stiffness"]
    assert low < ig.hertz(0.02, 2.5e6, 0.48, 200e9, 0.29) < high
    assert "restitution" not in ranges
    assert ig.material_ranges(0.01, "glass", "glass")["restitution"] == [0.96, 0.98]
    assert ScenarioRanges.of(ranges).contact_stiffness == (low, high)


@pytest.mark.parametrize("pushed", [False, True])
def test_free_tool_obeys_push_and_restitution(pushed):
    random = np.random.default_rng(1)
    (m_t, m_p), (v_t, v_p) = random.uniform(0.01, 5.0, (2, 200)), random.uniform(-2.0, 2.0, (2, 200))
    e, push = random.uniform(0.0, 1.0, 200), random.uniform(-1.0, 1.0, 200) * pushed
    after_t, after_p = impact.free_tool(m_t, m_p, v_t, v_p, e, *([push] if pushed else []))
    assert m_t * after_t + m_p * after_p == pytest.approx(m_t * v_t + m_p * v_p + push, rel=1e-12, abs=1e-12)
    assert after_p - after_t == pytest.approx(e * (v_t - v_p), abs=1e-12)
    rigid = impact.rigid_tool(v_t, v_p, e)
    assert rigid - v_t == pytest.approx(e * (v_t - v_p), abs=1e-12)
    assert impact.free_tool(1e12, m_p, v_t, v_p, e)[1] == pytest.approx(rigid, abs=1e-10)


def test_sliding_distance_is_that_of_constant_friction():
    assert impact.sliding_distance([1.0, 0.0, 2.0], [0.0, 0.0, 0.5]) == pytest.approx([math.inf, 0.0, 4 / 9.80665])


def test_force_has_the_numbers_of_fig_22():
    mechanism = ig.Bistable()
    force, x = mechanism.force, np.linspace(0.0, 0.07, 100_001)
    barrier = quad(force, 0.0, mechanism.stroke)[0]
    assert force(x).max() == pytest.approx(1.0817, abs=5e-5)
    assert x[force(x).argmax()] == pytest.approx(25.69e-3, abs=5e-6)
    assert x[1:][force(x[1:]) > 0].max() == pytest.approx(64.156e-3, abs=1e-6)
    assert barrier == pytest.approx(44.1e-3, abs=5e-6)
    assert mechanism.energy([0.0, 0.01]) == pytest.approx([barrier, barrier - quad(force, 0.0, 0.01)[0]], rel=1e-9)
    assert mechanism.stroke == pytest.approx(64.156e-3, abs=5e-7)
    assert force(mechanism.stroke * np.array([-1.0, 0.0, 1.0])) == pytest.approx([0.0] * 3, abs=1e-14)


@pytest.mark.parametrize("zeta", [0.0, 0.1, 0.3, 0.5, 1.0, 2.0, 4.0])
def test_stop_returns_what_a_damper_that_never_pulls_returns(zeta):
    # exp(-2 zeta arccos(zeta) / sqrt(1 - zeta^2)), so exp(-2) = 0.1353 at zeta = 1: not 'completely inelastic'.
    # The spring is so weak that the tool stands still until the rear stop hits it at the flange's speed, 1 m/s.
    weak = ig.Bistable(stiffness=1e-9, front_stop=5e-3, rear_stop=-5e-3, stop_damping_ratio=zeta)
    outcome = ig.simulate(scene(coupling=weak, distance=50.0), ig.Trapezoid(1.0, 1e3), 0.017, 1e-12)
    assert outcome.tool_velocity - 1 == pytest.approx(ig.physics.dissipation.delivered_linear(2 * zeta), rel=1e-7)
    assert len(outcome.snap_through) == 1
