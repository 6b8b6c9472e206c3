"""The robot's reduction against an independent kinematic chain and the laws it obeys; the table that is shipped."""

import dataclasses
import json
import re
import subprocess
import sys
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.optimize import root
from scipy.spatial.transform import Rotation
from viper_chain import (
    DATA,
    KINEMATICS,
    about,
    condition,
    denavit_hartenberg,
    frames,
    mass_matrix,
    point_jacobian,
    transform,
)

from impact_gym.robot import Arm, Line, Pose, approach, default_approach, description, follow, lumped
from impact_gym.robot import inverse_kinematics as ik
from impact_gym.robot.__main__ import main
from impact_gym.robot.line import angles_along

SOME_ANGLES = np.random.default_rng(0).uniform(*np.radians(KINEMATICS["limits_deg"]).T, size=(20, 6))
SHIPPED = default_approach()
EVERY_POSTURE = pytest.mark.parametrize("angles", SOME_ANGLES)


def assert_equal(one, other, tolerance):
    np.testing.assert_allclose(one, other, rtol=tolerance, atol=tolerance)


@pytest.fixture(scope="module")
def arm():
    pytest.importorskip("mujoco", reason="the extra robot is not installed")
    return Arm()


@EVERY_POSTURE
def test_urdf_and_denavit_hartenberg_and_mujoco_put_the_flange_at_one_place(arm, angles):
    expected = denavit_hartenberg(angles)
    assert_equal(frames(angles)[-1], expected, 1e-14)
    position, rotation = arm.flange(angles)
    assert_equal(np.column_stack([rotation, position]), expected[:3], 1e-14)


@EVERY_POSTURE
def test_jacobian_is_the_derivative_of_the_flange(arm, angles):
    h = 1e-6  # error h^2 of the formula and 1e-16/h of rounding: both below 1e-9
    for joint, step in enumerate(h * np.eye(6)):
        ahead, behind = frames(angles + step)[-1], frames(angles - step)[-1]
        turn = Rotation.from_matrix(ahead[:3, :3] @ behind[:3, :3].T).as_rotvec()
        rate = np.concatenate([ahead[:3, 3] - behind[:3, 3], turn]) / (2 * h)
        np.testing.assert_allclose(arm.jacobian(angles)[:, joint], rate, atol=1e-8)


@EVERY_POSTURE
def test_mass_matrix_is_that_of_the_links(arm, angles):
    M = arm.mass_matrix(angles)
    assert_equal(M, mass_matrix(angles), 1e-12)
    assert np.array_equal(M, M.T)
    assert np.linalg.eigvalsh(M)[0] > 0


def test_reach_is_that_of_the_data_sheet_and_damping_as_it_is_said_in_words():
    robot = description.viper_s650()
    assert float(re.search(r"beta = (\S+) s", DATA["joints"]["damping_rule"])[1]) == robot.damping_over_stiffness
    reach = KINEMATICS["link_lengths_m"]["a1"] + robot.wrist_distance(robot.stretched_elbow)
    assert reach == pytest.approx(KINEMATICS["reach_to_wrist_centre_m"], abs=5e-5)  # four digits are given
    for elbow in (1.0, 2.0, 4.0):
        places = frames([0.3, -0.7, elbow, 0, 0, 0])
        assert np.linalg.norm(places[4][:3, 3] - places[1][:3, 3]) == pytest.approx(robot.wrist_distance(elbow))


@pytest.mark.parametrize("angles", np.radians(SHIPPED.joint_angles[::19]))
def test_reduction_is_energy_and_force_along_x(arm, angles):
    result = lumped.along_x(arm, angles)
    J, M, K = point_jacobian(angles, frames(angles)[-1][:3, 3], 6), mass_matrix(angles), arm.description.joint_stiffness
    rates = np.linalg.solve(J, np.eye(6)[0])  # the flange moves along x at 1 m/s and in no other way
    assert result.mass == pytest.approx(rates @ M @ rates, rel=1e-12)  # twice its kinetic energy
    assert result.stiffness == pytest.approx(rates @ (K * rates), rel=1e-12)  # the force that holds it 1 m off
    assert result.damping == pytest.approx(arm.description.damping_over_stiffness * result.stiffness, rel=1e-12)
    torques = J.T @ np.eye(6)[0]  # a force or an impulse along x, nothing else
    assert result.effective_mass == pytest.approx(1 / (J[0] @ np.linalg.solve(M, torques)), rel=1e-12)
    assert result.effective_stiffness == pytest.approx(1 / (J[0] @ (torques / K)), rel=1e-12)
    assert result.effective_mass <= result.mass
    assert result.effective_stiffness <= result.stiffness
    whole = lumped.cartesian(J, M)
    np.testing.assert_allclose(whole, np.linalg.inv(J).T @ M @ np.linalg.inv(J), rtol=1e-10, atol=1e-12)
    assert 1 / np.linalg.inv(whole)[0, 0] == pytest.approx(result.effective_mass, rel=1e-9)


