"""The robot's reduction against an independent kinematic chain and the laws it obeys; the table that is shipped."""

import dataclasses
import json
import re
import subprocess
import sys
from unittest.mock import Mock

import numpy as np
import pytest
import viper_chain as viper
from impact_gym.robot.__main__ import main
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from impact_gym.robot import IMPACT, approach, default_approach, joint_angles
from impact_gym.robot import viper as vipers
from impact_gym.robot.line import MAX_CONDITION
from impact_gym.robot.viper import angles_at

SOME_ANGLES = np.random.default_rng(0).uniform(*np.radians(viper.KINEMATICS["limits_deg"]).T, size=(20, 6))
SHIPPED, X = default_approach(), (1.0, 0.0, 0.0)


def assert_equal(ours, expected, tolerance):
    np.testing.assert_allclose(ours, expected, rtol=tolerance, atol=tolerance)


@pytest.fixture(scope="module")
def arm():
    pytest.importorskip("mujoco", reason="the extra robot is not installed")
    return vipers.viper()


def test_flange_of_urdf_and_denavit_hartenberg_and_mujoco_is_one(arm):
    for angles in SOME_ANGLES:
        expected = viper.denavit_hartenberg(angles)
        assert_equal(viper.frames(angles)[-1], expected, 1e-14)
        position, rotation = arm.flange(angles)
        assert_equal(np.column_stack([rotation, position]), expected[:3], 1e-14)


def test_jacobian_is_the_derivative_of_the_flange(arm):
    h = 1e-6  # error h^2 of the formula and 1e-16/h of rounding: both below 1e-9
    for angles in SOME_ANGLES:
        for joint, step in enumerate(h * np.eye(6)):
            ahead, behind = viper.frames(angles + step)[-1], viper.frames(angles - step)[-1]
            turn = Rotation.from_matrix(ahead[:3, :3] @ behind[:3, :3].T).as_rotvec()
            rate = np.concatenate([ahead[:3, 3] - behind[:3, 3], turn]) / (2 * h)
            np.testing.assert_allclose(arm.jacobian(angles)[:, joint], rate, atol=1e-8)


def test_mass_matrix_is_that_of_the_links(arm):
    for angles in SOME_ANGLES:
        M = arm.mass_matrix(angles)
        assert_equal(M, viper.mass_matrix(angles), 1e-12)
        assert np.array_equal(M, M.T)
        assert np.linalg.eigvalsh(M)[0] > 0


def test_file_has_the_numbers_of_the_data(arm):
    joints = viper.DATA["joints"]
    assert float(re.search(r"beta = (\S+) s", joints["damping_rule"])[1]) == vipers.DAMPING_OVER_STIFFNESS
    assert list(vipers.STIFFNESS) == joints["stiffness_N_m_per_rad"]
    assert pytest.approx(viper.DATA["targets"]["m_r_at_impact_kg"]) == vipers.MASS_AT_IMPACT
    limits = np.radians(viper.KINEMATICS["limits_deg"])
    assert np.array_equal(np.column_stack([arm.lower, arm.upper]), limits)
    assert arm.length == pytest.approx(viper.KINEMATICS["link_lengths_m"]["a2"])


def test_along_x_is_energy_and_force_along_x(arm):
    for angles in SHIPPED.joint_angles[::19]:
        ours = arm.reduction(angles, X)
        J = viper.point_jacobian(angles, viper.frames(angles)[-1][:3, 3], 6)
        M, K = viper.mass_matrix(angles), arm.stiffness
        rates = np.linalg.solve(J, np.eye(6)[0])  # the flange moves along x at 1 m/s and in no other way
        torques = J.T @ np.eye(6)[0]  # a force or an impulse along x, nothing else
        stiffness = rates @ (K * rates)
        assert ours == pytest.approx({
            "held": rates @ M @ rates,  # twice its kinetic energy
            "stiffness": stiffness,  # the force that holds it 1 m off
            "damping": vipers.DAMPING_OVER_STIFFNESS * stiffness,
            "effective": 1 / (J[0] @ np.linalg.solve(M, torques)),
            "effective_stiffness": 1 / (J[0] @ (torques / K)),
            "composite": viper.composite_mass(angles),
        }, rel=1e-12)  # fmt: skip
        assert ours["effective"] <= ours["held"]
        assert ours["effective_stiffness"] <= ours["stiffness"]


