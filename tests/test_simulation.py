"""Records of a scene; `simulate` at the limits of its arguments, `sweep` equal to it to the bit, and `advise`."""

import math
from dataclasses import astuple, fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_tasks import STORM
from solver_scenes import COUPLINGS, MOTION, ROBOT, ROBOTS, SPRING, scene, split, with_every_number

import impact_gym as ig
from impact_gym import simulation
from impact_gym.pack import STATUS_MESSAGES
from impact_gym.quantities import BY_PATH
from impact_gym.scene import LAWS
from impact_gym.support import dotted_paths

SCENE = scene(coupling=SPRING)
EVERY_COUPLING = [*COUPLINGS.values(), ig.SpringDamper(150.0, 0.5, stroke=0.02)]


def test_robot_table_is_constant_beyond_its_ends():
    table = ROBOTS["robot table"]
    ends = [table.at(position) for position in (table.position[0], table.position[-1])]
    assert [table.at(position) for position in (-0.1, 0.5)] == ends


def test_brake_without_deceleration_has_that_of_the_trapezoid():
    assert [ig.Trapezoid(1.0, 5.0, ig.Brake(deceleration=given)).deceleration for given in (None, 3.0)] == [5.0, 3.0]
    assert astuple(ig.Brake()) == (1.0, 0.016, None)


