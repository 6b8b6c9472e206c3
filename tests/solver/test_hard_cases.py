"""The cases that are hard for contact solvers, by name, each with a law that it must obey (see also test_contact)."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from solver_scenes import CRUISE, MOTION, scene

import impact_gym as ig
from experiments import reference

STIFF = ig.SpringDamper(1e8)


@pytest.mark.parametrize("approach_velocity", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("coupling", [ig.Rigid(), ig.SpringDamper(150.0)], ids=["rigid", "spring"])
def test_slow_contact_under_a_push_becomes_a_steady_push(coupling, approach_velocity):
    # the flange starts right behind the object: chi is huge, rates of 1e6 to 1e9 1/s in plain variables
    acceleration = 8.0
    distance = approach_velocity**2 / (2 * acceleration)
    chain = scene(1e5, 0.5, coupling, distance=distance)
    outcome = ig.simulate(chain, ig.Trapezoid(0.5, acceleration), 0.06, trace=True)
    assert outcome.steps < 3000
    assert outcome.momentum_error < 1e-9
    trace = outcome.trace
    pushed = (trace.time > 0.03) & (trace.time < 0.055)  # the force is m_p a for any contact law
    if isinstance(coupling, ig.Rigid):
        assert outcome.contacts[0].end is None
        assert trace.contact_force[pushed] == pytest.approx(0.25 * acceleration, rel=0.02)
        assert outcome.object_velocity == pytest.approx(acceleration * 0.06, rel=0.01)


@pytest.mark.parametrize("restitution", [1e-2, 1e-3, 1e-4])
def test_contact_of_a_restitution_near_0_delivers_it_and_lasts_as_e_to_the_minus_six_tenths(restitution):
    values = (restitution, restitution / 2)
    first, second = (ig.simulate(scene(1e8, e), CRUISE, 3.0, rtol=1e-10).contacts[0] for e in values)
    assert first.separation_velocity == pytest.approx(ig.effective_restitution("hu-guo", restitution), rel=1e-6)
    # the surfaces separate at e v from a depth proportional to d^-0.4
    ratio = (second.end - second.start) / (first.end - first.start)
    assert ratio == pytest.approx(2**0.6, rel=0.02)


def test_chatter_is_finite_and_every_bounce_obeys_the_restitution():
    bouncing = scene(1e10, 0.7, ig.SpringDamper(150.0))
    outcome = ig.simulate(bouncing, CRUISE, 0.6, rtol=1e-10)
    slow = reference.simulate(bouncing, CRUISE, 0.6, rtol=1e-11)
    assert len(outcome.contacts) == len(slow.contacts) > 10
    assert outcome.steps < 3000
    velocities = [(contact.approach_velocity, contact.separation_velocity) for contact in outcome.contacts]
    before, after = np.array(velocities).T
    nominal = ig.effective_restitution("hu-guo", 0.7)
    assert np.all(after[:-1] <= nominal * before[:-1] * (1 + 1e-9))  # the push of the spring reduces it
    assert after[:2] == pytest.approx(nominal * before[:2], rel=0.01)
    assert outcome.object_velocity == pytest.approx(slow.object_velocity, rel=1e-8)


@pytest.mark.parametrize(("k_c", "zeta"), [(1e3, 0.0), (3e4, 1.0), (1e3, 3.0)])
def test_contact_and_stop_may_act_on_the_tool_at_once(k_c, zeta):
    # the slider reaches its rear stop while the tool still pushes a heavy object
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
    # Bisect the speed from which on it passes the alignment, at a tight tolerance. Then a loose tolerance must agree
    # outside a band that follows from the growth exp(24.5 t) of errors near the alignment.

    def snaps(speed, rtol):
        return len(ig.simulate(scene(1e3, 0.1, ig.Bistable()), replace(MOTION, speed=speed), 1.5, rtol).snap_through)

    low, high = 0.3, 1.2
    assert (snaps(low, 1e-12), snaps(0.6, 1e-12), snaps(high, 1e-12)) == (0, 0, 1)
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if snaps(middle, 1e-12) == 0 else (low, middle)
    assert 0.8 < low < 0.95
    for rtol, band in {1e-4: 1e-3, 1e-6: 1e-5, 1e-8: 1e-7}.items():
        assert snaps(low - band, rtol) == 0
        assert snaps(low + band, rtol) > 0


@pytest.mark.parametrize("margin", [1e-4, 1e-7, -1e-7, -1e-4])
def test_graze_in_an_integrated_flight_is_told_from_a_near_miss(margin):
    # a compliant robot makes the tool oscillate; the object stands `margin` before the first maximum of its path
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
        early = math.sqrt(2 * margin / bend)  # of a parabola
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
    """Between two stiffnesses of the spring the second contact stops parting, so that there is no third."""
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
    """A light tool on a stiff overdamped spring against a soft, heavy object: the coupling decays fastest."""
    return scene(1e2, 0.5, ig.SpringDamper(stiffness, ratio), m_t=0.01, m_p=2.5, distance=0.1)


def test_steps_in_a_stiff_contact_do_not_grow_with_its_stiffness_and_its_result_is_that_of_an_implicit_method():
    steps = [ig.simulate(overdamped(ratio), CRUISE, 0.6).steps for ratio in (30.0, 300.0, 3000.0)]
    assert max(steps) < min(1.5 * min(steps), 500)  # those of an explicit method would grow a hundredfold
    outcome = ig.simulate(overdamped(30.0, 1e4), CRUISE, 0.3, rtol=1e-9)
    implicit = reference.simulate(overdamped(30.0, 1e4), CRUISE, 0.3, rtol=1e-10, method="Radau")
    assert len(outcome.contacts) == len(implicit.contacts) == 1
    assert outcome.object_velocity == pytest.approx(implicit.object_velocity, rel=1e-6)


@pytest.mark.parametrize(
    ("chain", "rigid", "steps"),
    [  # a flight alone has 1e9 half periods; only those within reach of the object are searched
        *((scene(coupling=ig.SpringDamper(1e18, ratio)), scene(), 1000) for ratio in (0.0, 0.01, 1.0, 3.0)),
        # a robot that oscillates at 5 MHz without an end
        (scene(coupling=STIFF, robot=ig.Robot(1.0, 1e15, 1e-3)), scene(coupling=STIFF), 100_000),
    ],
)
def test_oscillation_too_fast_to_follow_gives_the_result_of_a_rigid_part(chain, rigid, steps):
    outcome = ig.simulate(chain, MOTION)
    assert outcome.object_velocity == pytest.approx(ig.simulate(rigid, MOTION).object_velocity, rel=1e-8)
    assert outcome.steps < steps


@pytest.mark.parametrize("exponent", [1.501, 1.51, 1.53, 1.54])
def test_force_that_ends_just_before_the_surfaces_part_ends_the_run_too(exponent):
    # at a millionth of the depth u^(m - n) + d w still falls steeply, so it is hard to tell which comes first
    clamped = scene(1e5, 0.5, ig.SpringDamper(150.0), distance=0.25, stiffness_exponent=exponent)
    slow = reference.simulate(clamped, CRUISE, 1.5, rtol=1e-11)
    assert ig.simulate(clamped, CRUISE, 1.5).object_velocity == pytest.approx(slow.object_velocity, rel=1e-8)
