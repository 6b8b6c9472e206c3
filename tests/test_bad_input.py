"""What the border lets in, and how it says no: the field, the value, the unit."""

import copy
import dataclasses
import importlib
import pkgutil
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

import impact_gym as ig

SCENE = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.2505), ig.Contact(1e5, 0.5), ig.SpringDamper(150.0))
MOTION = ig.Trapezoid(1.0, 8.0, ig.Brake())


def with_field(record, field):
    return lambda value: dataclasses.replace(record, **{field: value})


def argument(name):
    return lambda value: ig.simulate(SCENE, **{"motion": MOTION} | {name: value})


@pytest.mark.parametrize("value", [
    None, "", [1.0], (1.0,), {}, SCENE, np.array([1.0]), np.array([1.0, 2.0]), np.array(["1"]), Decimal("sNaN"),
], ids=lambda value: f"{type(value).__name__} {value}"[:30])  # fmt: skip
def test_record_refuses_what_only_looks_like_a_number_with_its_name(value):
    """All else that every number is refused for is tested with the table, in tests/task."""
    with pytest.raises((TypeError, ValueError), match=r"Tool\.mass"):
        ig.Tool(value)


@pytest.mark.parametrize("number", [1, np.int64(1), np.uint8(1), np.float32(1), np.float64(1), Fraction(1)], ids=repr)
def test_record_and_argument_take_any_number_as_a_float(number):
    tool = ig.Tool(number)
    assert type(tool.mass) is float
    assert tool == ig.Tool(1.0)
    assert ig.simulate(SCENE, MOTION, number) == ig.simulate(SCENE, MOTION, 1.0)


def test_contact_refuses_a_damping_exponent_between_none_and_one():
    with pytest.raises(ValueError, match=r"Contact.damping_exponent must be 0 or at least 1 .*got 0\.5"):
        dataclasses.replace(SCENE.contact, damping_exponent=0.5)


def test_classes_of_records_are_frozen_but_the_model_that_counts_its_simulations():
    modules = (importlib.import_module(name) for _, name, _ in pkgutil.walk_packages(ig.__path__, "impact_gym."))
    classes = {thing for module in modules for thing in vars(module).values() if dataclasses.is_dataclass(thing)}
    changeable = {kind.__module__ for kind in classes if not kind.__dataclass_params__.frozen}
    assert changeable == {"impact_gym.identify.model"}
    with pytest.raises(dataclasses.FrozenInstanceError):
        SCENE.tool.mass = 1.0
    for record in (SCENE, MOTION, ig.Rigid()):  # and all that is in these
        assert hash(record) == hash(copy.deepcopy(record))


NO_RECORDS = (None, 1.0, "rigid", ig.Tool, MOTION)
NO_ROBOTS = (1.0, "robot", SCENE.tool, False, {"mass": 5.0}, ig.Rigid())
DISSIPATIONS = (None, 1, "Hu-Guo", "huntcrossley", b"hu-guo", ["hu-guo"])


@pytest.mark.parametrize(("make", "says", "values"), [
    (with_field(SCENE, "tool"), r"Scene\.tool must be a Tool", (*NO_RECORDS, SCENE.object)),
    (with_field(SCENE, "object"), r"Scene\.object must be a", NO_RECORDS),
    (with_field(SCENE, "contact"), r"Scene\.contact must be a", NO_RECORDS),
    (with_field(SCENE, "coupling"), r"Scene\.coupling must be a", NO_RECORDS),
    (with_field(SCENE, "robot"), r"Scene\.robot must be a Robot or RobotTable or None", NO_ROBOTS),
    (with_field(SCENE.contact, "dissipation"), r"Contact\.dissipation .*hu-guo", DISSIPATIONS),
    (with_field(MOTION, "brake"), r"Trapezoid\.brake must be a Brake", (1.0, "now", True, MOTION)),
    (lambda value: ig.simulate(value, MOTION), "scene must be a Scene", (None, 1.0, "scene", SCENE.tool, MOTION)),
    (argument("motion"), "motion must be a Trapezoid", (None, 1.0, "motion", SCENE, MOTION.brake)),
])  # fmt: skip
def test_record_refuses_what_is_not_of_its_kind_with_its_name_and_the_kind(make, says, values):
    for value in values:
        with pytest.raises((TypeError, ValueError) if values is DISSIPATIONS else TypeError, match=says):
            make(value)


def test_brake_without_deceleration_has_that_of_the_trapezoid():
    assert ig.Trapezoid(1.0, 5.0, ig.Brake(deceleration=None)).deceleration == 5.0
    assert ig.Trapezoid(1.0, 5.0, ig.Brake(deceleration=3.0)).deceleration == 3.0
    assert dataclasses.astuple(ig.Brake()) == (1.0, 0.016, None)


def test_motion_too_short_to_reach_the_object_ends_in_no_contact():
    outcome = ig.simulate(SCENE, MOTION, 0.3)
    assert (outcome.contacts, outcome.detection_time, outcome.object_velocity) == ((), None, 0.0)
    assert (outcome.peak_force, outcome.coupling_impulse, outcome.momentum_error, outcome.status) == (0, 0, 0, "ok")
