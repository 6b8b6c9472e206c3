"""Many approaches at once: each row is `simulate` to the bit, on any number of threads, and no other affects it."""

import dataclasses

import numpy as np
import pytest
from scenes import MOTION, scene

import impact_gym as ig
from impact_gym.robot import default_approach

ROBOT = ig.Robot(5.225, 1.9e5, 50.4)
SPRING = ig.SpringDamper(150.0)
CHAINS = {
    "rigid": (ig.Rigid(), None),
    "spring": (SPRING, None),
    "bistable on a robot": (ig.Bistable(), ROBOT),
    "rigid on a table": (ig.Rigid(), default_approach().robot_table()),
}


def assert_row(outcomes, index, outcome):
    assert outcomes.status[index] == "ok"
    for name in ("object_velocity", "peak_object_velocity", "tool_velocity", "flange_velocity", "peak_force",
                 "coupling_impulse", "momentum_error", "steps"):  # fmt: skip
        assert getattr(outcomes, name)[index] == getattr(outcome, name)
    assert outcomes.contact_count[index] == len(outcome.contacts)
    assert outcomes.snap_count[index] == len(outcome.snap_through)
    first = outcome.contacts[0].start if outcome.contacts else np.nan
    assert np.array_equal(outcomes.first_contact[index], first, equal_nan=True)
    for name in ("detection_time", "slide", "rest_time"):
        alone = np.nan if getattr(outcome, name) in (None, np.inf) else getattr(outcome, name)
        assert np.array_equal(getattr(outcomes, name)[index], alone, equal_nan=True)


@pytest.mark.parametrize(("coupling", "robot"), CHAINS.values(), ids=CHAINS)
def test_row_of_a_sweep_is_simulate_to_the_bit(coupling, robot):
    masses, speeds, friction = np.array([[0.1], [1.0]]), np.array([0.4, 0.9, 1.3, 1.0]), np.array([0.0, 0.1, 0.4, 0.0])
    varied = {"object.mass": masses, "motion.speed": speeds, "object.friction": friction}
    struck = dataclasses.replace(scene(1e4, 0.5, coupling, robot), object=ig.Object(0.25, 0.2505, 0.1))
    outcomes = ig.sweep(struck, MOTION, varied, duration=1.1)
    assert outcomes.object_velocity.shape == (2, 4)
    for i, j in np.ndindex(2, 4):
        alone = dataclasses.replace(struck, object=ig.Object(masses[i, 0], 0.2505, friction[j]))
        assert_row(outcomes, (i, j), ig.simulate(alone, dataclasses.replace(MOTION, speed=speeds[j]), duration=1.1))
    assert np.isnan(outcomes.slide).tolist() == [[True, False, False, True]] * 2


def test_row_of_a_sweep_depends_on_neither_threads_nor_order():
    template, varied = scene(1e4, 0.5, SPRING), {"contact.stiffness": np.geomspace(1e3, 1e7, 200)}
    single, many = (ig.sweep(template, MOTION, varied, threads=n) for n in (1, 7))
    back = ig.sweep(template, MOTION, {"contact.stiffness": varied["contact.stiffness"][::-1]}, threads=3)
    for field in dataclasses.fields(ig.Outcomes):
        first = getattr(single, field.name)
        for other in (getattr(many, field.name), getattr(back, field.name)[::-1]):
            assert np.array_equal(first, other, equal_nan=first.dtype.kind == "f")


def test_row_that_cannot_finish_says_why_and_does_not_affect_others():
    stiffness = np.array([1e5, 1e18, 1e4])  # N/m; the second rings at 160 MHz with hardly any damping
    ringing = scene(1e4, 0.5, SPRING, dataclasses.replace(ROBOT, mass=1.0, damping=1e-3))
    outcomes = ig.sweep(ringing, MOTION, {"robot.stiffness": stiffness})
    assert "more integration steps than allowed" in outcomes.status[1]
    assert np.isnan([outcomes.object_velocity[1], outcomes.peak_object_velocity[1]]).all()
    for index in (0, 2):
        robot = dataclasses.replace(ringing.robot, stiffness=stiffness[index])
        assert_row(outcomes, index, ig.simulate(dataclasses.replace(ringing, robot=robot), MOTION))


def test_object_that_is_not_touched_rests_whatever_rounding_says():
    outcomes = ig.sweep(scene(1e4, 0.5, SPRING), MOTION, {"motion.speed": np.linspace(0.01, 0.1, 40)}, duration=0.7)
    assert (outcomes.contact_count == 0).all()
    assert (outcomes.object_velocity == 0.0).all()


def test_sweep_of_no_rows_has_none():
    assert ig.sweep(scene(1e4), MOTION, {"object.mass": []}).object_velocity.shape == (0,)
    assert ig.sweep(scene(1e4), MOTION, {}).object_velocity.shape == ()


@pytest.mark.parametrize(("bad", "error", "message"), [
    ({"varied": {"object.weight": [1.0]}}, ValueError, "object.weight.*object.mass"),
    ({"varied": {"object": [1.0]}}, ValueError, "'object'.*object.mass"),
    ({"varied": {"coupling.stiffness": [1.0]}}, ValueError, "coupling.stiffness.*motion.speed"),  # it is rigid
    ({"varied": {"contact.dissipation": ["exact"]}}, ValueError, "contact.dissipation"),
    ({"varied": {"object.mass": [0.1, -0.1]}}, ValueError, r"at \(1,\): Object.mass.*at least 1e-12 .*kg"),
    ({"varied": {"object.mass": [[0.1, np.nan]]}}, ValueError, r"at \(0, 1\): Object.mass.*finite"),
    ({"varied": {"object.mass": [0.1, 0.2], "motion.speed": [1.0, 2.0, 3.0]}}, ValueError, "broadcast"),
    ({"varied": {"object.mass": ["0.1"]}}, TypeError, r"object\.mass"),
    ({"varied": [1]}, TypeError, "varied"),
    ({"scene": 1}, TypeError, "scene"),
    ({"motion": None}, TypeError, "motion"),
    ({"threads": 1.5}, TypeError, "threads"),
    ({"threads": 0}, ValueError, "threads must be .*at least 1, got 0"),
    ({"rtol": "1e-3"}, TypeError, "rtol"),
], ids=str)  # fmt: skip
def test_sweep_names_bad_input_and_its_place(bad, error, message):
    with pytest.raises(error, match=message):
        ig.sweep(**{"scene": scene(1e4), "motion": MOTION, "varied": {}} | bad)
