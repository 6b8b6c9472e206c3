"""What the border lets in, and how it says no: the field, the value, the unit."""

import dataclasses
import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

import impact_gym as ig

SCENE = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.2505), ig.Contact(1e5, 0.5), ig.SpringDamper(150.0))
MOTION = ig.Trapezoid(1.0, 8.0, ig.Brake())
ROBOT = ig.Robot(5.225, 1.5e5, 53.75)
TINY = 5e-324


def with_field(record, field):
    return lambda value: dataclasses.replace(record, **{field: value})


def argument(name):
    return lambda value: ig.simulate(SCENE, MOTION, **{name: value})


# (name in the message, unit, what makes the record, values in range, values out of range)
POSITIVE = (TINY, 1e300), (0, 0.0, -0.0, -TINY, -1)
NOT_NEGATIVE = (0, -0.0, TINY, 1e300), (-TINY, -1)
NUMBERS = [
    ("Tool.mass", "kg", with_field(SCENE.tool, "mass"), *POSITIVE),
    ("Object.mass", "kg", with_field(SCENE.object, "mass"), *POSITIVE),
    ("Object.distance", "m", with_field(SCENE.object, "distance"), *POSITIVE),
    ("Contact.stiffness", "N/m^1.5", with_field(SCENE.contact, "stiffness"), *POSITIVE),
    ("Contact.restitution", "(no unit)", with_field(SCENE.contact, "restitution"), (1e-9, 1), (0, -1, 1 + 1e-15, 2)),
    ("SpringDamper.stiffness", "N/m", with_field(SCENE.coupling, "stiffness"), *POSITIVE),
    (
        "SpringDamper.damping_ratio",
        "(no unit)",
        with_field(SCENE.coupling, "damping_ratio"),
        (0, -0.0, TINY, 1e6),
        (-TINY, 2e6),
    ),
    ("Contact.stiffness_exponent", "(no unit)", with_field(SCENE.contact, "stiffness_exponent"), (1, 10), (0.9, 0, 11)),
    ("Contact.damping_exponent", "(no unit)", with_field(SCENE.contact, "damping_exponent"), (0, 1, 10), (-1, 11)),
    ("Bistable.stiffness", "N/m", with_field(ig.Bistable(), "stiffness"), *POSITIVE),
    ("Bistable.stop_stiffness", "N/m", with_field(ig.Bistable(), "stop_stiffness"), *POSITIVE),
    ("Robot.mass", "kg", with_field(ROBOT, "mass"), *POSITIVE),
    ("Robot.stiffness", "N/m", with_field(ROBOT, "stiffness"), *POSITIVE),
    ("Robot.damping", "N s/m", with_field(ROBOT, "damping"), *NOT_NEGATIVE),
    ("Trapezoid.speed", "m/s", with_field(MOTION, "speed"), *POSITIVE),
    ("Trapezoid.acceleration", "m/s^2", with_field(MOTION, "acceleration"), *POSITIVE),
    ("Brake.threshold", "N", with_field(MOTION.brake, "threshold"), *NOT_NEGATIVE),
    ("Brake.delay", "s", with_field(MOTION.brake, "delay"), *NOT_NEGATIVE),
    ("Brake.deceleration", "m/s^2", with_field(MOTION.brake, "deceleration"), *POSITIVE),
    ("duration", "s", argument("duration"), (1e-3, 1), (0, -1)),
    ("rtol", "(no unit)", argument("rtol"), (1e-13, 1e-2), (0, -1e-6, 9e-14, 0.011)),
]
NOT_FINITE = (math.nan, math.inf, -math.inf, np.float32("nan"), np.inf)
NO_NUMBERS = (None, True, False, "1", b"1", "", [1.0], (1.0,), {}, 1j, object(), SCENE)
NAMES = [name for name, *_ in NUMBERS]


@pytest.mark.parametrize(("name", "unit", "make"), [row[:3] for row in NUMBERS], ids=NAMES)
def test_a_number_that_is_not_finite_is_refused_with_its_name_value_and_unit(name, unit, make):
    for value in NOT_FINITE:
        with pytest.raises(ValueError, match="finite") as raised:
            make(value)
        assert name in str(raised.value)
        assert f"got {float(value)!r} {unit}" in str(raised.value)


@pytest.mark.parametrize(("name", "unit", "make"), [row[:3] for row in NUMBERS], ids=NAMES)
def test_what_is_no_number_is_refused_with_its_name_and_unit(name, unit, make):
    for value in NO_NUMBERS:
        if name == "Brake.deceleration" and value is None:
            continue  # the acceleration of the trapezoid
        with pytest.raises(TypeError) as raised:
            make(value)
        assert name in str(raised.value)
        assert f"a number in {unit}, got {value!r}" in str(raised.value)


@pytest.mark.parametrize(
    "value",
    [np.True_, np.complex128(1), np.array([1.0]), np.array([1.0, 2.0]), np.array(["1"]), 10**400, Decimal("sNaN")],
    ids=lambda value: f"{type(value).__name__} {value}"[:30],
)
def test_what_only_looks_like_a_number_is_refused_with_its_name(value):
    with pytest.raises((TypeError, ValueError), match=r"Tool\.mass"):
        ig.Tool(value)


