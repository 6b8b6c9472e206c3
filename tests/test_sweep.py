"""Many approaches at once: each row is `simulate` to the bit, on any number of threads, and none spoils another."""

import dataclasses

import numpy as np
import pytest

import impact_gym as ig
from impact_gym import sweeps
from impact_gym.robot import default_approach

MOTION = ig.Trapezoid(1.0, 8.0, ig.Brake())
ROBOT = ig.Robot(5.225, 1.5e5, 53.75)
CHAINS = {
    "rigid": (ig.Rigid(), None),
    "spring": (ig.SpringDamper(150.0), None),
    "bistable on a robot": (ig.Bistable(), ROBOT),
    "rigid on a table": (ig.Rigid(), default_approach().robot_table()),
}


def scene(coupling, robot=None, **contact):
    return ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.2505), ig.Contact(1e4, 0.5, **contact), coupling, robot)


def assert_row(outcomes, index, outcome):
    assert outcomes.status[index] == "ok"
    for name in ("object_velocity", "tool_velocity", "flange_velocity", "peak_force", "coupling_impulse"):
        assert getattr(outcomes, name)[index] == getattr(outcome, name)
    assert outcomes.momentum_error[index] == outcome.momentum_error
    assert outcomes.contact_count[index] == len(outcome.contacts)
    assert outcomes.snap_count[index] == len(outcome.snap_through)
    assert outcomes.steps[index] == outcome.steps
    first = outcome.contacts[0].start if outcome.contacts else np.nan
    assert np.array_equal(outcomes.first_contact[index], first, equal_nan=True)
    detected = np.nan if outcome.detection_time is None else outcome.detection_time
    assert np.array_equal(outcomes.detection_time[index], detected, equal_nan=True)


@pytest.mark.parametrize(("coupling", "robot"), CHAINS.values(), ids=CHAINS)
def test_every_row_equals_simulate_to_the_bit(coupling, robot):
    masses, speeds = np.array([[0.1], [1.0]]), np.array([0.4, 0.9, 1.3])
    outcomes = ig.sweep(scene(coupling, robot), MOTION, {"object.mass": masses, "motion.speed": speeds}, duration=1.1)
    assert outcomes.object_velocity.shape == (2, 3)
    for i, j in np.ndindex(2, 3):
        one = dataclasses.replace(scene(coupling, robot), object=ig.Object(masses[i, 0], 0.2505))
        motion = dataclasses.replace(MOTION, speed=speeds[j])
        assert_row(outcomes, (i, j), ig.simulate(one, motion, duration=1.1))