def in_the_plane(arm, x, z, orientation):
    """Mass and stiffness along x with the flange there, in the plane of the arm."""
    ours = arm.reduction(angles_at(arm, x, 0.0, z, orientation), X)
    return np.array([ours["held"], ours["stiffness"]])


def test_along_x_does_not_depend_on_the_orientation_in_the_plane_of_the_arm(arm):
    flange = viper.DATA["kinematics"]["link_lengths_m"]["d6"]
    down = in_the_plane(arm, 0.5, 0.3 - flange, "down")
    assert in_the_plane(arm, 0.5 + flange, 0.3, "horizontal") == pytest.approx(down, rel=1e-10)


def test_along_refuses_a_longer_approach_to_a_robot_softer_at_the_impact(arm):
    place = root(lambda at: in_the_plane(arm, *at, "horizontal") / (5.225, 1.5e5) - 1, (0.57, 0.31))
    assert np.max(np.abs(place.fun)) < 1e-9
    with pytest.raises(
        ValueError, match=r"cannot reach x = 0\.3\d+ m, y = .*: joint 'joint 3' would be at .* 4\.468 rad"
    ):
        arm.along(angles_at(arm, place.x[0], 0.0, place.x[1], "horizontal"), (-1.0, 0.0, 0.0), 0.28)


@pytest.mark.parametrize(("orientation", "pointing"), [("down", (0, 0, -1)), ("horizontal", (1, 0, 0))])
@pytest.mark.parametrize("y", [-0.2, 0.0, 0.1])
def test_joint_angles_put_the_flange_there(arm, y, orientation, pointing):
    angles = angles_at(arm, 0.5, y, 0.25, orientation)
    assert_equal(viper.frames(angles)[-1][:3][:, 1:].T, [(0, 1, 0), pointing, (0.5, y, 0.25)], 1e-10)
    assert angles[2] > 1.0  # the elbow is up
    lower, upper = np.radians(viper.KINEMATICS["limits_deg"]).T
    assert np.all((lower < angles) & (angles < upper))


@pytest.mark.parametrize(
    ("place", "why"),
    [  # stretched, the wrist is a2 + hypot(a3, d4) = 0.5784 m from joint 2; here it would be hypot(0.745, 0.035) m
        ((0.9, 0.0, 0.3, "horizontal"), r"x = 0\.9 m, y = 0 m, z = 0\.3 m: the nearest that was found misses it by"),
        ((0.3, 0.0, 0.05, "horizontal"), r"x = 0\.3 m, .*: joint 'joint 5' would be at .* -2\.094 and 2\.094 rad"),
    ],
)
def test_joint_angles_refuse_a_pose_out_of_reach(arm, place, why):
    with pytest.raises(ValueError, match=r"cannot reach " + why):
        angles_at(arm, *place)


@pytest.mark.parametrize("place", [(0.42, 0.0, 0.1, "down"), (0.73, 0.0, 0.335, "horizontal")])
def test_joint_angles_refuse_a_pose_near_a_singularity(arm, place):
    with pytest.raises(ValueError, match=r"too near a singularity") as refusal:
        angles_at(arm, *place)
    pattern = r"x = (\S+) m, .* z = (\S+) m is too near .* at \[(.*)\] the .* is (\S+), allowed is at most (\S+); .*"
    x, z, written, number, allowed = re.fullmatch(pattern, str(refusal.value)).groups()
    assert (float(x), float(z)) == (place[0], place[2])
    angles = [float(angle) for angle in written.split()]
    np.testing.assert_allclose(viper.frames(angles)[-1][:3, 3], place[:3], atol=1e-3)  # written to 0.0001 rad
    assert float(number) == pytest.approx(viper.condition(angles), rel=0.02)
    assert float(number) > float(allowed) == MAX_CONDITION


@pytest.mark.parametrize("value", ["a", None, True, [1.0], float("nan"), float("inf")])
def test_records_name_bad_numbers(value):
    for field in (*approach.COLUMNS, "joint_angles", "start", "direction", "chosen"):
        with pytest.raises((TypeError, ValueError), match=rf"Approach\.{field}"):
            dataclasses.replace(SHIPPED, **{field: value})


