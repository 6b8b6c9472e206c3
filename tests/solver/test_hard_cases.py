"""The cases that are hard for contact solvers, by name, each with a law that it must obey (see also test_contact)."""

import dataclasses
import math

import numpy as np
import pytest
from scenes import CRUISE, MOTION, scene
from scipy.interpolate import CubicHermiteSpline

import impact_gym as ig
from experiments import reference

STIFF = ig.SpringDamper(1e8)
CLAMPED = scene(1e5, 0.5, ig.SpringDamper(150.0), distance=0.25)


@pytest.mark.parametrize("approach_velocity", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("coupling", [ig.Rigid(), ig.SpringDamper(150.0)], ids=["rigid", "spring"])
def test_slow_contact_under_a_push_ends_up_as_a_steady_push(coupling, approach_velocity):
    # the flange sets out right behind the object: chi is huge, rates of 1e6 to 1e9 1/s in plain variables
    acceleration = 8.0
    distance = approach_velocity**2 / (2 * acceleration)
    pushed_off = scene(1e5, 0.5, coupling, distance=distance)
    outcome = ig.simulate(pushed_off, ig.Trapezoid(0.5, acceleration), 0.06, trace=True)
    assert outcome.steps < 3000
    assert outcome.momentum_error < 1e-9
    trace = outcome.trace
    pushed = (trace.time > 0.03) & (trace.time < 0.055)  # carried along: m_p a, whatever the contact is like
    if isinstance(coupling, ig.Rigid):
        assert outcome.contacts[0].end is None
        assert trace.contact_force[pushed] == pytest.approx(0.25 * acceleration, rel=0.02)
        assert outcome.object_velocity == pytest.approx(acceleration * 0.06, rel=0.01)
    energy = 0.5 * 0.25 * outcome.object_velocity**2
    assert energy <= outcome.object_velocity * sum(contact.impulse for contact in outcome.contacts)


@pytest.mark.parametrize("restitution", [1e-2, 1e-3, 1e-4])
def test_restitution_close_to_zero_is_delivered_and_lasts(restitution):
    values = (restitution, restitution / 2)
    first, second = (ig.simulate(scene(1e8, e), CRUISE, 3.0, rtol=1e-10).contacts[0] for e in values)
    assert first.separation_velocity == pytest.approx(ig.effective_restitution("hu-guo", restitution), rel=1e-6)
    # duration grows as e^-0.6: the surfaces creep apart at e v over a depth that goes with d^-0.4
    ratio = (second.end - second.start) / (first.end - first.start)
    assert ratio == pytest.approx(2**0.6, rel=0.02)


def test_chatter_is_finite_and_every_bounce_obeys_the_restitution():
    bouncing = scene(1e10, 0.7, ig.SpringDamper(150.0))
    outcome = ig.simulate(bouncing, CRUISE, 0.6, rtol=1e-10)
    slow = reference.simulate(bouncing, CRUISE, 0.6, rtol=1e-11)
    assert len(outcome.contacts) == len(slow.contacts) > 10
    assert outcome.steps < 3000
    speeds = np.array([contact.approach_velocity for contact in outcome.contacts])
    parted = np.array([contact.separation_velocity for contact in outcome.contacts])
    nominal = ig.effective_restitution("hu-guo", 0.7)
    assert np.all(parted[:-1] <= nominal * speeds[:-1] * (1 + 1e-9))  # the spring pushes, which takes some away
    assert parted[:2] == pytest.approx(nominal * speeds[:2], rel=0.01)
    assert outcome.object_velocity == pytest.approx(slow.object_velocity, rel=1e-8)


@pytest.mark.parametrize(("k_c", "zeta"), [(1e3, 0.0), (3e4, 1.0), (1e3, 3.0)])
def test_contact_and_stop_at_once(k_c, zeta):
    # the slider reaches its rear stop while the tool is still on a heavy object: both laws act on one mass
    mechanism = ig.Bistable(rear_stop=-0.002, front_stop=0.004, stop_damping_ratio=zeta, stop_stiffness=1e6)
    both = scene(k_c, 0.1, mechanism, m_p=5.0)
    fast = ig.simulate(both, MOTION, 0.8, rtol=1e-11, trace=True)
    slow = reference.simulate(both, MOTION, 0.8, rtol=1e-11)
    trace = fast.trace
    x = trace.tool_position - trace.flange_position + mechanism.front_stop
    assert np.any((trace.contact_force > 0.0) & (x < mechanism.rear_stop))
    assert len(fast.contacts) == len(slow.contacts)
    assert fast.object_velocity == pytest.approx(slow.object_velocity, rel=1e-7)
    assert fast.momentum_error < 1e-9


def test_bistable_tool_near_its_threshold_flips_only_within_the_error_it_is_allowed():
    # bisect the speed at which it first passes the alignment, at a tight tolerance; then a loose one must agree
    # outside a band that the growth exp(24.5 t) of errors near the alignment explains

    def snaps(speed, rtol):
        motion = dataclasses.replace(MOTION, speed=speed)
        return len(ig.simulate(scene(1e3, 0.1, ig.Bistable()), motion, 1.5, rtol).snap_through)

    low, high = 0.6, 1.0
    assert (snaps(low, 1e-12), snaps(high, 1e-12)) == (0, 1)
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if snaps(middle, 1e-12) == 0 else (low, middle)
    assert 0.8 < low < 0.95
    for rtol, band in {1e-4: 1e-3, 1e-6: 1e-5, 1e-8: 1e-7}.items():
        assert snaps(low - band, rtol) == 0
        assert snaps(low + band, rtol) > 0


@pytest.mark.parametrize("margin", [1e-4, 1e-7, -1e-7, -1e-4])
def test_graze_in_an_integrated_flight_is_told_from_a_near_miss(margin):
    # a compliant robot swings the tool: the object stands at the first local maximum of the tool's path, or just beyond
    robot, coupling, motion = ig.Robot(2.0, 2000.0, 0.0), ig.SpringDamper(60.0, 0.0), ig.Trapezoid(0.3, 40.0)
    trace = ig.simulate(scene(1e5, 1.0, coupling, robot, distance=10.0), motion, 1.0, 1e-12, trace=True).trace
    at, *_ = np.flatnonzero((trace.tool_velocity[:-1] > 0) & (trace.tool_velocity[1:] <= 0))
    time, position, velocity = np.array([trace.time, trace.tool_position, trace.tool_velocity])[:, at : at + 2]
    path = CubicHermiteSpline(time, position, velocity)
    (when,), bend = path.derivative().roots(extrapolate=False), -(np.diff(velocity) / np.diff(time))[0]
    near = scene(1e5, 1.0, coupling, robot, distance=path(when) - margin)
    contacts = ig.simulate(near, motion, when + 0.01, 1e-12).contacts
    assert len(contacts) == (1 if margin > 0 else 0)
    if margin > 0:
        # it arrives before its summit by the time a parabola of this depth takes
        early = math.sqrt(2 * margin / bend)
        assert contacts[0].start == pytest.approx(when - early, abs=0.02 * math.sqrt(margin))


@pytest.mark.parametrize("push", [-1.0, -2.0, -3.0])
def test_force_clamped_at_zero_costs_no_accuracy(push):
    t0 = (0.25 / 1e5) ** 0.4
    for delay in np.linspace(0.0, 0.6, 13):
        brake = ig.Brake(threshold=0.0, delay=delay * t0, deceleration=-push / t0)
        case = scene(1e5, 0.2, distance=0.1), ig.Trapezoid(1.0, 8.0, brake), 0.1 + 1 / 16 + 30 * t0
        exact = reference.simulate(*case, rtol=1e-11)
        for rtol in np.geomspace(1e-3, 1e-8, 41):
            outcome = ig.simulate(*case, rtol)
            assert outcome.object_velocity == pytest.approx(exact.object_velocity, rel=rtol), (delay, rtol)


def barely_parting(coupling_stiffness):
    """Between two springs the second contact no longer parts, so that no third follows."""
    return scene(1e6, 0.3, ig.SpringDamper(float(coupling_stiffness))), MOTION, 1.5


BARELY = {13.86003: (3, 0.6183), 13.86004: (2, 0.6210)}
"""Number of contacts and V_p (m/s) by stiffness of the spring (N/m), by the independent solver."""


@pytest.mark.parametrize("rtol", [1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12])
def test_contact_that_barely_parts_is_not_stepped_over(rtol):
    for stiffness, (contacts, velocity) in BARELY.items() if rtol == 1e-8 else ():
        exact = reference.simulate(*barely_parting(stiffness), rtol=1e-11)
        assert (len(exact.contacts), exact.object_velocity) == (contacts, pytest.approx(velocity, abs=5e-5))
    low, high = 13.8, 13.9
    while low < (middle := 0.5 * (low + high)) < high:
        outcome = ig.simulate(*barely_parting(middle), rtol=rtol)  # parting velocity down to 1e-9 m/s
        assert outcome.steps < 100_000  # a few hundred are needed
        assert all(contact.approach_velocity > 0 for contact in outcome.contacts)
        assert (len(outcome.contacts), pytest.approx(outcome.object_velocity, abs=1e-3)) in BARELY.values()
        low, high = (middle, high) if len(outcome.contacts) == 3 else (low, middle)
    assert low == pytest.approx(np.mean([*BARELY]), rel=1e-6)


def overdamped(ratio, stiffness=1e5):
    """A light tool on a stiff overdamped spring against a soft, heavy object: the coupling's decay is the fast part."""
    return scene(1e2, 0.5, ig.SpringDamper(stiffness, ratio), m_t=0.01, m_p=2.5, distance=0.1)


def test_stiff_contact_costs_no_more_steps_the_stiffer_it_is_and_is_that_of_an_implicit_method():
    steps = [ig.simulate(overdamped(ratio), CRUISE, 0.6).steps for ratio in (30.0, 300.0, 3000.0)]
    assert max(steps) < 1.5 * min(steps)  # an explicit method's would grow a hundredfold
    assert max(steps) < 500
    outcome = ig.simulate(overdamped(30.0, 1e4), CRUISE, 0.3, rtol=1e-9)
    implicit = reference.simulate(overdamped(30.0, 1e4), CRUISE, 0.3, rtol=1e-10, method="Radau")
    assert len(outcome.contacts) == len(implicit.contacts) == 1
    assert outcome.object_velocity == pytest.approx(implicit.object_velocity, rel=1e-6)


@pytest.mark.parametrize(
    ("chain", "rigid", "steps"),
    [  # a flight alone has 1e9 half periods; only those within reach of the object are looked at
        *((scene(coupling=ig.SpringDamper(1e18, ratio)), scene(), 1000) for ratio in (0.0, 0.01, 1.0, 3.0)),
        # a robot that rings at 5 MHz, for ever
        (scene(coupling=STIFF, robot=ig.Robot(1.0, 1e15, 1e-3)), scene(coupling=STIFF), 100_000),
    ],
)
def test_swing_too_fast_to_follow_is_passed_over_and_ends_as_if_it_were_rigid(chain, rigid, steps):
    outcome = ig.simulate(chain, MOTION)
    assert outcome.object_velocity == pytest.approx(ig.simulate(rigid, MOTION).object_velocity, rel=1e-8)
    assert outcome.steps < steps


@pytest.mark.parametrize("exponent", [1.501, 1.51, 1.53, 1.54])
def test_force_that_ends_just_before_the_surfaces_part_ends_the_run_too(exponent):
    """At a millionth of the depth the grip, u^(m - n) + d w, still falls steeply: which is first, is hard to tell."""
    contact = dataclasses.replace(CLAMPED.contact, stiffness_exponent=exponent)
    case = dataclasses.replace(CLAMPED, contact=contact), CRUISE, 1.5
    slow = reference.simulate(*case, rtol=1e-11)
    assert ig.simulate(*case).object_velocity == pytest.approx(slow.object_velocity, rel=1e-8)