@pytest.mark.parametrize(
    ("template", "name", "values"),
    [
        (scene(ig.Bistable()), "coupling.height", [0.02, 0.028, 0.035]),
        (scene(ig.Bistable()), "coupling.front_stop", [0.01, 0.0208]),
        (scene(ig.SpringDamper(150.0)), "coupling.damping_ratio", [0.0, 1.0, 2.0]),
        (scene(ig.SpringDamper(150.0)), "coupling.stiffness", [50.0, 90.0]),
        (scene(ig.Rigid(), ROBOT), "robot.stiffness", [1e4, 1e5]),
        (scene(ig.Rigid()), "contact.restitution", [0.05, 1.0]),
        (scene(ig.Rigid(), dissipation="exact"), "contact.stiffness_exponent", [1.5, 2.0]),
        (scene(ig.SpringDamper(150.0)), "motion.brake.delay", [0.0, 0.03]),
        (scene(ig.Rigid()), "tool.mass", [0.1, 0.2]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_any_number_of_the_records_can_be_varied(template, name, values):
    outcomes = ig.sweep(template, MOTION, {name: values})
    top, *path = name.split(".")
    for index, value in enumerate(values):
        record = MOTION if top == "motion" else getattr(template, top)
        if len(path) == 2:
            changed = dataclasses.replace(record, brake=dataclasses.replace(record.brake, **{path[1]: value}))
        else:
            changed = dataclasses.replace(record, **{path[0]: value})
        one, motion = (
            (template, changed) if top == "motion" else (dataclasses.replace(template, **{top: changed}), MOTION)
        )
        outcome = ig.simulate(one, motion)
        if name == "contact.stiffness_exponent":  # the sweep has one contact law for all its rows
            assert outcomes.object_velocity[index] == pytest.approx(outcome.object_velocity, rel=1e-8)
        else:
            assert_row(outcomes, index, outcome)
    assert len(set(outcomes.object_velocity.tolist())) > 1 or name == "tool.mass"  # imposed: its mass is nothing


def test_neither_threads_nor_order_change_a_row():
    stiffness = np.geomspace(1e3, 1e7, 200)
    varied = {"contact.stiffness": stiffness}
    one, many = (ig.sweep(scene(ig.SpringDamper(150.0)), MOTION, varied, threads=n) for n in (1, 7))
    back = ig.sweep(scene(ig.SpringDamper(150.0)), MOTION, {"contact.stiffness": stiffness[::-1]}, threads=3)
    for field in dataclasses.fields(ig.Outcomes):
        first = getattr(one, field.name)
        for other in (getattr(many, field.name), getattr(back, field.name)[::-1]):
            assert np.array_equal(first, other, equal_nan=first.dtype.kind == "f")


def test_a_row_that_cannot_finish_says_why_and_spoils_no_other(monkeypatch):
    monkeypatch.setattr(sweeps, "MAX_STEPS", 100)
    damping = np.array([1.0, 1e5, 0.5])  # 1e5: stiff, and takes more than twice as many steps
    outcomes = ig.sweep(scene(ig.SpringDamper(150.0)), MOTION, {"coupling.damping_ratio": damping})
    assert outcomes.status[1] != "ok"
    assert "steps" in outcomes.status[1]
    assert np.isnan(outcomes.object_velocity[1])
    for index in (0, 2):
        assert_row(outcomes, index, ig.simulate(scene(ig.SpringDamper(150.0, damping[index])), MOTION))


def test_no_rows_are_no_rows():
    assert ig.sweep(scene(ig.Rigid()), MOTION, {"object.mass": []}).object_velocity.shape == (0,)
    assert ig.sweep(scene(ig.Rigid()), MOTION, {}).object_velocity.shape == ()


@pytest.mark.parametrize(
    ("varied", "message"),
    [
        ({"object.weight": [1.0]}, "object.weight.*object.mass"),
        ({"object": [1.0]}, "'object'.*object.mass"),
        ({"mass": [1.0]}, "'mass'.*tool.mass"),
        ({"coupling.stiffness": [1.0]}, "coupling.stiffness.*motion.speed"),  # the coupling is rigid
        ({"contact.dissipation": ["exact"]}, "contact.dissipation"),
        ({"object.mass": [0.1, -0.1]}, r"at \(1,\): Object.mass.*above 0 kg"),
        ({"object.mass": [[0.1, np.nan]]}, r"at \(0, 1\): Object.mass.*finite"),
        ({"object.mass": [0.1, 0.2], "motion.speed": [1.0, 2.0, 3.0]}, "broadcast"),
    ],
)
def test_bad_values_are_named_with_their_place(varied, message):
    with pytest.raises(ValueError, match=message):
        ig.sweep(scene(ig.Rigid()), MOTION, varied)


@pytest.mark.parametrize("bad", [{"scene": 1}, {"motion": None}, {"varied": [1]}, {"threads": 1.5}, {"rtol": "1e-3"}])
def test_bad_arguments_are_named(bad):
    arguments = {"scene": scene(ig.Rigid()), "motion": MOTION, "varied": {}} | bad
    with pytest.raises(TypeError, match=next(iter(bad))):
        ig.sweep(**arguments)


def test_strings_are_no_numbers():
    with pytest.raises(TypeError, match=r"Object\.mass"):
        ig.sweep(scene(ig.Rigid()), MOTION, {"object.mass": ["0.1"]})
