"""What is no arm, no line, no place and no run of one is refused in one line that names field, value and unit."""

import math
import re
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from arms import SHOULDER, edited, joint, slides, two_links
from refusals import refused
from viper_chain import condition, frames

import impact_gym as ig
from impact_gym.robot import default_approach, from_urdf, whole
from impact_gym.robot.approach import COLUMNS
from impact_gym.robot.line import MAX_CONDITION
from impact_gym.robot.viper import angles_at, viper

pytest.importorskip("mujoco", reason="the extra robot is not installed")
ELASTIC = {"joint_stiffness": (9e3, 4e3), "joint_damping": (5.0, 2.0)}
SCENE = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.1), ig.Contact(1e5, 0.5))
MOTION = ig.Trapezoid(0.5, 8.0, ig.Brake())
SHIPPED, X = default_approach(), (1.0, 0.0, 0.0)
TABLE = ig.RobotTable((0.0, 0.1, 0.2, 0.3), (5.0,) * 4, (1e5,) * 4, (0.5, 0.4, 0.4, 0.5))  # falls to 0.3875 N s/m
MASS, NARROW = '<mass value="3.0"/>', lambda folder: edited(folder, SHOULDER, r'\1"0.2" upper="0.4"')
SIX = cache(viper)


def arm(folder, base="base", tip="tip", make=two_links, **options):
    return from_urdf(make(folder), base, tip, **ELASTIC | options)


def file(old, new):
    """A call with a piece of the file of two links exchanged."""
    return lambda folder: arm(folder, make=lambda there: edited(there, old, new))


def more(text):
    return file("</robot>", text + "</robot>")


def numbers(**options):
    return lambda folder: arm(folder, **options)


def line(start=(0.3, 0.9), direction=(-1.0, -0.2, 0.0), **options):
    return lambda folder: arm(folder, **options).along(start, direction, 0.2)


def viper_line(**change):
    upright = {"start": angles_at(SIX(), 0.5, 0.0, 0.25, "down"), "direction": X, "length": 0.1}
    return lambda folder: SIX().along(**upright | change)


def changed(record, **change):
    return lambda folder: replace(record, **change)


def blow(of=SCENE, line=lambda approach, folder: approach, **options):
    """A run of the two links."""

    def call(folder):
        made = arm(folder)
        approach = made.along((0.1, 1.6), (1.0, 0.5, 0.0), 0.2)
        given = {"arm": made, "approach": line(approach, folder), "scene": of, "motion": MOTION, "duration": 0.2}
        return whole.simulate(**given | options)

    return call


def of_slides(approach, folder):
    return arm(folder, make=slides, joint_stiffness=1e5).along((0.0, 0.0), (1.0, 0.5, 0.0), 0.2)