def in_the_plane(arm, x, z, orientation):
    """The robot along x with its flange there, in the plane of the arm."""
    return lumped.along_x(arm, ik.solve(arm, Pose(x, 0.0, z, orientation)))


def test_in_the_plane_of_the_arm_the_orientation_of_the_tool_does_not_matter(arm):
    flange = DATA["kinematics"]["link_lengths_m"]["d6"]
    down = in_the_plane(arm, 0.5, 0.3 - flange, "down")
    horizontal = in_the_plane(arm, 0.5 + flange, 0.3, "horizontal")
    assert (horizontal.mass, horizontal.stiffness) == pytest.approx((down.mass, down.stiffness), rel=1e-10)


def test_a_robot_softer_at_the_impact_cannot_come_from_as_far_in_the_plane_of_the_arm(arm):
    def misfit(place):
        at_impact = in_the_plane(arm, *place, "horizontal")
        return at_impact.mass / 5.225 - 1, at_impact.stiffness / 1.5e5 - 1

    found = root(misfit, (0.57, 0.31))
    assert np.max(np.abs(found.fun)) < 1e-9
    with pytest.raises(ValueError, match=r"cannot reach x = 0\.3\d+ m, y = 0 m, .*horizontal"):
        angles_along(arm, Line(Pose(found.x[0], 0.0, found.x[1], "horizontal"), ahead=0.28))


@pytest.mark.parametrize("orientation", ["down", "horizontal"])
@pytest.mark.parametrize("y", [-0.2, 0.0, 0.1])
def test_inverse_kinematics_takes_the_flange_there(arm, y, orientation):
    angles = ik.solve(arm, Pose(0.5, y, 0.25, orientation))
    reached = frames(angles)[-1][:3]
    pointing = {"down": (0, 0, -1), "horizontal": (1, 0, 0)}[orientation]
    assert_equal(reached[:, 1:].T, [(0, 1, 0), pointing, (0.5, y, 0.25)], 1e-10)
    assert angles[2] > arm.description.stretched_elbow
    lower, upper = np.radians(KINEMATICS["limits_deg"]).T
    assert np.all((lower < angles) & (angles < upper))


@pytest.mark.parametrize(
    ("place", "why"),
    [  # stretched, the wrist is a2 + hypot(a3, d4) = 0.5784 m from joint 2; here it would be hypot(0.745, 0.035) m
        ((0.9, 0.0, 0.3, "horizontal"), r"x = 0\.9 m, y = 0 m, z = 0\.3 m, tool horizontal.* 0\.5784 m.* 0\.7458 m"),
        # hypot(0.045, 0.035): joint 3 cannot fold that far
        ((0.2, 0.0, 0.3, "horizontal"), r"x = 0\.2 m, .* 0\.05701 m"),
        ((0.3, 0.0, 0.05, "horizontal"), r"x = 0\.3 m, .*-120 to 120.*deg"),  # joint 5 would have to turn farther
    ],
)
def test_poses_out_of_reach_are_refused(arm, place, why):
    with pytest.raises(ValueError, match=r"cannot reach " + why):
        ik.solve(arm, Pose(*place))


@pytest.mark.parametrize("place", [(0.42, 0.0, 0.1, "down"), (0.73, 0.0, 0.335, "horizontal")])
def test_poses_near_a_singularity_are_refused_with_what_is_wrong(arm, place):
    with pytest.raises(ValueError, match=r"too near a singularity") as refusal:
        ik.solve(arm, Pose(*place))
    pattern = r"(.*) is too near .* \((.*)\) deg the .* Jacobian is (\S+), allowed is at most (\S+)"
    pose, written, number, allowed = re.fullmatch(pattern, str(refusal.value)).groups()
    assert pose == str(Pose(*place))
    angles = np.radians([float(angle) for angle in written.split(", ")])
    flange = frames(angles)[-1][:3, 3]
    np.testing.assert_allclose(flange, place[:3], atol=1e-3)  # the angles are written to 0.01 deg
    assert float(number) == pytest.approx(condition(angles), rel=0.02)
    assert float(number) > float(allowed) == ik.MAX_CONDITION


@pytest.mark.parametrize("value", ["a", None, True, [1.0], float("nan"), float("inf")])
def test_bad_numbers_are_named(value):
    pose = Pose(0.5, 0.0, 0.3, "down")
    refused = {pose: ("x", "y", "z", "orientation"), Line(pose): ("ahead", "behind", "spacing", "impact")}
    refused[SHIPPED] = (*approach.COLUMNS, "joint_angles", "impact_travel", "y", "z")
    for record, field in ((record, field) for record, fields in refused.items() for field in fields):
        with pytest.raises((TypeError, ValueError), match=rf"{type(record).__name__}\.{field}"):
            dataclasses.replace(record, **{field: value})


