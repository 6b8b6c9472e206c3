"""The robot's reduction, compared with an independent kinematic chain and laws; the shipped table."""

import dataclasses
import json
import re
import subprocess
import sys

import numpy as np
import pytest
import viper_chain as viper

from impact_gym.robot import IMPACT, approach, default_approach, joint_angles
from impact_gym.robot import viper as vipers
from impact_gym.robot.arm import MAX_CONDITION
from impact_gym.robot.viper import angles_at, write_default_approach

SOME_ANGLES = np.random.default_rng(0).uniform(*np.radians(viper.KINEMATICS["limits_deg"]).T, size=(20, 6))
SHIPPED, X = default_approach(), (1.0, 0.0, 0.0)


def assert_equal(ours, expected, tolerance):
    np.testing.assert_allclose(ours, expected, rtol=tolerance, atol=tolerance)


@pytest.fixture(scope="module")
def arm():
    pytest.importorskip("mujoco", reason="the extra robot is not installed")
    return vipers.viper()


def test_flange_jacobian_and_mass_matrix_are_those_of_the_chain(arm):
    for angles in SOME_ANGLES:
        (position, rotation), M = arm.flange(angles), arm.mass_matrix(angles)
        assert_equal(np.column_stack([rotation, position]), viper.frames(angles)[-1][:3], 1e-14)
        assert_equal(arm.jacobian(angles), viper.point_jacobian(angles, position, 6), 1e-14)
        assert_equal(M, viper.mass_matrix(angles), 1e-12)
        assert np.array_equal(M, M.T)
        assert arm.condition(angles) == pytest.approx(viper.condition(angles), rel=1e-9)


def test_file_has_the_numbers_of_the_data(arm):
    joints = viper.DATA["joints"]
    assert float(re.search(r"beta = (\S+) s", joints["damping_rule"])[1]) == vipers.DAMPING_OVER_STIFFNESS
    assert list(vipers.STIFFNESS) == joints["stiffness_N_m_per_rad"]
    assert pytest.approx(viper.DATA["targets"]["m_r_at_impact_kg"]) == vipers.MASS_AT_IMPACT
    assert np.array_equal(np.column_stack([arm.lower, arm.upper]), np.radians(viper.KINEMATICS["limits_deg"]))
    assert arm.length == pytest.approx(viper.KINEMATICS["link_lengths_m"]["a2"])


def test_reduction_along_x_follows_from_energy_and_force(arm):
    for angles in SHIPPED.joint_angles[::19]:
        ours = arm.reduction(angles, X)
        J = viper.point_jacobian(angles, viper.frames(angles)[-1][:3, 3], 6)
        M, K = viper.mass_matrix(angles), arm.stiffness
        rates = np.linalg.solve(J, np.eye(6)[0])  # the flange moves along x at 1 m/s and in no other way
        torques = J.T @ np.eye(6)[0]  # a force or an impulse along x, nothing else
        stiffness = rates @ (K * rates)
        assert ours == pytest.approx({
            "held": rates @ M @ rates,  # twice the kinetic energy
            "stiffness": stiffness,  # the force at a deflection of 1 m
            "damping": vipers.DAMPING_OVER_STIFFNESS * stiffness,
            "effective": 1 / (J[0] @ np.linalg.solve(M, torques)),
            "effective_stiffness": 1 / (J[0] @ (torques / K)),
            "composite": viper.composite_mass(angles),
        }, rel=1e-12)  # fmt: skip
        assert ours["effective"] <= ours["held"]
        assert ours["effective_stiffness"] <= ours["stiffness"]


@pytest.mark.parametrize(("orientation", "pointing"), [("down", (0, 0, -1)), ("horizontal", (1, 0, 0))])
@pytest.mark.parametrize("y", [-0.2, 0.0, 0.1])
def test_joint_angles_put_the_flange_there(arm, y, orientation, pointing):
    angles = angles_at(arm, 0.5, y, 0.25, orientation)
    assert_equal(viper.frames(angles)[-1][:3][:, 1:].T, [(0, 1, 0), pointing, (0.5, y, 0.25)], 1e-10)
    assert angles[2] > 1.0  # the elbow is up
    lower, upper = np.radians(viper.KINEMATICS["limits_deg"]).T
    assert np.all((lower < angles) & (angles < upper))


def test_default_approach_is_straight_within_limits_and_has_the_papers_mass():
    assert SHIPPED.at(0.2505).mass + 0.125 == pytest.approx(5.35, abs=1e-9)  # paper, section 3.2
    assert SHIPPED.at(0.2505).stiffness == pytest.approx(1.9e5, rel=1e-9)
    assert (SHIPPED.chosen, SHIPPED.start[1]) == ("held", pytest.approx(0.0, abs=1e-15))
    assert SHIPPED.position[-1] - 0.2505 > 0.016 + 1 / 16  # delay and brake from 1 m/s at 8 m/s^2
    limits, turned = np.array(viper.KINEMATICS["limits_deg"]), np.degrees(SHIPPED.joint_angles)
    assert np.min([turned - limits[:, 0], limits[:, 1] - turned]) > 10 - 1e-9
    for travel, angles in zip(SHIPPED.position, SHIPPED.joint_angles, strict=True):
        place = np.add(SHIPPED.start, (travel, 0.0, 0.0))
        assert_equal(viper.frames(angles)[-1], viper.transform(viper.about("y", np.pi / 2), place), 1e-10)
        assert viper.condition(angles) < MAX_CONDITION


def test_shipped_table_is_reproduced_and_its_file_has_all_digits(arm, tmp_path):
    write_default_approach(file := tmp_path / "again.json")
    again, numbers = approach.read(file), (*approach.COLUMNS, "joint_angles")
    for name in numbers:
        assert_equal(getattr(again, name), getattr(SHIPPED, name), 1e-9)
    made, shipped = (json.loads(path.read_text(encoding="utf-8")) for path in (file, approach.SHIPPED))
    assert made["provenance"] == shipped["provenance"]
    assert made["chosen"] == shipped["chosen"] == "held"
    approach.write(file, SHIPPED, {"made_by": "a test"})
    assert all(np.array_equal(getattr(approach.read(file), name), getattr(SHIPPED, name)) for name in numbers)


def test_robot_table_meets_the_robot_between_its_rows(arm):
    table, row = SHIPPED.robot_table(), int(np.flatnonzero(SHIPPED.position == IMPACT)[0])
    at_impact = [column[row] for column in (SHIPPED.held, SHIPPED.stiffness, SHIPPED.damping)]
    assert dataclasses.astuple(SHIPPED.at(IMPACT)) == pytest.approx(at_impact, rel=1e-12)
    forward = viper.about("y", np.pi / 2)
    for row in [*range(0, len(SHIPPED.position) - 1, 3), len(SHIPPED.position) - 2]:
        middle = 0.5 * (SHIPPED.position[row] + SHIPPED.position[row + 1])
        angles = joint_angles(arm, np.add(SHIPPED.start, (middle, 0.0, 0.0)), forward, SHIPPED.joint_angles[row])
        # far smaller than the uncertainty of the links' inertia
        assert table.at(middle).mass == pytest.approx(arm.reduction(angles, X)["held"], rel=1e-4)


def test_arm_alone_needs_mujoco():
    script = """
import sys
sys.modules["mujoco"] = None  # as if it were not installed
import impact_gym.robot as robot
assert robot.default_approach().robot_table().at(0.2505).mass > 0
from impact_gym.robot.viper import viper
viper()
"""
    done = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, check=False)
    assert "pip install 'impact-gym[robot]'" in done.stderr.splitlines()[-1]
