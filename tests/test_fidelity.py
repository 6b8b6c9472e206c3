"""Advice is what the runs say: the error of each simpler model, seen and not predicted."""

import math
from dataclasses import replace

import numpy as np
import pytest

import impact_gym as ig
from impact_gym.fidelity import advise

MOTION = ig.Trapezoid(1.0, 8.0, ig.Brake())
SPRUNG = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.25), ig.Contact(1e5, 0.5), ig.SpringDamper(150.0))
ROBOT = ig.Robot(mass=5.0, stiffness=1e5, damping=100.0)


def test_advise_leaves_out_a_robot_as_good_as_rigid_with_the_error_of_two_runs():
    scene = replace(SPRUNG, robot=replace(ROBOT, stiffness=1e9))
    advice = advise(scene, MOTION, 1e-3)
    full, simple = (ig.simulate(chain, MOTION).object_velocity for chain in (scene, SPRUNG))
    assert advice.model.name == "robot rigid"
    assert advice.model.errors.tolist() == [abs(simple - full) / full]
    assert advice.model.simplify(scene) == SPRUNG
    assert "robot rigid" in str(advice)


@pytest.mark.parametrize("quantity", ["object_velocity", "peak_force", "impulse"])
def test_advise_keeps_a_scene_of_which_every_part_matters(quantity):
    advice = advise(replace(SPRUNG, robot=ROBOT), MOTION, 1e-12, quantity)
    assert advice.model is advice.tried[0]
    assert advice.model.bound == 0.0
    assert all(model.bound > 1e-12 for model in advice.tried[1:])
    assert len(advice.tried) == 4  # the robot, the spring, both


def test_advise_on_a_sample_is_as_good_as_its_worst_scene():
    scenes = [replace(SPRUNG, robot=replace(ROBOT, stiffness=stiffness)) for stiffness in (1e9, 1e4)]
    alone = [advise(scene, MOTION, 1e-3).tried[1].bound for scene in scenes]
    together = advise(scenes, MOTION, 1e-3).tried[1]
    assert np.array_equal(together.errors, alone)
    assert together.bound == max(alone)


def test_advise_leaves_nothing_out_where_there_is_nothing_and_an_object_out_of_reach_has_no_error():
    assert len(advise(replace(SPRUNG, coupling=ig.Rigid()), MOTION).tried) == 1
    far = advise(replace(SPRUNG, object=ig.Object(0.25, 100.0), robot=ROBOT), MOTION, 1e-9, duration=0.2)
    assert far.model.bound == 0.0


@pytest.mark.parametrize(("change", "message"), [
    ({"scenes": []}, "scenes must be a Scene or some of them"),
    ({"scenes": [1.0]}, "scene must be a Scene"),
    ({"motion": 1.0}, "motion must be a Trapezoid"),
    ({"tolerance": 0.0}, "tolerance must be"),
    ({"tolerance": math.nan}, "tolerance must be"),
    ({"quantity": "energy"}, "quantity must be one of object_velocity, peak_force, impulse"),
    ({"duration": -1.0}, "duration must be"),
])  # fmt: skip
def test_advise_names_bad_input(change, message):
    with pytest.raises((TypeError, ValueError), match=message):
        advise(**({"scenes": SPRUNG, "motion": MOTION} | change))
