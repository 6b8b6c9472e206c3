"""One contact against closed forms, golden tables and its balances; what a damping delivers."""

import mpmath
import numpy as np
import pytest
from reference_table import GROUND, table
from scipy.interpolate import CubicHermiteSpline
from solver_scenes import CRUISE, fast, scene, slow

import impact_gym as ig
from experiments.reference.laws import CLOSURES
from impact_gym.physics import dissipation

STIFFNESS, T0 = 1e5, (0.25 / 1e5) ** 0.4  # N/m^1.5; s, with an object of 0.25 kg at 1 m/s
# found by an independent solver at rtol 1e-11, not printed in the paper
SHAPES = {  # of an isolated contact, by its restitution: duration in t0, greatest penetration in delta0, peak in F0
    0.01: (29.2211138709, 0.192542571576, 4.4691365186),
    0.1: (7.50224023184, 0.466330490751, 1.8086263584),
    0.5: (3.62402223316, 0.840972185064, 1.0673964185),
    1.0: (3.21806545972, 1.09336207394, 1.1432626298),
}
CRITICAL_PUSH = {0.9: 0.826855, 0.5: 0.201167, 0.1: 0.018308}  # by restitution; above it the contact never ends


@pytest.mark.parametrize("restitution", SHAPES)
def test_isolated_contact_has_the_shape_of_the_golden_table(restitution):
    outcome = fast(scene(STIFFNESS, restitution), CRUISE, 1.5, trace=True)
    (contact,), trace, (duration, depth, peak_force) = outcome.contacts, outcome.trace, SHAPES[restitution]
    assert contact.end - contact.start == pytest.approx(duration * T0, rel=1e-9)
    assert contact.peak_force == pytest.approx(peak_force * STIFFNESS * T0**1.5, rel=1e-9)
    inside = (trace.time >= contact.start) & (trace.time <= contact.end)
    time, first = np.unique(trace.time[inside], return_index=True)
    penetration, rate = trace.tool_position - trace.object_position, trace.tool_velocity - trace.object_velocity
    path = CubicHermiteSpline(time, penetration[inside][first], rate[inside][first])
    assert path(path.derivative().roots(extrapolate=False)).max() == pytest.approx(depth * T0, rel=1e-9)


@pytest.mark.parametrize(("restitution", "critical"), CRITICAL_PUSH.items())
def test_pushed_contact_lasts_above_the_critical_push(restitution, critical):
    for push in (critical - 1e-6, critical + 1e-6, 1.1 * critical):  # a constant acceleration, in v/t0
        acceleration = push / T0
        met, motion = scene(STIFFNESS, restitution, distance=0.5 / acceleration), ig.Trapezoid(50.0, acceleration)
        contact = fast(met, motion, 1 / acceleration + 40 * T0).contacts[0]  # does not reach 50 m/s
        assert contact.approach_velocity == pytest.approx(1.0, rel=1e-14)
        assert (contact.end is None) == (push > critical)


FIXED_MASS = sorted({*table()} - {*GROUND, "rigid, robot table"})  # the mass of a robot table depends on the place


@pytest.mark.parametrize("family", FIXED_MASS)
def test_coupling_impulse_closes_the_budget_of_eq_22(family):
    for run in table()[family]:
        chain, outcome = run.approach[0], ig.simulate(*run.approach, rtol=1e-9)
        moving, struck = chain.tool.mass, chain.object.mass
        if isinstance(chain.coupling, ig.Rigid) and chain.robot is not None:
            moving += chain.robot.mass
        # eq. 22 summed over the contacts, each with its effective restitution
        velocity = outcome.coupling_impulse / (moving + struck)
        for contact in outcome.contacts:
            parting = 0.0 if contact.end is None else contact.separation_velocity
            velocity += moving / (moving + struck) * (contact.approach_velocity + parting)
        if all(contact.end is not None for contact in outcome.contacts):
            assert outcome.object_velocity == pytest.approx(velocity, rel=1e-12)
        impulse = sum(contact.impulse for contact in outcome.contacts)
        assert impulse == pytest.approx(struck * outcome.object_velocity, rel=1e-12)
        if outcome.contacts:
            assert outcome.contacts[-1].object_velocity == pytest.approx(outcome.object_velocity, rel=1e-12)
            assert outcome.peak_force == max(contact.peak_force for contact in outcome.contacts)


RESTITUTIONS = np.unique(np.concatenate([np.geomspace(1e-3, 1.0, 80), 1.0 - np.geomspace(1e-15, 0.5, 60)]))


