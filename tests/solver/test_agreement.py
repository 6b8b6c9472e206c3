"""Random and hard approaches, by our solver and by experiments/reference, which shares no code with it.

tests/helpers/reference_table.py says how the table is made. Hard approaches, and friction, also obey laws.
tests/experiments/test_solvers.py has the comparison with heyoka's Taylor series.

The table has the scenes of the paper's figures. The paper prints the speed of 1 m/s, the detection, and each scene's
masses, stiffnesses and restitution. We identified distance, acceleration and stops (docs/provenance.md). The study
`paper` compares these scenes with the text.
"""

from dataclasses import replace

import numpy as np
import pytest
from reference_table import GROUND, barely_parting, overdamped, table
from scipy.interpolate import CubicHermiteSpline
from solver_scenes import CRUISE, MOTION, SPRING, scene

import impact_gym as ig
from impact_gym.physics.impact import GRAVITY, sliding_distance

RTOLS = 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-13
STIFF = ig.SpringDamper(1e8)
RIGID_ROBOT = "imposed", "clamped"  # families with a flight in closed form, where rtol bounds all errors


def time_unit(scene, contact):
    """t0 of a contact with a flange that does not yield, s."""
    mass, v = scene.object.mass, contact.approach_velocity
    if not isinstance(scene.coupling, ig.Rigid):
        mass = mass * scene.tool.mass / (mass + scene.tool.mass)
    return (mass * v**2 / scene.contact.stiffness) ** (1 / (scene.contact.stiffness_exponent + 1)) / v


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize("family", RIGID_ROBOT)
def test_error_is_at_most_the_tolerance_asked_for(family, rtol):
    bound = max(rtol, 1e-10)  # the accuracy of the reference
    for run in table()[family]:
        fast, exact, (scene, *_) = ig.simulate(*run.approach, rtol), run.outcome, run.approach
        first, impulse = exact.contacts[0], scene.object.mass * exact.object_velocity
        assert fast.object_velocity == pytest.approx(exact.object_velocity, rel=bound), run.name
        assert fast.peak_force == pytest.approx(exact.peak_force, rel=bound), run.name
        late = (fast.detection_time or 0.0) - (exact.detection_time or 0.0)
        assert abs(late) <= bound * time_unit(scene, first), run.name
        for ours, theirs in zip(fast.contacts, exact.contacts, strict=True):
            assert abs(ours.impulse - theirs.impulse) <= bound * impulse, run.name
            if theirs.end is not None:
                off = abs(ours.separation_velocity - theirs.separation_velocity)
                assert off <= bound * first.approach_velocity, run.name


def numbers(scene, outcome):
    """All numbers of an outcome, and the unit of the error of each; for times it is the t0 of their contact."""
    units, first = [time_unit(scene, contact) for contact in outcome.contacts], outcome.contacts[0]
    values = [(outcome.detection_time or 0.0, units[0]), *((time, units[0]) for time in outcome.snap_through)]
    for contact, t0 in zip(outcome.contacts, units, strict=True):
        values += [(contact.start, t0), (contact.object_velocity, first.approach_velocity)]
        if contact.end is not None:
            values += [(contact.end, t0), (contact.end - contact.start, t0)]
            values += [(contact.separation_velocity, first.approach_velocity)]
        values += [(size, size) for size in (contact.peak_force, contact.approach_velocity, contact.impulse)]
    speeds = "object_velocity", "peak_object_velocity", "tool_velocity", "flange_velocity"
    values += [(getattr(outcome, name), first.approach_velocity) for name in speeds]
    end = ig.Trace(*(row[-1] for row in outcome.trace)) if getattr(outcome, "trace", None) else outcome
    positions = "object_position", "tool_position", "flange_position"
    values += [(getattr(end, name), scene.object.distance) for name in positions]
    return np.array([*values, (outcome.peak_force, outcome.peak_force), (outcome.coupling_impulse, first.impulse)]).T


def sensitivity(approach):
    """The largest change of each number per relative change of a parameter of contact, tool or object."""
    here, moved = numbers(approach[0], ig.simulate(*approach, 1e-13, trace=True))[0], []
    for part, name in (("contact", "stiffness"), ("contact", "restitution"), ("tool", "mass"), ("object", "mass")):
        record = getattr(approach[0], part)
        record = replace(record, **{name: getattr(record, name) * (1 - 1e-7)})
        other = replace(approach[0], **{part: record}), *approach[1:]
        moved.append(numbers(other[0], ig.simulate(*other, 1e-13, trace=True))[0] - here)
    return np.abs(moved).max(axis=0) / 1e-7