FILES = [  # which messages begin with the file's name
    (file('type="revolute"', 'type="floating"'), "joint 'shoulder' is floating, allowed are revolute, continuous,"),
    (more(joint("again", "fixed", "base", "fore")), "link 'fore' hangs on two joints, a loop"),
    (file('<parent link="upper"/>', '<parent link="up"/>'), "joint 'elbow' has the parent 'up', which is no link"),
    (file('(name="shoulder".*?)<limit', r'\1<mimic joint="elbow"/><limit'), "joint 'shoulder' mimics another"),
    (file(SHOULDER, r'\1"3" upper="-3"'), "joint 'shoulder' has limits of 3 and -3 rad, which must rise"),
    (file("<inertial>.*?</inertial>", ""), "joint 'shoulder' moves no mass"),
    (file(MASS, '<mass value="1e-30"/>'), "joint 'shoulder' moves no mass until the next one, 1e-30 kg"),
    (file(MASS, ""), "mass of upper must be a number in kg, got 'missing'"),
    (file(MASS, '<mass value="${m}"/>'), "mass of upper must be a number in kg, got '${m}'"),
    (file(MASS, '<mass value="-3"/>'), "mass of upper must be", "kg", "got -3.0"),
    (file(SHOULDER, r'\1"-3" upper="three"'), "upper limit of shoulder must be a number in rad, got 'three'"),
    (file('ixy="0" ', ""), "ixy of upper must be a number in kg m", "got 'missing'"),
    (file('xyz="0.5 0.0 0.0"|xyz="0.5 0 0"', 'xyz="nan 0 0"'), "xyz of elbow must be finite m, got nan"),
    (file('(<inertial>.*?xyz=")[^"]*', r"\1nan 0 0"), "xyz of upper must be finite m, got nan"),
    (file('xyz="0.5 0.0 0.0"|xyz="0.5 0 0"', 'xyz="0.5 0"'), "xyz of elbow must be 3 numbers in m, got '0.5 0'"),
    (file('(name="elbow".*?axis xyz=")0 0 1', r"\g<1>0 0 0"), "axis of elbow must not be 0 0 0"),
    (file('name="elbow"', 'name="shoulder"'), "two joints are called 'shoulder'"),
    (file('<link name="tip">', '<link name="upper"/><link name="tip">'), "two links are called 'upper'"),
    (file('<joint name="elbow"', "<joint"), "a joint has no name"),
    (more(joint("back", "fixed", "tip", "world")), "link 'world' hangs on itself, a loop"),
    (more(joint("self", "fixed", "world", "world")), "link 'world' hangs on itself, a loop"),
    (file('type="fixed"', 'type="floating"'), "the base 'base' is not fixed: joint 'held' above it is floating"),
    (more("<xacro:include/>"), "a xacro, turn it into a URDF first"),
    (more('<x:include xmlns:x="http://ros.org/wiki/xacro"/>'), "a xacro, turn it into a URDF first"),
    (file('ixx="0.0001"', 'ixx="-1"'), "link 'upper' has principal moments of inertia of -1, ", "kg m^2", "above 0"),
    (file('ixx="0.0001"', 'ixx="9"'), "link 'upper' has principal moments", "at most the sum of the others"),
    (file('ixx="0.0001"', 'ixx="nan"'), "ixx of upper must be", "kg m", "got nan"),
    (file("<robot ", "<sdf "), "no URDF that can be read"),
    (numbers(base="tip", tip="base"), "the tip 'base' is not below the base 'tip'"),
    (numbers(tip="hand"), "no link 'hand', there are ['base'"),
    (numbers(base="upper"), "an arm has two joints or more, between 'upper' and 'tip' there are 1"),
]
VALUES = [
    (numbers(joint_stiffness=(1.0, 2.0, 3.0)), "joint_stiffness must be a number or 2 of them", "N m/rad"),
    (numbers(joint_stiffness={"shoulder": 1e4, "elbow": 1e4}), "joint_stiffness must be a number in N m"),
    (numbers(joint_stiffness=0.0), "joint_stiffness must be", "above 0", "N m/rad", "got 0.0"),
    (numbers(joint_stiffness=(-1.0, 5.0)), "joint_stiffness[0] must be", "above 0", "got -1.0"),
    (numbers(joint_stiffness=math.nan), "joint_stiffness must be", "got nan"),
    (numbers(joint_stiffness=((3.0, 2.0), (1.0, 2.0))), "joint_stiffness must have pairs that rise"),
    (numbers(joint_damping=-1.0), "joint_damping must be", "N m s/rad", "got -1.0"),
    *[(numbers(**{name: value}), name) for name in ("gear", "rotor_inertia") for value in ("", (), False, -1.0)],
    (numbers(gear=0.0), "gear must be", "above 0", "got 0.0"),
    (line((0.0, 0.5), X), "too near a singularity", "condition number", "joint 'elbow'"),
    (line(make=NARROW), "joint 'shoulder' would be at ", " rad, its limits are 0.2 and 0.4 rad"),
    (line(joint_stiffness=9.0), "the stiffness is", "N/m", "is joint_stiffness in N m/rad?"),
    (line((0.0,), X, make=slides, joint_stiffness=1e5), "angles must be 2 numbers"),
    *[(line(direction=u), "direction") for u in ((0.0, 0.0, 0.0), (math.nan, 0.0, 0.0), (1.0, 0.0), "ab")],
    (lambda _: angles_at(SIX(), 0.9, 0.0, 0.3, "horizontal"), "x = 0.9 m, y = 0 m, z = 0.3 m: ", "misses it by"),
    (lambda _: angles_at(SIX(), 0.3, 0.0, 0.05, "horizontal"), "cannot reach x = 0.3 m", "-2.094 and 2.094 rad"),
    *[(lambda _, q=q: SIX().jacobian(q), "angles") for q in (None, "abcdef", np.zeros(5), [0.0] * 5 + [math.nan])],
    *[(viper_line(start=q), name) for q, name in ((None, "start"), (np.zeros(5), "angles must be 6"))],
    *[(viper_line(direction=u), "direction") for u in ((0, 0, 0), (math.nan, 0, 0), (1, 0))],
    *[(viper_line(length=length), "length must be", " m") for length in (0.0, math.nan, "far")],
    (viper_line(length=(-0.01, 0.0, 0.01, 0.02)), "length[0] must be", "at least 0 and at most 4 m, got -0.01 m"),
    (viper_line(length=(0.02, 0.01, 0.0, 0.03)), "Approach.position must be at least 4 numbers in m rising from 0"),
    *[(changed(SHIPPED, joint_angles=SHIPPED.joint_angles[part]), "Approach.joint_angles", "rows of 6 numbers in rad")
      for part in (np.s_[:-1], np.s_[:, :-1])],
    *[(changed(SHIPPED, **{name: value}), f"Approach.{name}")
      for name in (*COLUMNS, "joint_angles", "start", "direction", "chosen")
      for value in ("a", None, True, [1.0], math.nan, math.inf)],
    (lambda _: SHIPPED.robot_table("light"), "mass must be", "'held'", "'light'"),
    (changed(TABLE, position=(0.0, 0.2, 0.1, 0.3)), "RobotTable.position"),
    (changed(TABLE, position=(0.0, 0.1, 0.2)), "RobotTable.position"),
    (changed(TABLE, position=(0.0, 0.1, 0.2, math.nan)), "RobotTable.position[3]", " m"),
    (changed(TABLE, mass=(5.0, 5.0, 5.0)), "RobotTable.mass"),
    (changed(TABLE, mass=(5.0, 0.0, 5.0, 5.0)), "RobotTable.mass[1]", "kg"),
    (changed(TABLE, mass=(9.0, 0.1, 9.0, 0.1)), "RobotTable.mass must stay positive"),
    (changed(TABLE, damping=(50.0, -1.0, 50.0, 50.0)), "RobotTable.damping[1]", "N s/m"),
    (blow(replace(SCENE, robot=ig.Robot(5.0, 1e5, 10.0))), "scene.robot"),
    (blow(replace(SCENE, object=ig.Object(0.25, 0.1, friction=0.3))), "object.friction"),
    (blow(replace(SCENE, object=ig.Object(0.25, 0.3))), "object.distance is 0.3 m, but the line ends after 0.2 m"),
    (blow(replace(SCENE, contact=ig.Contact(1e5, 0.5, "exact", damping_exponent=1.0))), "damping_exponent"),
    (blow(servo=whole.Servo()), "rotor_inertia, in kg m^2"),
    (blow(duration=-1.0), "duration", " s, got -1.0"),
    (blow(most_evaluations=0), "most_evaluations must be", "at least 1"),
    *[(blow(rtol=value), "rtol must be") for value in (0.0, math.nan, 1.0, None, 1e-20)],
    *[(blow(**{name: 5}), f"{name} must be") for name in ("arm", "approach", "scene", "motion", "servo", "gravity")],
    (blow(line=lambda approach, _: replace(approach, start=approach.start + 0.01)), "approach must be of this arm"),
    (blow(line=of_slides), "approach must be of this arm"),
]  # fmt: skip
TYPES = [
    *[(changed(TABLE, stiffness=value), "RobotTable.stiffness") for value in ("1e5", None)],
    (changed(TABLE, damping=(50.0, "1", 50.0, 50.0)), "RobotTable.damping[1]"),
    *[(lambda _, pair=pair: ig.advise(SCENE, MOTION, arm=pair), "arm must be a pair, an Arm and its Approach")
      for pair in (5, (SHIPPED, SHIPPED), (SHIPPED,), [SHIPPED, SHIPPED])],
]  # fmt: skip
REFUSED = [(ValueError, *row) for row in FILES + VALUES] + [(TypeError, *row) for row in TYPES]


