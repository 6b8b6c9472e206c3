"""The cases that are hard for contact solvers, by name, each with a law that it must obey (see also test_agreement)."""

import math
from dataclasses import replace

import numpy as np
import pytest
from reference_table import barely_parting, overdamped, table
from scipy.interpolate import CubicHermiteSpline
from solver_scenes import CRUISE, MOTION, SPRING, scene

import impact_gym as ig

STIFF = ig.SpringDamper(1e8)


@pytest.mark.parametrize("approach_velocity", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("coupling", [ig.Rigid(), SPRING], ids=["rigid", "spring"])
def test_slow_contact_under_a_push_becomes_a_steady_push(coupling, approach_velocity):
    # the flange starts right behind the object: chi is huge, rates of 1e6 to 1e9 1/s in plain variables
    acceleration = 8.0
    distance = approach_velocity**2 / (2 * acceleration)
    outcome = ig.simulate(
        scene(1e5, 0.5, coupling, distance=distance), ig.Trapezoid(0.5, acceleration), 0.06, trace=True
    )
    assert outcome.steps < 3000
    assert outcome.momentum_error < 1e-9
    trace = outcome.trace
    pushed = (trace.time > 0.03) & (trace.time < 0.055)  # the force is m_p a for any contact law
    if isinstance(coupling, ig.Rigid):
        assert outcome.contacts[0].end is None
        assert trace.contact_force[pushed] == pytest.approx(0.25 * acceleration, rel=0.02)
        assert outcome.object_velocity == pytest.approx(acceleration * 0.06, rel=0.01)


@pytest.mark.parametrize("restitution", [1e-2, 1e-4])
def test_contact_of_low_restitution_lasts_as_e_to_the_minus_06(restitution):
    values = (restitution, restitution / 2)
    first, second = (ig.simulate(scene(1e8, e), CRUISE, 3.0, rtol=1e-10).contacts[0] for e in values)
    assert first.separation_velocity == pytest.approx(ig.effective_restitution("hu-guo", restitution), rel=1e-6)
    # the surfaces separate at e v from a depth proportional to d^-0.4
    ratio = (second.end - second.start) / (first.end - first.start)
    assert ratio == pytest.approx(2**0.6, rel=0.02)


def test_bistable_tool_flips_only_within_the_error_it_is_allowed():
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


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
def test_contact_that_barely_parts_is_not_stepped_over(rtol):
    exact = [(len(run.outcome.contacts), run.outcome.object_velocity) for run in table()["barely parting"]]
    assert [contacts for contacts, _ in exact] == [3, 2]
    low, high = 13.8, 13.9
    while low < (middle := 0.5 * (low + high)) < high:
        outcome = ig.simulate(*barely_parting(middle), rtol=rtol)  # parting velocity down to 1e-9 m/s
        assert outcome.steps < 100_000  # a few hundred are needed
        assert all(contact.approach_velocity > 0 for contact in outcome.contacts)
        assert (len(outcome.contacts), pytest.approx(outcome.object_velocity, abs=1e-3)) in exact
        low, high = (middle, high) if len(outcome.contacts) == 3 else (low, middle)
    assert low == pytest.approx(13.860035, rel=1e-6)  # between the two runs of the table


def test_steps_in_a_stiff_contact_do_not_grow_with_its_stiffness():
    steps = [ig.simulate(overdamped(ratio), CRUISE, 0.6).steps for ratio in (30.0, 300.0, 3000.0)]
    assert max(steps) < min(1.5 * min(steps), 500)  # those of an explicit method would grow a hundredfold


@pytest.mark.parametrize(
    ("chain", "rigid", "steps"),
    [  # a flight alone has 1e9 half periods; only those within reach of the object are searched
        *((scene(coupling=ig.SpringDamper(1e18, ratio)), scene(), 1000) for ratio in (0.0, 0.01, 1.0, 3.0)),
        # a robot that oscillates at 5 MHz without an end
        (scene(coupling=STIFF, robot=ig.Robot(1.0, 1e15, 1e-3)), scene(coupling=STIFF), 100_000),
    ],
)
def test_part_that_oscillates_too_fast_acts_as_if_rigid(chain, rigid, steps):
    outcome = ig.simulate(chain, MOTION)
    assert outcome.object_velocity == pytest.approx(ig.simulate(rigid, MOTION).object_velocity, rel=1e-8)
    assert outcome.steps < steps
