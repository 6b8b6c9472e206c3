"""Many approaches at once: each row is `simulate` to the bit, on any number of threads, and none spoils another."""

import dataclasses

import numpy as np
import pytest
from scenes import MOTION, scene

import impact_gym as ig
from impact_gym import sweeps
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
    for name in ("object_velocity", "tool_velocity", "flange_velocity", "peak_force", "coupling_impulse",
                 "momentum_error", "steps"):  # fmt: skip
        assert getattr(outcomes, name)[index] == getattr(outcome, name)
    assert outcomes.contact_count[index] == len(outcome.contacts)
    assert outcomes.snap_count[index] == len(outcome.snap_through)
    first = outcome.contacts[0].start if outcome.contacts else np.nan
    assert np.array_equal(outcomes.first_contact[index], first, equal_nan=True)
    for name in ("detection_time", "sliding_distance"):
        alone = np.nan if getattr(outcome, name) is None else getattr(outcome, name)
        assert np.array_equal(getattr(outcomes, name)[index], alone, equal_nan=True)


@pytest.mark.parametrize(("coupling", "robot"), CHAINS.values(), ids=CHAINS)
def test_every_row_equals_simulate_to_the_bit(coupling, robot):
    masses, speeds = np.array([[0.1], [1.0]]), np.array([0.4, 0.9, 1.3])
    outcomes = ig.sweep(
        scene(1e4, 0.5, coupling, robot), MOTION, {"object.mass": masses, "motion.speed": speeds}, duration=1.1
    )
    assert outcomes.object_velocity.shape == (2, 3)
    for i, j in np.ndindex(2, 3):
        one = scene(1e4, 0.5, coupling, robot, m_p=masses[i, 0])
        assert_row(outcomes, (i, j), ig.simulate(one, dataclasses.replace(MOTION, speed=speeds[j]), duration=1.1))


def changed(record, name, value):
    """The record with one of its fields, or a field of that, replaced."""
    field, _, rest = name.partition(".")
    return dataclasses.replace(record, **{field: changed(getattr(record, field), rest, value) if rest else value})


@pytest.mark.parametrize(
    ("template", "name", "values"),
    [
        (scene(1e4, 0.5, ig.Bistable()), "coupling.height", [0.02, 0.028, 0.035]),
        (scene(1e4, 0.5, ig.Bistable()), "coupling.front_stop", [0.01, 0.0208]),
        (scene(1e4, 0.5, SPRING), "coupling.damping_ratio", [0.0, 1.0, 2.0]),
        (scene(1e4, 0.5, SPRING), "coupling.stiffness", [50.0, 90.0]),
        (scene(1e4, robot=ROBOT), "robot.stiffness", [1e4, 1e5]),
        (scene(1e4), "contact.restitution", [0.05, 1.0]),
        (scene(1e4, dissipation="exact"), "contact.stiffness_exponent", [1.5, 2.0]),
        (scene(1e4, 0.5, SPRING), "motion.brake.delay", [0.0, 0.03]),
        (scene(1e4), "tool.mass", [0.1, 0.2]),
        (scene(1e4), "object.friction", [0.0, 0.3, 0.6]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_any_number_of_the_records_can_be_varied(template, name, values):
    outcomes = ig.sweep(template, MOTION, {name: values})
    for index, value in enumerate(values):
        moved = name.startswith("motion.")
        one = template if moved else changed(template, name, value)
        outcome = ig.simulate(one, changed(MOTION, name.removeprefix("motion."), value) if moved else MOTION)
        if name == "contact.stiffness_exponent":  # the sweep has one contact law for all its rows
            assert outcomes.object_velocity[index] == pytest.approx(outcome.object_velocity, rel=1e-8)
        else:
            assert_row(outcomes, index, outcome)
    without_effect = ("tool.mass", "object.friction")  # imposed: its mass is nothing; it slides afterwards
    assert len(set(outcomes.object_velocity.tolist())) > 1 or name in without_effect


def test_neither_threads_nor_order_change_a_row():
    template, varied = scene(1e4, 0.5, SPRING), {"contact.stiffness": np.geomspace(1e3, 1e7, 200)}
    one, many = (ig.sweep(template, MOTION, varied, threads=n) for n in (1, 7))
    back = ig.sweep(template, MOTION, {"contact.stiffness": varied["contact.stiffness"][::-1]}, threads=3)
    for field in dataclasses.fields(ig.Outcomes):
        first = getattr(one, field.name)
        for other in (getattr(many, field.name), getattr(back, field.name)[::-1]):
            assert np.array_equal(first, other, equal_nan=first.dtype.kind == "f")


def test_a_row_that_cannot_finish_says_why_and_spoils_no_other(monkeypatch):
    monkeypatch.setattr(sweeps, "MAX_STEPS", 100)
    damping = np.array([1.0, 1e5, 0.5])  # 1e5: stiff, and takes more than twice as many steps
    outcomes = ig.sweep(scene(1e4, 0.5, SPRING), MOTION, {"coupling.damping_ratio": damping})
    assert outcomes.status[1] != "ok"
    assert "steps" in outcomes.status[1]
    assert np.isnan([outcomes.object_velocity[1], outcomes.sliding_distance[1]]).all()
    for index in (0, 2):
        assert_row(outcomes, index, ig.simulate(scene(1e4, 0.5, ig.SpringDamper(150.0, damping[index])), MOTION))


def test_no_rows_are_no_rows():
    assert ig.sweep(scene(1e4), MOTION, {"object.mass": []}).object_velocity.shape == (0,)
    assert ig.sweep(scene(1e4), MOTION, {}).object_velocity.shape == ()


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
        ig.sweep(scene(1e4), MOTION, varied)


@pytest.mark.parametrize(
    ("bad", "named"),
    [
        ({"scene": 1}, "scene"),
        ({"motion": None}, "motion"),
        ({"varied": [1]}, "varied"),
        ({"threads": 1.5}, "threads"),
        ({"rtol": "1e-3"}, "rtol"),
        ({"varied": {"object.mass": ["0.1"]}}, r"Object\.mass"),
    ],
)
def test_bad_arguments_are_named(bad, named):
    with pytest.raises(TypeError, match=named):
        ig.sweep(**{"scene": scene(1e4), "motion": MOTION, "varied": {}} | bad)