@pytest.mark.parametrize(("error", "call", "words"), [(error, call, words) for error, call, *words in REFUSED],
                         ids=[row[2] for row in REFUSED])  # fmt: skip
def test_refusal_names_the_field_the_value_and_the_unit_in_one_line(error, call, words, tmp_path):
    says = refused(partial(call, tmp_path), *words)
    assert isinstance(says, error)
    assert str(says).startswith(str(tmp_path / "arm.urdf")) == (words in [rest for _, *rest in FILES])


@pytest.mark.parametrize("place", [(0.42, 0.0, 0.1, "down"), (0.73, 0.0, 0.335, "horizontal")])
def test_pose_near_a_singularity_is_refused_with_its_condition_number(place):
    with pytest.raises(ValueError, match="too near a singularity") as refusal:
        angles_at(SIX(), *place)
    pattern = r"x = (\S+) m, .* z = (\S+) m is too near .* at \[(.*)\] the .* is (\S+), allowed is at most (\S+); .*"
    x, z, written, number, allowed = re.fullmatch(pattern, str(refusal.value)).groups()
    assert (float(x), float(z)) == (place[0], place[2])
    angles = [float(angle) for angle in written.split()]
    np.testing.assert_allclose(frames(angles)[-1][:3, 3], place[:3], atol=1e-3)  # written to 0.0001 rad
    assert float(number) == pytest.approx(condition(angles), rel=0.02)
    assert float(number) > float(allowed) == MAX_CONDITION