def test_bad_angles_and_descriptions_are_named(arm):
    for angles in (None, "abcdef", np.zeros(5), [0, 0, 0, 0, 0, np.nan]):
        with pytest.raises((TypeError, ValueError), match="angles"):
            arm.jacobian(angles)
    with pytest.raises(TypeError, match=r"Arm\.description"):
        Arm("viper")
    with pytest.raises(ValueError, match=r"Approach\.impact_travel"):
        dataclasses.replace(SHIPPED, impact_travel=0.2506)


def test_the_shipped_approach_is_what_it_is_said_to_be():
    """A straight line in the arm's own plane, tool horizontal, elbow up, well within limits, and the paper's mass."""
    assert SHIPPED.mass[SHIPPED.impact_row] + 0.125 == pytest.approx(5.35, abs=1e-9)  # paper, section 3.2
    assert SHIPPED.stiffness[SHIPPED.impact_row] == pytest.approx(1.9e5, rel=1e-9)
    assert (SHIPPED.impact_travel, SHIPPED.y) == (0.2505, 0.0)
    assert SHIPPED.travel[-1] - SHIPPED.impact_travel > 0.016 + 1 / 16  # delay and brake from 1 m/s at 8 m/s^2
    limits = np.array(KINEMATICS["limits_deg"])
    assert np.min([SHIPPED.joint_angles - limits[:, 0], limits[:, 1] - SHIPPED.joint_angles]) > 10 - 1e-9
    for travel, angles in zip(SHIPPED.travel, np.radians(SHIPPED.joint_angles), strict=True):
        place = (SHIPPED.x[0] + travel, SHIPPED.y, SHIPPED.z)
        assert_equal(frames(angles)[-1], transform(about("y", np.pi / 2), place), 1e-10)
        assert condition(angles) < ik.MAX_CONDITION


def test_the_command_makes_the_shipped_table_again(arm, tmp_path, capsys):
    file = tmp_path / "again.json"
    main(["--out", str(file)])
    assert "5.2250" in capsys.readouterr().out
    again = approach.read(file)
    for name in (*approach.COLUMNS, "joint_angles"):
        assert_equal(getattr(again, name), getattr(SHIPPED, name), 1e-9)
    made, shipped = (json.loads(path.read_text(encoding="utf-8")) for path in (file, approach.SHIPPED))
    assert made["provenance"] == shipped["provenance"]
    assert [path.name for path in tmp_path.iterdir()] == ["again.json"]


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    file = tmp_path / "table.json"
    approach.write(file, SHIPPED, {"made_by": "a test"})
    copy = approach.read(file)
    assert all(np.array_equal(getattr(copy, name), getattr(SHIPPED, name)) for name in approach.COLUMNS)
    before = file.read_bytes()

    monkeypatch.setattr("os.replace", Mock(side_effect=OSError("no space left")))
    with pytest.raises(OSError, match="no space"):
        approach.write(file, SHIPPED, {})
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]


def test_robot_table_meets_the_robot_between_its_rows(arm):
    assert dataclasses.astuple(SHIPPED.robot_table().at(0.2505)) == pytest.approx(
        dataclasses.astuple(SHIPPED.at_impact()), rel=1e-12
    )
    impact = Pose(SHIPPED.x[SHIPPED.impact_row], SHIPPED.y, SHIPPED.z, SHIPPED.orientation)

    def worst(spacing):
        table, exact = (follow(arm, Line(impact, spacing=one)) for one in (spacing, spacing / 2))
        table = table.robot_table()
        return max(abs(table.at(x).mass / m - 1) for x, m in zip(exact.travel, exact.mass, strict=True))

    assert worst(0.0025) < 1e-4  # the shipped spacing: small beside what is unknown about the links
    assert worst(0.0025) < worst(0.005) / 2**3  # cubic splines


@pytest.mark.parametrize(
    "arguments",
    [["--x", "0.5"], ["--y", "0"], ["--x", "nan", "--z", "0.3"], ["--x", "0.9", "--z", "0.3"], ["--ahead", "1"]],
)
def test_the_command_refuses_in_one_line(arm, arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("python -m impact_gym.robot: error: ")


def test_all_but_the_calculation_works_without_mujoco():
    script = """
import sys
sys.modules["mujoco"] = None  # what import finds where it is not installed
import impact_gym.robot as robot
assert robot.default_approach().robot_table().at(0.2505).mass > 0
robot.Arm()
"""
    done = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, check=False)
    assert "pip install 'impact-gym[robot]'" in done.stderr.splitlines()[-1]