def test_bad_angles_descriptions_and_places_are_named(arm):
    for angles in (None, "abcdef", np.zeros(5), [0, 0, 0, 0, 0, np.nan]):
        with pytest.raises((TypeError, ValueError), match="angles"):
            arm.jacobian(angles)
    upright = angles_at(arm, 0.5, 0.0, 0.25, "down")
    for name, value in (("start", None), ("start", upright[:5]), ("direction", (0, 0, 0)),
                        ("direction", (np.nan, 0, 0)), ("direction", (1, 0)), ("length", 0.0),
                        ("length", np.nan), ("length", "far")):  # fmt: skip
        with pytest.raises((TypeError, ValueError), match=f"{name}|angles must be 6"):
            arm.along(**{"start": upright, "direction": X, "length": 0.1} | {name: value})
    with pytest.raises(ValueError, match=r"Approach\.position must be at least 4 numbers in m rising from 0"):
        arm.along(upright, X, (0.02, 0.01, 0.0, 0.03))
    for part in (np.s_[:-1], np.s_[:, :-1]):
        with pytest.raises(ValueError, match=rf"joint_angles must be {len(SHIPPED.position)} rows of 6 numbers in rad"):
            dataclasses.replace(SHIPPED, joint_angles=SHIPPED.joint_angles[part])


def test_default_approach_is_straight_in_the_arms_plane_within_limits_and_has_the_papers_mass():
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


def test_main_makes_the_shipped_table_again(arm, tmp_path, capsys):
    file = tmp_path / "again.json"
    main(["--out", str(file)])
    printed = capsys.readouterr().out
    assert "5.2250" in printed
    assert re.search(r"^end +(\S+)", printed, re.M)[1] == f"{SHIPPED.position[-1]:.3f}"
    again = approach.read(file)
    for name in (*approach.COLUMNS, "joint_angles"):
        assert_equal(getattr(again, name), getattr(SHIPPED, name), 1e-9)
    made, shipped = (json.loads(path.read_text(encoding="utf-8")) for path in (file, approach.SHIPPED))
    assert made["provenance"] == shipped["provenance"]
    assert {name: made["line"][name] for name in ("chosen", "rule")} == {"chosen": "held", "rule": approach.NEAREST}
    assert [path.name for path in tmp_path.iterdir()] == ["again.json"]


def test_write_is_whole_or_not_at_all(tmp_path, monkeypatch):
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
    table, row = SHIPPED.robot_table(), int(np.flatnonzero(SHIPPED.position == IMPACT)[0])
    at_impact = [column[row] for column in (SHIPPED.held, SHIPPED.stiffness, SHIPPED.damping)]
    assert dataclasses.astuple(SHIPPED.at(IMPACT)) == pytest.approx(at_impact, rel=1e-12)
    coarse = arm.along(SHIPPED.joint_angles[0], X, [0.0, *SHIPPED.position[1::2]]).robot_table()
    rows = [*range(0, len(SHIPPED.position) - 1, 3), len(SHIPPED.position) - 2]

    def worst(table, places):
        forward = viper.about("y", np.pi / 2)
        near = zip(places, SHIPPED.joint_angles[rows], strict=True)
        angles = [joint_angles(arm, np.add(SHIPPED.start, (x, 0.0, 0.0)), forward, q) for x, q in near]
        masses = [arm.reduction(q, X)["held"] for q in angles]
        return max(abs(table.at(x).mass / m - 1) for x, m in zip(places, masses, strict=True))

    middles = 0.5 * (SHIPPED.position[:-1] + SHIPPED.position[1:])
    error = worst(table, middles[rows])
    assert error < 1e-4  # small beside what is unknown about the links
    assert error < worst(coarse, SHIPPED.position[rows]) / 2**3  # cubic splines


def test_main_refuses_in_one_line(tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--out", str(tmp_path)])
    assert stop.value.code == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error == f"impact-gym robot: error: --out must name a file in a folder that is there, got {tmp_path}"


def test_arm_alone_needs_mujoco():
    script = """
import sys
sys.modules["mujoco"] = None  # what import finds where it is not installed
import impact_gym.robot as robot
assert robot.default_approach().robot_table().at(0.2505).mass > 0
from impact_gym.robot.viper import viper
viper()
"""
    done = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, check=False)
    assert "pip install 'impact-gym[robot]'" in done.stderr.splitlines()[-1]
