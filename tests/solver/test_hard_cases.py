"""Scenes that are hard for contact solvers, and friction, each with a law that it must obey (see test_agreement)."""

import math

import numpy as np
import pytest
from reference_table import barely_parting, overdamped, table
from scipy.interpolate import CubicHermiteSpline
from solver_scenes import CRUISE, MOTION, SPRING, scene

import impact_gym as ig
from impact_gym.physics.impact import GRAVITY, sliding_distance

STIFF = ig.SpringDamper(1e8)


@pytest.mark.parametrize("approach_velocity", [1e-3, 1e-6, 1e-9])
def test_slow_contact_under_a_push_becomes_a_steady_push(approach_velocity):
    # the flange starts right behind the object: chi is huge, rates of 1e6 to 1e9 1/s in plain variables
    acceleration = 8.0
    near = scene(1e5, 0.5, distance=approach_velocity**2 / (2 * acceleration))
    outcome = ig.simulate(near, ig.Trapezoid(0.5, acceleration), 0.06, trace=True)
    assert outcome.steps < 3000
    assert outcome.momentum_error < 1e-9
    assert outcome.contacts[0].end is None
    force = outcome.trace.contact_force[(outcome.trace.time > 0.03) & (outcome.trace.time < 0.055)]
    assert force == pytest.approx(0.25 * acceleration, rel=0.02)  # m_p a for any contact law
    assert outcome.object_velocity == pytest.approx(acceleration * 0.06, rel=0.01)


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


@pytest.mark.parametrize(("chain", "rigid", "steps"), [
    # a flight alone has 1e9 half periods; only those within reach of the object are searched
    *((scene(coupling=ig.SpringDamper(1e18, ratio)), scene(), 1000) for ratio in (0.0, 0.01, 1.0, 3.0)),
    # a robot that oscillates at 5 MHz without an end
    (scene(coupling=STIFF, robot=ig.Robot(1.0, 1e15, 1e-3)), scene(coupling=STIFF), 100_000),
])  # fmt: skip
def test_part_that_oscillates_too_fast_acts_as_if_rigid(chain, rigid, steps):
    outcome = ig.simulate(chain, MOTION)
    assert outcome.object_velocity == pytest.approx(ig.simulate(rigid, MOTION).object_velocity, rel=1e-8)
    assert outcome.steps < steps


@pytest.mark.parametrize("coupling", [ig.Rigid(), SPRING, ig.SpringDamper(150.0, 0.1), ig.Bistable()], ids=str)
@pytest.mark.parametrize("friction", [0.05, 0.3])
def test_object_slides_as_far_as_its_last_speed_allows_and_rests(coupling, friction):
    struck = scene(1e5, 0.5, coupling, m_p=0.4, friction=friction)
    outcome = ig.simulate(struck, MOTION, duration=4.0, trace=True)
    last, trace = outcome.contacts[-1], outcome.trace
    gone = np.interp(last.end, trace.time, trace.object_position) + sliding_distance(last.object_velocity, friction)
    assert trace.object_position[-1] == pytest.approx(gone, rel=1e-10)
    early = ig.simulate(struck, MOTION, duration=last.end + 0.01)  # predicts the slide
    assert (early.slide, outcome.slide) == pytest.approx([gone - 0.2505] * 2, rel=1e-9)
    halt = last.end + last.object_velocity / (friction * GRAVITY)
    assert not trace.object_velocity[trace.time > halt + 1e-9].any()
    assert outcome.object_velocity == 0.0


def test_rest_time_is_the_latest_of_flange_object_and_tool():
    slippery, sticky = (ig.simulate(scene(1e6, 0.5, m_p=0.4, friction=mu), MOTION, duration=4.0) for mu in (0.05, 2.0))
    last = slippery.contacts[-1]
    assert slippery.rest_time == pytest.approx(last.end + last.object_velocity / (0.05 * GRAVITY), rel=1e-12)
    assert sticky.rest_time == pytest.approx(sticky.detection_time + 0.016 + 1.0 / 8.0, abs=1.1e-3)
    assert ig.simulate(scene(1e6, 0.5, friction=0.3), CRUISE).rest_time == math.inf  # a flange that never brakes
    swings = ig.simulate(scene(1e5, 0.5, ig.SpringDamper(150.0, 0.1), friction=0.5), MOTION, duration=4.0, trace=True)
    fast = swings.trace.time[np.abs(swings.trace.tool_velocity) > 1e-3]
    assert 0.0 < swings.rest_time - fast[-1] < math.pi / math.sqrt(150.0 / 0.125)  # within half an oscillation


def test_force_moves_the_object_only_above_its_friction():
    k_c, m_p, depth = 1e4, 5.0, 1e-3  # the depth of a press at 1 mm/s
    press = ig.Trapezoid(1e-3, 8.0, ig.Brake(1e-6, delay=1.0, deceleration=1e3))
    for force, moves in ((2.6 * k_c * depth**1.5, False), (0.5 * k_c * depth**1.5, True)):
        struck = scene(k_c, 0.5, m_p=m_p, distance=1e-4, friction=force / (m_p * GRAVITY))
        outcome = ig.simulate(struck, press, duration=3.0)
        assert (outcome.peak_object_velocity > 0.0) == (outcome.slide > 1e-12) == moves
        if not moves:
            assert outcome.slide == pytest.approx(0.0, abs=1e-14)
            assert outcome.contacts[-1].end is None  # all bodies rest, under force
            assert outcome.rest_time < 3.0
