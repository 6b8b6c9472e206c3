"""One contact against closed forms, golden tables of docs/provenance.md and its balances; what a damping delivers."""

from itertools import pairwise, product

import mpmath
import numpy as np
import pytest
from reference_table import GROUND, table
from scipy.interpolate import CubicHermiteSpline
from solver_scenes import BOTH, CRUISE, fast, scene, slow

import impact_gym as ig
from experiments.reference.laws import CLOSURES
from impact_gym.physics import dissipation

OBJECT_MASS, STIFFNESS = 0.25, 1e5  # kg, N/m^1.5
RTOL = 1e-12

# found by an independent solver at rtol 1e-11, not printed in the paper (docs/provenance.md)
SHAPES = {  # of an isolated contact, by its restitution: duration in t0, greatest penetration in delta0, peak in F0
    0.01: (29.2211138709, 0.192542571576, 4.4691365186),
    0.1: (7.50224023184, 0.466330490751, 1.8086263584),
    0.5: (3.62402223316, 0.840972185064, 1.0673964185),
    1.0: (3.21806545972, 1.09336207394, 1.1432626298),
}
PUSHED = {  # by restitution and a constant push, in v/t0: separation velocity in v, duration in t0
    (0.9, -0.05): (0.912051562, 3.177980), (0.9, 0.01): (0.897287332, 3.270730), (0.9, 0.05): (0.886187702, 3.330687),
    (0.9, 0.1): (0.870752491, 3.403510), (0.5, -0.05): (0.541405201, 3.447152), (0.5, 0.01): (0.476020690, 3.662501),
    (0.5, 0.05): (0.425046404, 3.830096), (0.5, 0.1): (0.349003659, 4.083670), (0.1, -0.05): (0.221300177, 4.361513),
    (0.1, 0.01): (0.048880263, 8.324390),
}  # fmt: skip
CRITICAL_PUSH = {0.9: 0.826855, 0.5: 0.201167, 0.1: 0.018308}  # by restitution; above it the contact never ends


def time_scale(stiffness=STIFFNESS, speed=1.0):
    return (OBJECT_MASS * speed**2 / stiffness) ** 0.4 / speed


def pushed(simulate, restitution, push):
    """A contact that begins at 1 m/s, under a constant acceleration of `push`, in v/t0."""
    t0 = time_scale()
    acceleration = abs(push) / t0
    if push > 0:
        motion, distance = ig.Trapezoid(50.0, acceleration), 0.5 / acceleration  # does not reach 50 m/s
        start = 1 / acceleration
    else:
        motion, distance = ig.Trapezoid(1.0, 8.0, ig.Brake(0.0, 0.0, acceleration)), 0.2
        start = 0.2 + 1 / 16
    contact = simulate(scene(STIFFNESS, restitution, distance=distance), motion, start + 40 * t0).contacts[0]
    assert contact.approach_velocity == pytest.approx(1.0, rel=1e-14)
    return contact


@BOTH
@pytest.mark.parametrize("restitution", SHAPES)
def test_isolated_contact_has_the_shape_of_the_golden_table(simulate, restitution):
    (contact,), t0 = simulate(scene(STIFFNESS, restitution), CRUISE, 1.5).contacts, time_scale()
    duration, depth, peak_force = SHAPES[restitution]
    assert contact.end - contact.start == pytest.approx(duration * t0, rel=1e-9)
    assert contact.peak_force == pytest.approx(peak_force * STIFFNESS * t0**1.5, rel=1e-9)
    if simulate is fast:
        trace = simulate(scene(STIFFNESS, restitution), CRUISE, 1.5, trace=True).trace
        assert np.diff(trace.time).min() > -1e-15
        assert trace.contact_force.max() == pytest.approx(contact.peak_force, rel=1e-4)
        inside = (trace.time >= contact.start) & (trace.time <= contact.end)
        time, first = np.unique(trace.time[inside], return_index=True)
        penetration, rate = trace.tool_position - trace.object_position, trace.tool_velocity - trace.object_velocity
        path = CubicHermiteSpline(time, penetration[inside][first], rate[inside][first])
        deepest = path(path.derivative().roots(extrapolate=False)).max()
        assert deepest == pytest.approx(depth * t0, rel=1e-9)


@BOTH
@pytest.mark.parametrize(("restitution", "push"), PUSHED)
def test_pushed_contact_is_that_of_the_golden_table(simulate, restitution, push):
    contact, (separation_velocity, duration) = pushed(simulate, restitution, push), PUSHED[restitution, push]
    assert contact.separation_velocity == pytest.approx(separation_velocity, abs=1e-9)
    assert (contact.end - contact.start) / time_scale() == pytest.approx(duration, abs=1e-6)


@BOTH
@pytest.mark.parametrize(("restitution", "critical"), CRITICAL_PUSH.items())
def test_pushed_contact_lasts_above_the_critical_push(simulate, restitution, critical):
    assert pushed(simulate, restitution, critical - 1e-6).end is not None
    for push in (critical + 1e-6, 1.1 * critical)[: 2 if simulate is fast else 1]:
        assert pushed(simulate, restitution, push).end is None


@pytest.mark.parametrize(
    "family", sorted({*table()} - {*GROUND, "rigid, robot table"})
)  # its mass depends on the place
def test_coupling_impulse_closes_the_budget_of_eq_22(family):
    for run in table()[family]:
        chain, ours = run.approach[0], ig.simulate(*run.approach, rtol=1e-9)
        moving, struck = chain.tool.mass, chain.object.mass
        if isinstance(chain.coupling, ig.Rigid) and chain.robot is not None:
            moving += chain.robot.mass
        for outcome, close in ((run.outcome, 1e-9), (ours, 1e-12)):
            # eq. 22 summed over the contacts, each with its effective restitution
            velocity = outcome.coupling_impulse / (moving + struck)
            for contact in outcome.contacts:
                parting = 0.0 if contact.end is None else contact.separation_velocity
                velocity += moving / (moving + struck) * (contact.approach_velocity + parting)
            finished = all(contact.end is not None for contact in outcome.contacts)
            assert not finished or outcome.object_velocity == pytest.approx(velocity, rel=close)
            impulse = sum(contact.impulse for contact in outcome.contacts)
            assert impulse == pytest.approx(struck * outcome.object_velocity, rel=1e-12)
            if outcome.contacts:
                assert outcome.contacts[-1].object_velocity == pytest.approx(outcome.object_velocity, rel=1e-12)
                assert outcome.peak_force == max(contact.peak_force for contact in outcome.contacts)


def test_object_meets_the_tool_again_as_fast_as_it_left():
    # a tool that accelerates at 20 m/s^2 behind an object: in its frame, a ball that falls on a plate
    contacts = ig.simulate(scene(1e10, 0.9, distance=0.01), ig.Trapezoid(50.0, 20.0), 1.0, RTOL).contacts
    assert len(contacts) > 30
    for before, after in pairwise(contacts):
        assert after.approach_velocity == pytest.approx(before.separation_velocity, rel=1e-9)
        assert after.start - before.end == pytest.approx(2 * before.separation_velocity / 20.0, abs=1e-12)


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


ALL = pytest.param([HOOKE, *HERTZ, *OTHER_POWERS, *MIXED], RESTITUTIONS_OF_CONTACTS, marks=pytest.mark.slow, id="all")


@pytest.mark.parametrize(("laws", "restitutions"), [([HOOKE, *HERTZ, MIXED[0]], (0.1, 0.5, 1.0)), ALL])
def test_reference_has_the_restitution_of_the_law(laws, restitutions):
    for law, restitution in product(laws, restitutions):
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
