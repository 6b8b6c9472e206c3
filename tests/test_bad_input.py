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
ROBOT = ig.Robot(5.225, 1.9e5, 50.4)
TINY = 5e-324


def with_field(record, field):
    return lambda value: dataclasses.replace(record, **{field: value})


def argument(name):
    return lambda value: ig.simulate(SCENE, **{"motion": MOTION} | {name: value})


POSITIVE = (TINY, 1e300), (0, 0.0, -0.0, -TINY, -1)
NOT_NEGATIVE = (0, -0.0, TINY, 1e300), (-TINY, -1)
FIELDS = [  # record, field, unit, values in range, values out of range
    (SCENE.tool, "mass", "kg", *POSITIVE),
    (SCENE.object, "mass", "kg", *POSITIVE),
    (SCENE.object, "distance", "m", *POSITIVE),
    (SCENE.object, "friction", "(no unit)", *NOT_NEGATIVE),
    (SCENE.contact, "stiffness", "N/m^1.5", *POSITIVE),
    (SCENE.contact, "restitution", "(no unit)", (1e-9, 1), (0, -1, 1 + 1e-15, 2)),
    (SCENE.contact, "stiffness_exponent", "(no unit)", (1, 10), (0.99, 0, 11)),
    (SCENE.contact, "damping_exponent", "(no unit)", (0, 1, 10), (-1, 0.5, 11)),
    (SCENE.coupling, "stiffness", "N/m", *POSITIVE),
    (SCENE.coupling, "damping_ratio", "(no unit)", (0, -0.0, TINY, 1e6), (-TINY, 2e6)),
    (ig.Bistable(), "stiffness", "N/m", *POSITIVE),
    (ig.Bistable(), "stop_stiffness", "N/m", *POSITIVE),
    (ROBOT, "mass", "kg", *POSITIVE),
    (ROBOT, "stiffness", "N/m", *POSITIVE),
    (ROBOT, "damping", "N s/m", *NOT_NEGATIVE),
    (MOTION, "speed", "m/s", *POSITIVE),
    (MOTION, "acceleration", "m/s^2", *POSITIVE),
    (MOTION.brake, "threshold", "N", *NOT_NEGATIVE),
    (MOTION.brake, "delay", "s", *NOT_NEGATIVE),
    (MOTION.brake, "deceleration", "m/s^2", *POSITIVE),
]
# name in the message, what takes the value, unit, values in range, values out of range
NUMBERS = [(f"{type(record).__name__}.{field}", with_field(record, field), *rest) for record, field, *rest in FIELDS]
NUMBERS += [
    ("duration", argument("duration"), "s", (1e-3, 1), (0, -1)),
    ("rtol", argument("rtol"), "(no unit)", (1e-13, 1e-2), (0, -1e-6, 9e-14, 0.011)),
]
NOT_FINITE = (math.nan, math.inf, -math.inf, np.float32("nan"), np.inf)
NO_NUMBERS = (None, True, False, "1", b"1", "", [1.0], (1.0,), {}, 1j, object(), SCENE)
EVERY_NUMBER = pytest.mark.parametrize(
    ("name", "make", "unit", "good", "bad"), NUMBERS, ids=[row[0] for row in NUMBERS]
)


@EVERY_NUMBER
def test_a_number_out_of_range_or_not_finite_is_refused_with_its_name_value_and_unit(name, make, unit, good, bad):
    for says, values in (("finite", NOT_FINITE), ("above|at least|at most", bad)):
        for value in values:
            with pytest.raises(ValueError, match=says) as raised:
                make(value)
            assert name in str(raised.value)
            assert f"got {float(value)!r} {unit}" in str(raised.value)


@EVERY_NUMBER
def test_what_is_no_number_is_refused_with_its_name_and_unit(name, make, unit, good, bad):
    for value in NO_NUMBERS:
        if name == "Brake.deceleration" and value is None:
            continue  # the acceleration of the trapezoid
        with pytest.raises(TypeError) as raised:
            make(value)
        assert name in str(raised.value)
        assert f"a number in {unit}, got {value!r}" in str(raised.value)


@EVERY_NUMBER
def test_the_ends_of_a_range_belong_to_it_and_whatever_is_a_number_is_stored_as_a_float(name, make, unit, good, bad):
    field = name.split(".")[-1]
    for value in good:
        made = make(value)
        assert "." not in name or getattr(made, field) == value
    for one in (1, 1.0, np.int64(1), np.uint8(1), np.float32(1), np.float64(1), Fraction(1)) if "." in name else ():
        made = make(one)
        assert type(getattr(made, field)) is float
        assert made == make(1.0)


@pytest.mark.parametrize(
    "value",
    [np.True_, np.complex128(1), np.array([1.0]), np.array([1.0, 2.0]), np.array(["1"]), 10**400, Decimal("sNaN")],
    ids=lambda value: f"{type(value).__name__} {value}"[:30],
)
def test_what_only_looks_like_a_number_is_refused_with_its_name(value):
    with pytest.raises((TypeError, ValueError), match=r"Tool\.mass"):
        ig.Tool(value)


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


NO_RECORDS = (None, 1.0, "rigid", ig.Tool, MOTION)
NO_ROBOTS = (1.0, "robot", SCENE.tool, False, {"mass": 5.0}, ig.Rigid())
DISSIPATIONS = (None, 1, "Hu-Guo", "huntcrossley", b"hu-guo", ["hu-guo"])


@pytest.mark.parametrize(
    ("make", "says", "values"),
    [
        (with_field(SCENE, "tool"), r"Scene\.tool must be a Tool", (*NO_RECORDS, SCENE.object)),
        (with_field(SCENE, "object"), r"Scene\.object must be a", NO_RECORDS),
        (with_field(SCENE, "contact"), r"Scene\.contact must be a", NO_RECORDS),
        (with_field(SCENE, "coupling"), r"Scene\.coupling must be a", NO_RECORDS),
        (with_field(SCENE, "robot"), r"Scene\.robot must be a Robot or RobotTable or None", NO_ROBOTS),
        (with_field(SCENE.contact, "dissipation"), r"Contact\.dissipation .*hu-guo", DISSIPATIONS),
        (with_field(MOTION, "brake"), r"Trapezoid\.brake must be a Brake", (1.0, "now", True, MOTION)),
        (lambda value: ig.simulate(value, MOTION), "scene must be a Scene", (None, 1.0, "scene", SCENE.tool, MOTION)),
        (argument("motion"), "motion must be a Trapezoid", (None, 1.0, "motion", SCENE, MOTION.brake)),
    ],
)
def test_what_is_not_of_its_kind_is_refused_with_its_name_and_the_kind(make, says, values):
    for value in values:
        with pytest.raises((TypeError, ValueError) if values is DISSIPATIONS else TypeError, match=says):
            make(value)


def test_a_brake_without_deceleration_has_that_of_the_trapezoid():
    assert ig.Trapezoid(1.0, 5.0, ig.Brake(deceleration=None)).deceleration == 5.0
    assert ig.Trapezoid(1.0, 5.0, ig.Brake(deceleration=3.0)).deceleration == 3.0
    assert dataclasses.astuple(ig.Brake()) == (1.0, 0.016, None)


def test_a_motion_too_short_to_reach_the_object_ends_in_no_contact():
    outcome = ig.simulate(SCENE, MOTION, 0.3)
    assert (outcome.contacts, outcome.detection_time, outcome.object_velocity) == ((), None, 0.0)
    assert (outcome.peak_force, outcome.coupling_impulse, outcome.momentum_error, outcome.status) == (0, 0, 0, "ok")