def lambert(damping):
    """The effective restitution by its closed form, 60 digits."""
    with mpmath.workdps(60):
        d = mpmath.mpf(damping)
        return (1 + mpmath.lambertw(-(1 + d) * mpmath.exp(-(1 + d))).real) / d if d else mpmath.mpf(1)


def test_delivered_is_the_closed_form_to_fourteen_digits():
    for damping in np.concatenate([np.geomspace(1e-12, 1500.0, 200), [0.0, 0.2999999, 0.3, 0.3000001]]):
        assert float(abs(dissipation.delivered(damping) / lambert(damping) - 1)) < 2e-15


@pytest.mark.parametrize("law", ["exact", *CLOSURES])
def test_effective_restitution_of_each_law_is_right_to_1e_14(law):
    effective = ig.effective_restitution(law, RESTITUTIONS[:, None])
    assert effective.shape == (len(RESTITUTIONS), 1)
    assert isinstance(ig.effective_restitution(law, 0.5), float)
    for nominal, value in zip(RESTITUTIONS.tolist(), effective[:, 0].tolist(), strict=True):
        expected = nominal if law == "exact" else lambert(CLOSURES[law](nominal))
        assert float(abs(mpmath.mpf(value) - expected)) < 1e-14 * float(expected)
        delivered = lambert(dissipation.damping_factor(law, nominal))
        assert float(abs(delivered - expected)) < 1e-13 * float(expected)


HOOKE = {"dissipation": "exact", "stiffness_exponent": 1.0, "damping_exponent": 0.0}
HERTZ = [{"dissipation": law} for law in ("exact", *CLOSURES)]
OTHER_POWERS = [law | {"stiffness_exponent": m, "damping_exponent": m} for law in HERTZ for m in (1.0, 3.0)]
MIXED = [HOOKE | {"stiffness_exponent": m, "damping_exponent": n}
         for m, n in ((1.5, 1.0), (1.2, 1.7), (1.5, 0.0), (1.5, 2.0), (2.0, 1.5), (2.0, 2.0))]  # fmt: skip
RESTITUTIONS_OF_CONTACTS = 0.01, 0.02, 0.05, 0.1, 0.25, 0.4, 0.5, 0.75, 0.9, 1.0
"""They include those of Project Chrono's test of the normal restitution, which requires 1e-3."""


def rebound(simulate, law, restitution, stiffness=1e5, mass=0.25, speed=1.0):
    """Let a moving wall meet an object; return the contact after checks that need no law."""
    t0 = (mass * speed**2 / stiffness) ** (1 / (law.get("stiffness_exponent", 1.5) + 1)) / speed
    wall = scene(stiffness, restitution, m_p=mass, distance=0.2505 * speed, **law)
    (hit,) = simulate(wall, ig.Trapezoid(speed, 8.0 * speed), 0.32 + 1000 * t0).contacts
    delivered = ig.effective_restitution(law["dissipation"], restitution)
    assert hit.start == pytest.approx(0.2505 + 1 / 16, rel=1e-14)
    assert hit.approach_velocity == pytest.approx(speed, rel=1e-12)
    assert hit.separation_velocity / speed == pytest.approx(delivered, rel=1e-10 if simulate is fast else 1e-9)
    assert hit.object_velocity / speed == pytest.approx(1 + delivered, rel=1e-9)
    return hit


@pytest.mark.parametrize("law", [HOOKE, *HERTZ, *OTHER_POWERS, *MIXED], ids=str)
def test_restitution_is_that_of_the_law_whatever_the_scales(law):
    random = np.random.default_rng(1)
    for restitution in RESTITUTIONS_OF_CONTACTS:
        scales = 10 ** random.uniform([2, -3.6, -2], [10, 2.4, 1.5], (5, 3))
        for numbers in [(), *scales.tolist()]:
            rebound(fast, law, restitution, *numbers)


@pytest.mark.parametrize("law", [HOOKE, *HERTZ, MIXED[0]], ids=str)
def test_independent_solver_has_the_restitution_of_the_law(law):
    for restitution in (0.1, 0.5, 1.0):
        rebound(slow, law, restitution)


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
    assert SHARES.keys() - {"exact"} == dissipation.PUBLISHED.keys() == CLOSURES.keys()
    for law, share in SHARES.items():  # where d is small, e_eff = 1 - 2/3 d
        lost = 1.0 - ig.effective_restitution(law, 1.0 - 1e-7)
        assert lost / 1e-7 == pytest.approx(share, rel=1e-6), law
