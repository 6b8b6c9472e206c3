"""Numbers at the ends of their limits, alone and together: a run is right, or says why it is not."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tasks import STORM

import impact_gym as ig
from impact_gym.lowering import STATUS_MESSAGES
from impact_gym.quantities import BY_PATH
from impact_gym.task import paths

ROBOTS = None, ig.Robot(5.0, 1e5, 50.0)
COUPLINGS = ig.Rigid(), ig.SpringDamper(150.0), ig.Bistable()
FITTED = "coupling.free_length", "coupling.height", "coupling.front_stop", "coupling.rear_stop"  # to each other


@st.composite
def extreme_cases(draw):
    """An approach with some numbers anywhere within their limits, mostly at their ends, and its duration."""
    coupling, robot = draw(st.sampled_from(COUPLINGS)), draw(st.sampled_from(ROBOTS))
    scene = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.25), ig.Contact(1e5, 0.5), coupling, robot)
    records = {**paths.parts(scene), "motion": ig.Trapezoid(1.0, 8.0, ig.Brake(deceleration=5.0))}
    free = sorted({*paths.flatten(records)} - {*FITTED, "contact.damping_exponent"})
    for path in draw(st.lists(st.sampled_from(free), min_size=1, max_size=5, unique=True)):
        low, high = max(BY_PATH[path].limits.at_least, 1e-12), BY_PATH[path].limits.at_most
        between = st.floats(math.log(low), math.log(high)).map(lambda power: float(math.exp(power)))
        records = paths.replaced(records, {path: min(max(draw(st.sampled_from([low, high]) | between), low), high)})
    motion, distance = records.pop("motion"), records["object"].distance
    there = distance / motion.speed + math.sqrt(2 * distance / motion.acceleration)
    return ig.Scene(**records), motion, min(2.0 * there + 1.0, 1e12)


@settings(STORM, max_examples=75)
@given(extreme_cases())
def test_scene_within_the_limits_is_solved_or_says_why_not(case):
    scene, motion, duration = case
    outcomes, failures = [], []
    for rtol in (1e-8, 1e-11):
        try:
            outcomes.append(ig.simulate(*case, rtol))
        except RuntimeError as error:
            failures.append(str(error).partition(" s: ")[2])
    assert {*failures} <= {*STATUS_MESSAGES.values()}
    rounding = 1e-6 * min(motion.speed, motion.acceleration * duration) + 2e-12  # m/s, of a touch at rest
    for outcome in outcomes:
        gained = sum(contact.impulse for contact in outcome.contacts) / scene.object.mass
        for other in (gained, outcomes[0].object_velocity):
            assert outcome.object_velocity == pytest.approx(other, rel=1e-4, abs=rounding)
        assert -rounding <= outcome.object_velocity < math.inf