def assert_row(outcomes, index, outcome):
    """A row has all numbers of `simulate`, and nan for events that do not happen."""
    own = {"contact_count": len(outcome.contacts), "snap_count": len(outcome.snap_through), "status": "ok"}
    own["first_contact"] = outcome.contacts[0].start if outcome.contacts else np.nan
    for field in fields(ig.Outcomes):
        alone = own[field.name] if field.name in own else getattr(outcome, field.name)
        value = getattr(outcomes, field.name)[index]
        assert value == alone or (np.isnan(value) and alone in (None, np.inf, np.nan)), field.name


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_row_of_a_sweep_is_simulate_to_the_bit(coupling, robot):
    speeds, friction = np.array([0.01, 0.9, 1.3, 1.0]), np.array([0.0, 0.1, 0.4, 0.0])
    masses = np.geomspace(0.1, 1.0, 2 * simulation.APPROACHES_PER_THREAD // 4)[:, None]  # rows for two threads
    varied = {"object.mass": masses, "motion.speed": speeds, "object.friction": friction}
    struck = replace(scene(1e4, 0.5, COUPLINGS[coupling], ROBOTS[robot]), object=ig.Object(0.25, 0.2505, 0.1))
    outcomes = ig.sweep(struck, MOTION, varied, duration=1.1, threads=3)
    for i, j in np.ndindex(len(masses), 4):
        alone = replace(struck, object=ig.Object(masses[i, 0], 0.2505, friction[j]))
        assert_row(outcomes, (i, j), ig.simulate(alone, replace(MOTION, speed=speeds[j]), duration=1.1))
    assert np.isnan(outcomes.slide).tolist() == [[True, False, False, True]] * len(masses)
    assert not outcomes.object_velocity[:, 0].any()  # the motion does not reach


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("law", LAWS)
def test_sweep_over_every_number_is_simulate_to_the_bit(law, robot):
    random, durations = np.random.default_rng([*law.encode(), *robot.encode()]), [0.5, 0.6, 0.7]
    for coupling in EVERY_COUPLING:
        records = with_every_number(coupling, ROBOTS[robot], dissipation=law)
        varied = {path: number * random.uniform(0.9, 1.0, 3) for path, number in dotted_paths.flatten(records).items()}
        varied |= {"contact.stiffness_exponent": [1.5, 1.0, 2.0], "contact.damping_exponent": [1.5, 0.0, 2.0]}
        outcomes = ig.sweep(*split(records), varied, durations, 1e-5)
        for row, duration in enumerate(durations):
            alone = dotted_paths.replaced(records, {path: values[row] for path, values in varied.items()})
            assert_row(outcomes, row, ig.simulate(*split(alone), duration, 1e-5))


def refusal_by(call):
    """The message of the ValueError that a call raises, or None."""
    try:
        call()
    except ValueError as error:
        return str(error)


@pytest.mark.parametrize("coupling", EVERY_COUPLING, ids=str)
def test_sweep_refuses_what_a_record_refuses_in_its_words(coupling, monkeypatch):
    monkeypatch.setattr(simulation, "MAX_STEPS", 100)
    records = with_every_number(coupling, dissipation="fixed")
    refused = 0
    for path, good in dotted_paths.flatten(records).items():
        ends = [end for end in BY_PATH[path].limits if math.isfinite(end)]
        beyond = [float(np.nextafter(end, far)) for end in ends for far in (-np.inf, np.inf)]
        for value in [np.nan, np.inf, -np.inf, -0.03, 0.0, 0.03, 0.07, 0.5, *ends, *beyond]:
            alone = refusal_by(lambda: dotted_paths.replaced(records, {path: value}))  # noqa: B023
            swept = refusal_by(lambda: ig.sweep(*split(records), {path: [good, value]}, 1e-3))  # noqa: B023
            assert swept == (alone and f"at (1,): {alone}"), (path, value)
            refused += alone is not None
    assert refused > 100


def test_sweep_names_the_first_row_whose_numbers_do_not_fit():
    varied = {"coupling.free_length": [[0.07], [0.04]], "coupling.height": [0.01, 0.03, 0.05]}
    bistable = split(with_every_number(ig.Bistable(front_stop=0.005, rear_stop=-0.005)))
    assert refusal_by(lambda: ig.sweep(*bistable, varied)).startswith("at (1, 2): Bistable.height must be below")


@pytest.mark.parametrize(("varied", "shape"), [({"object.mass": []}, (0,)), ({}, ())])
def test_sweep_over_nothing_has_its_shape(varied, shape):
    assert ig.sweep(SCENE, MOTION, varied).object_velocity.shape == shape


def test_run_that_cannot_finish_says_why_and_affects_no_other(monkeypatch):
    monkeypatch.setattr(simulation, "MAX_STEPS", 50_000)
    stiffness = [1e5, 1e18, 1e4]  # N/m; the second robot oscillates at 160 MHz with hardly any damping
    robots = [ig.Robot(1.0, each, 1e-3) for each in stiffness]
    first, endless, last = (scene(1e4, 0.5, SPRING, robot) for robot in robots)
    outcomes = ig.sweep(first, MOTION, {"robot.stiffness": stiffness})
    assert "more integration steps than allowed" in outcomes.status[1]
    assert np.isnan([outcomes.object_velocity[1], outcomes.peak_object_velocity[1]]).all()
    with pytest.raises(RuntimeError, match=r"stopped at t = \S+ s: more integration steps than allowed"):
        ig.simulate(endless, MOTION)
    assert_row(outcomes, 0, ig.simulate(first, MOTION))
    assert_row(outcomes, 2, ig.simulate(last, MOTION))


def test_advise_simplifies_by_the_largest_error_of_any_scene():
    hard, soft = (replace(SCENE, robot=replace(ROBOT, stiffness=stiffness)) for stiffness in (1e9, 1e4))
    advice = ig.advise(hard, MOTION, 1e-3)
    full, simple = (ig.simulate(chain, MOTION).object_velocity for chain in (hard, SCENE))
    assert (advice.model.name, advice.model.simplify(hard)) == ("robot rigid", SCENE)
    assert "robot rigid" in str(advice)
    assert advice.model.errors.tolist() == [abs(simple - full) / full]
    both, other = (ig.advise(scenes, MOTION, 1e-3).tried[1] for scenes in ([hard, soft], soft))
    assert both.errors.tolist() == [advice.tried[1].bound, other.bound]
    assert both.bound == max(both.errors)


def test_advise_keeps_a_scene_in_which_every_part_matters():
    for quantity in ("object_velocity", "peak_force", "impulse"):
        kept = ig.advise(replace(SCENE, robot=ROBOT), MOTION, 1e-12, quantity)
        assert kept.model is kept.tried[0]
        assert [model.bound > 1e-12 for model in kept.tried] == [False, True, True, True]  # the robot, the spring, both
    assert len(ig.advise(replace(SCENE, coupling=ig.Rigid()), MOTION).tried) == 1  # nothing to simplify
    late = scene(distance=0.05, robot=replace(ROBOT, stiffness=1e4))  # only the simpler scene has touched yet
    assert ig.advise(late, MOTION, duration=0.113).tried[1].bound == math.inf


@st.composite
def extreme_cases(draw):
    """An approach with some numbers within or at their limits, and its duration."""
    chain = scene(coupling=draw(st.sampled_from([*COUPLINGS.values()])), robot=draw(st.sampled_from([None, ROBOT])))
    records = {**dotted_paths.parts(chain), "motion": ig.Trapezoid(1.0, 8.0, ig.Brake(deceleration=5.0))}
    dependent = {f"coupling.{name}" for name in ("free_length", "height", "front_stop", "rear_stop")}
    free = sorted({*dotted_paths.flatten(records)} - dependent - {"contact.damping_exponent"})
    for path in draw(st.lists(st.sampled_from(free), min_size=1, max_size=5, unique=True)):
        low, high = max(BY_PATH[path].limits.at_least, 1e-12), BY_PATH[path].limits.at_most
        between = st.floats(math.log(low), math.log(high)).map(lambda power: float(math.exp(power)))
        number = min(max(draw(st.sampled_from([low, high]) | between), low), high)
        records = dotted_paths.replaced(records, {path: number})
    motion, distance = records.pop("motion"), records["object"].distance
    there = distance / motion.speed + math.sqrt(2 * distance / motion.acceleration)
    return ig.Scene(**records), motion, min(2.0 * there + 1.0, 1e12)


@settings(STORM, max_examples=75)
@given(case=extreme_cases())
def test_scene_within_the_limits_is_solved_or_reported_as_not(monkeypatch, case):
    monkeypatch.setattr(simulation, "MAX_STEPS", 50_000)  # a million take a second
    chain, motion, duration = case
    outcomes, failures = [], []
    for rtol in (1e-8, 1e-11):
        try:
            outcomes.append(ig.simulate(*case, rtol))
        except RuntimeError as error:
            failures.append(str(error).partition(" s: ")[2])
    assert {*failures} <= {*STATUS_MESSAGES.values()}
    rounding = 1e-6 * min(motion.speed, motion.acceleration * duration) + 2e-12  # m/s, of a touch at rest
    for outcome in outcomes:
        gained = sum(contact.impulse for contact in outcome.contacts) / chain.object.mass
        for other in (gained, outcomes[0].object_velocity):
            assert outcome.object_velocity == pytest.approx(other, rel=1e-4, abs=rounding)
        assert -rounding <= outcome.object_velocity < math.inf