@pytest.mark.parametrize(("name", "unit", "make", "_", "bad"), NUMBERS, ids=NAMES)
def test_a_number_out_of_range_is_refused_with_its_name_value_and_unit(name, unit, make, _, bad):
    for value in bad:
        with pytest.raises(ValueError, match=r"above|at least|at most") as raised:
            make(value)
        assert name in str(raised.value)
        assert f"got {float(value)!r} {unit}" in str(raised.value)


@pytest.mark.parametrize(("name", "unit", "make", "good", "_"), NUMBERS, ids=NAMES)
def test_the_ends_of_a_range_belong_to_it_or_not_as_said(name, unit, make, good, _):
    for value in good:
        made = make(value)
        if "." in name:
            assert getattr(made, name.split(".")[1]) == value


@pytest.mark.parametrize(
    ("name", "make"),
    [(name, make) for name, _, make, *_ in NUMBERS if "." in name],
    ids=[name for name in NAMES if "." in name],
)
def test_whatever_is_a_number_is_stored_as_a_float(name, make):
    ones = (1, 1.0, np.int64(1), np.uint8(1), np.float32(1), np.float64(1), Fraction(1))
    for one in ones:
        made = make(one)
        stored = getattr(made, name.split(".")[1])
        assert type(stored) is float
        assert made == make(1.0)


@pytest.mark.parametrize("duration", [1, np.float32(1), np.int64(1)])
def test_arguments_of_simulate_may_be_any_number(duration):
    assert ig.simulate(SCENE, MOTION, duration) == ig.simulate(SCENE, MOTION, 1.0)


@pytest.mark.parametrize(
    "record",
    [SCENE, SCENE.tool, SCENE.object, SCENE.contact, SCENE.coupling, ig.Rigid(), MOTION, MOTION.brake],
    ids=lambda record: type(record).__name__,
)
def test_a_record_cannot_be_changed(record):
    for field in dataclasses.fields(record):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(record, field.name, getattr(record, field.name))
    with pytest.raises((AttributeError, TypeError)):
        record.colour = "red"
    assert hash(record) == hash(dataclasses.replace(record))


@pytest.mark.parametrize("field", ["tool", "object", "contact", "coupling"])
@pytest.mark.parametrize("value", [None, 1.0, "rigid", ig.Tool, MOTION], ids=repr)
def test_a_scene_takes_records_only(field, value):
    with pytest.raises(TypeError, match=rf"Scene\.{field} must be a"):
        dataclasses.replace(SCENE, **{field: value})


def test_a_scene_takes_each_record_in_its_own_place():
    with pytest.raises(TypeError, match=r"Scene\.tool must be a Tool"):
        ig.Scene(SCENE.object, SCENE.tool, SCENE.contact)


@pytest.mark.parametrize("value", [5.35, "robot", SCENE.tool, False])
def test_a_robot_is_refused_as_long_as_there_is_none(value):
    with pytest.raises((TypeError, ValueError), match=r"Scene\.robot"):
        dataclasses.replace(SCENE, robot=value)


@pytest.mark.parametrize("value", [None, 1, "Hu-Guo", "huntcrossley", b"hu-guo", ["hu-guo"]])
def test_an_unknown_dissipation_is_refused_with_the_known_ones(value):
    with pytest.raises((TypeError, ValueError), match=r"Contact\.dissipation .*hu-guo"):
        dataclasses.replace(SCENE.contact, dissipation=value)


@pytest.mark.parametrize("value", [1.0, "now", True, MOTION])
def test_a_brake_is_a_brake(value):
    with pytest.raises(TypeError, match=r"Trapezoid\.brake must be a Brake"):
        dataclasses.replace(MOTION, brake=value)


@pytest.mark.parametrize("value", [None, 1.0, "scene", SCENE.tool, MOTION])
def test_simulate_takes_a_scene_first(value):
    with pytest.raises(TypeError, match="scene must be a Scene"):
        ig.simulate(value, MOTION)


@pytest.mark.parametrize("value", [None, 1.0, "motion", SCENE, MOTION.brake])
def test_simulate_takes_a_motion_second(value):
    with pytest.raises(TypeError, match="motion must be a Trapezoid"):
        ig.simulate(SCENE, value)


def test_a_brake_without_deceleration_has_that_of_the_trapezoid():
    assert ig.Trapezoid(1.0, 5.0, ig.Brake(deceleration=None)).deceleration == 5.0
    assert ig.Trapezoid(1.0, 5.0, ig.Brake(deceleration=3.0)).deceleration == 3.0
    assert dataclasses.astuple(ig.Brake()) == (1.0, 0.016, None)


def test_a_motion_too_short_to_reach_the_object_ends_in_no_contact():
    outcome = ig.simulate(SCENE, MOTION, 0.3)
    assert (outcome.contacts, outcome.detection_time, outcome.object_velocity) == ((), None, 0.0)
    assert (outcome.peak_force, outcome.coupling_impulse, outcome.momentum_error, outcome.status) == (0, 0, 0, "ok")
