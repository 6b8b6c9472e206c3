"""Closed forms of friction under the object, of the stroke of a spring, and of a fixed damping."""

import math

import numpy as np
import pytest
from solver_scenes import CRUISE, MOTION, SPRING, scene

import impact_gym as ig
from impact_gym.physics.impact import GRAVITY, sliding_distance


@pytest.mark.parametrize("coupling", [ig.Rigid(), SPRING, ig.SpringDamper(150.0, 0.1), ig.Bistable()], ids=str)
@pytest.mark.parametrize("friction", [0.05, 0.3])
def test_object_slides_as_far_as_its_last_speed_allows_and_rests(coupling, friction):
    outcome = ig.simulate(scene(1e5, 0.5, coupling, m_p=0.4, friction=friction), MOTION, duration=4.0, trace=True)
    last, trace = outcome.contacts[-1], outcome.trace
    gone = sliding_distance(last.object_velocity, friction)
    at_parting = np.interp(last.end, trace.time, trace.object_position)
    assert trace.object_position[-1] - at_parting == pytest.approx(gone, rel=1e-9)
    assert outcome.slide == pytest.approx(trace.object_position[-1] - 0.2505, rel=1e-12)
    assert (outcome.object_velocity, trace.object_velocity[-1]) == (0.0, 0.0)
    halt = last.end + last.object_velocity / (friction * GRAVITY)
    assert outcome.rest_time >= halt * (1 - 1e-12)
    still = trace.object_velocity[trace.time > halt + 1e-9]
    assert not still.any()
    # a run that ends earlier predicts the slide
    early = ig.simulate(scene(1e5, 0.5, coupling, m_p=0.4, friction=friction), MOTION, duration=last.end + 0.01)
    assert early.slide == pytest.approx(outcome.slide, rel=1e-9)


def test_rest_time_is_the_later_of_flange_and_object():
    slippery, sticky = (ig.simulate(scene(1e6, 0.5, m_p=0.4, friction=mu), MOTION, duration=4.0) for mu in (0.05, 2.0))
    last = slippery.contacts[-1]
    assert slippery.rest_time == pytest.approx(last.end + last.object_velocity / (0.05 * GRAVITY), rel=1e-12)
    assert sticky.rest_time == pytest.approx(sticky.detection_time + 0.016 + 1.0 / 8.0, abs=1.1e-3)
    assert ig.simulate(scene(1e6, 0.5, friction=0.3), CRUISE).rest_time == math.inf  # a flange that never brakes


def test_tool_rests_once_it_is_slower_than_a_millimetre_a_second():
    outcome = ig.simulate(scene(1e5, 0.5, ig.SpringDamper(150.0, 0.1), friction=0.5), MOTION, duration=4.0, trace=True)
    trace = outcome.trace
    fast = trace.time[np.abs(trace.tool_velocity) > 1e-3]
    assert 0.0 < outcome.rest_time - fast[-1] < math.pi / math.sqrt(150.0 / 0.125)  # within half an oscillation


@pytest.mark.parametrize("coupling", [ig.Rigid(), SPRING], ids=str)
def test_force_moves_the_object_only_above_its_friction(coupling):
    k_c, m_p, depth = 1e4, 5.0, 1e-3  # the depth of a press at 1 mm/s
    slow = ig.Trapezoid(1e-3, 8.0, ig.Brake(1e-6, delay=1.0, deceleration=1e3))
    at_most, at_least = (2.6 * k_c * depth**1.5, k_c * depth**1.5) if coupling == ig.Rigid() else (0.15, 0.149)
    for force, moves in ((at_most, False), (0.5 * at_least, True)):
        struck = scene(k_c, 0.5, coupling, m_p=m_p, distance=1e-4, friction=force / (m_p * GRAVITY))
        outcome = ig.simulate(struck, slow, duration=3.0)
        assert (outcome.peak_object_velocity > 0.0) == (outcome.slide > 1e-12) == moves
        if not moves:
            assert outcome.slide == pytest.approx(0.0, abs=1e-14)
            assert outcome.contacts[-1].end is None  # all bodies rest, under force
            assert outcome.rest_time < 3.0


def test_steady_push_has_the_force_of_friction():
    pushed = scene(1e4, 0.1, SPRING, m_p=0.5, friction=0.4)
    outcome = ig.simulate(pushed, ig.Trapezoid(0.2, 8.0), duration=4.0, trace=True)
    assert outcome.trace.contact_force[-1] == pytest.approx(0.4 * 0.5 * GRAVITY, rel=1e-6)
    assert outcome.object_velocity == pytest.approx(0.2, rel=1e-6)
    assert outcome.momentum_error < 1e-9


def test_tool_catches_up_with_an_object_that_friction_slows_down():
    outcome = ig.simulate(scene(1e5, friction=5e-4), ig.Trapezoid(0.01, 8.0), duration=40.0)
    assert outcome.momentum_error < 1e-9
    first, second, *_ = outcome.contacts
    assert second.start - first.end == pytest.approx(2.0 * first.separation_velocity / (5e-4 * GRAVITY), rel=1e-9)


def test_fixed_damping_has_its_restitution_at_one_velocity_only():
    delivered = []
    for speed in (0.05, 0.2, 0.8):
        fixed = scene(1e5, 0.4, dissipation="fixed", reference_velocity=0.2)
        contact = ig.simulate(fixed, ig.Trapezoid(speed, 50.0), duration=1.0 + 0.3 / speed, rtol=1e-10).contacts[0]
        delivered.append(contact.separation_velocity / contact.approach_velocity)
        assert contact.approach_velocity == pytest.approx(speed, rel=1e-3)
    assert delivered[0] > delivered[1] > delivered[2]
    assert delivered[1] == pytest.approx(0.4, rel=1e-8)
    lost = []  # for small d, 1 - e = 2/3 d + 4/9 d^2, and d is proportional to the velocity
    for speed in (0.05, 0.1):
        approach = scene(1e5, 0.99, dissipation="fixed"), ig.Trapezoid(speed, 50.0), 1.0 + 0.3 / speed
        (contact,) = ig.simulate(*approach, rtol=1e-11).contacts
        lost.append(1.0 - contact.separation_velocity / contact.approach_velocity)
    assert lost[1] / lost[0] == pytest.approx(2.0, rel=1e-3)


def test_stroke_too_short_for_the_arms_acceleration_is_warned_of():
    short = ig.SpringDamper(50.0, stroke=0.01)
    with pytest.warns(UserWarning, match=r"stroke is 0\.01 m.* 8 m/s\^2 .* 0\.02 m"):
        ig.simulate(scene(1e5, 0.5, short), MOTION)
