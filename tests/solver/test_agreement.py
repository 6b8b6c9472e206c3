"""Random and hard approaches, by our solver and by experiments/reference, which shares no code with it.

tests/helpers/reference_table.py says how the table is made. tests/experiments/test_stability.py has the comparison with
heyoka's Taylor series.
"""

from dataclasses import replace

import numpy as np
import pytest
from reference_table import GROUND, table

import impact_gym as ig

RTOLS = 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-13
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