def assert_agrees(run, outcome, bound):
    (ours, _), (theirs, unit) = numbers(run.approach[0], outcome), numbers(run.approach[0], run.outcome)
    off = np.abs(ours - theirs)
    assert np.all(off < bound * unit) or np.all(off < bound * (unit + sensitivity(run.approach))), run.name


@pytest.mark.parametrize("family", sorted({*table()} - {"barely parting"}))
def test_every_number_agrees_with_the_independent_solver(family):
    slid = stopped = 0
    for run in table()[family]:
        scene = run.approach[0]
        for rtol in (1e-10,) if family in GROUND else (1e-6, 1e-8, 1e-10):
            fast = ig.simulate(*run.approach, rtol, trace=True)
            # in a mechanism's flight rtol bounds the error of each step; rebounds between its stops multiply errors
            factor = 100 if isinstance(scene.coupling, ig.Bistable) else 3
            assert_agrees(run, fast, factor * rtol + 1e-9)  # 1e-9: the reference's own error in flight
            assert fast.momentum_error < 1e-9
            assert fast.steps < 3000
        if fast.slide is not None and fast.object_velocity == 0.0:
            gone = run.outcome.object_position - scene.object.distance
            assert fast.slide == pytest.approx(gone, rel=0, abs=1e-8)
            slid += fast.slide > 0.0
        stopped += run.outcome.stop_hits > 0
    assert slid >= len(table()[family]) // 8 or "friction" not in family
    assert stopped >= len(table()[family]) // 8 or "stroke" not in family


ALL = [pytest.param(name, slice(None), marks=pytest.mark.slow, id=f"all of {name}") for name in table()]


@pytest.mark.parametrize(("family", "part"), [pytest.param(None, slice(7, None, 45), id="a sample"), *ALL])
def test_the_table_is_what_the_independent_solver_gives(family, part):
    for run in [run for name, runs in table().items() for run in runs if family in (name, None)][part]:
        again = run.solved()
        assert again.stop_hits == run.outcome.stop_hits
        assert [contact.end is None for contact in again.contacts] == [c.end is None for c in run.outcome.contacts]
        assert again.object_velocity == pytest.approx(run.outcome.object_velocity, rel=1e-9, abs=1e-12)
        if again.contacts and run.family != "barely parting":
            assert_agrees(run, again, 1e-9)  # rounding differs from machine to machine


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
        early = np.sqrt(2 * margin / bend)  # of a parabola
        assert contacts[0].start == pytest.approx(when - early, abs=0.02 * np.sqrt(margin))


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
    assert ig.simulate(scene(1e6, 0.5, friction=0.3), CRUISE).rest_time == np.inf  # a flange that never brakes
    swings = ig.simulate(scene(1e5, 0.5, ig.SpringDamper(150.0, 0.1), friction=0.5), MOTION, duration=4.0, trace=True)
    fast = swings.trace.time[np.abs(swings.trace.tool_velocity) > 1e-3]
    assert 0.0 < swings.rest_time - fast[-1] < np.pi / np.sqrt(150.0 / 0.125)  # within half an oscillation


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


FIGURES = {run.name: (run.outcome, ig.simulate(*run.approach, rtol=1e-12)) for run in table()["figure"]}


@pytest.mark.parametrize("solver", [0, 1], ids=["independent", "ours"])
def test_mechanism_of_fig_23a_snaps_in_the_contact(solver):
    stops = "23a", "23a, rear stop at -10 mm", "23a, rear stop at -30 mm"
    bistable, *moved, rigid = (FIGURES[figure][solver] for figure in (*stops, "25"))
    assert 1 - bistable.object_velocity / rigid.object_velocity == pytest.approx(0.51, abs=5e-4)  # printed in Fig. 25
    (crossing,), (contact,) = bistable.snap_through, bistable.contacts
    assert contact.start < crossing < contact.end
    assert [each.object_velocity for each in moved] == pytest.approx([bistable.object_velocity] * 2, rel=1e-12)
