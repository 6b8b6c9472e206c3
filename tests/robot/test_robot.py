"""The robot's reduction, by laws and a chain without code of the package."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation
from solver_scenes import MOTION, scene

import impact_gym as ig
from impact_gym.robot import IMPACT, default_approach, line_table, viper

DATA = json.loads(Path(__file__).with_name("viper_s650.json").read_text(encoding="utf-8"))
KINEMATICS, LINKS = DATA["kinematics"], DATA["inertia"]["links"]
LOWER, UPPER = np.radians(KINEMATICS["limits_deg"]).T
SOME_ANGLES = np.random.default_rng(0).uniform(LOWER, UPPER, size=(20, 6))
SHIPPED, X, FORWARD = default_approach(), (1.0, 0.0, 0.0), Rotation.from_euler("y", np.pi / 2).as_matrix()


def frames(angles):
    """Frames of links 1 to 6 from the URDF's origins and axes."""
    frame, result, origins = np.eye(4), [], KINEMATICS["urdf_joint_origins_xyz_m"]
    for origin, axis, angle in zip(origins, KINEMATICS["urdf_joint_axes"], angles, strict=True):
        moved = np.column_stack([Rotation.from_euler(axis, angle).as_matrix(), origin])
        frame = frame @ np.vstack([moved, np.eye(4)[3]])
        result.append(frame)
    return result


def point_jacobian(angles, point, link):
    """Jacobian of a point (base frame) fixed to link 1 to 6, by cross products with the joint axes."""
    columns = np.zeros((6, 6))
    for joint, frame in enumerate(frames(angles)[:link]):
        axis = frame[:3, "xyz".index(KINEMATICS["urdf_joint_axes"][joint])]
        columns[:, joint] = np.concatenate([np.cross(axis, point - frame[:3, 3]), axis])
    return columns


def bodies(angles):
    """Centre (base frame) of links 1 to 6, and inertia (6, 6) about it along the base's axes."""
    for frame, link in zip(frames(angles), LINKS, strict=True):
        elements, turn = link["inertia_kg_m2"], frame[:3, :3]
        tensor = np.array([[elements["".join(sorted(a + b))] for a in "xyz"] for b in "xyz"])
        yield frame[:3, 3] + turn @ link["com_m"], block_diag(link["mass_kg"] * np.eye(3), turn @ tensor @ turn.T)


def mass_matrix(angles):
    """Sum over the links of m J_v^T J_v + J_w^T I J_w."""
    moves = [point_jacobian(angles, centre, number) for number, (centre, _) in enumerate(bodies(angles), start=1)]
    return sum(J.T @ inertia @ J for J, (_, inertia) in zip(moves, bodies(angles), strict=True))


def composite_mass(angles):
    """Effective mass along x at the flange of all links as one free body, by its 6 x 6 inertia about the flange."""
    spatial, at_flange = np.zeros((6, 6)), frames(angles)[-1][:3, 3]
    for centre, inertia in bodies(angles):
        moves = np.block([[np.eye(3), np.cross(np.eye(3), centre - at_flange).T], [np.zeros((3, 3)), np.eye(3)]])
        spatial += moves.T @ inertia @ moves  # v + w x r, and w
    return 1 / np.linalg.inv(spatial)[0, 0]


def assert_equal(ours, expected, tolerance):
    np.testing.assert_allclose(ours, expected, rtol=tolerance, atol=tolerance)


@pytest.fixture(scope="module")
def arm():
    pytest.importorskip("mujoco", reason="the extra robot is not installed")
    return viper.viper()


def test_flange_jacobian_and_mass_matrix_are_the_chains(arm):
    for angles in SOME_ANGLES:
        (position, rotation), M = arm.flange(angles), arm.mass_matrix(angles)
        assert_equal(np.column_stack([rotation, position]), frames(angles)[-1][:3], 1e-14)
        J = point_jacobian(angles, position, 6)
        assert_equal(arm.jacobian(angles), J, 1e-14)
        assert_equal(M, mass_matrix(angles), 1e-12)
        assert np.array_equal(M, M.T)
        J[3:] *= KINEMATICS["link_lengths_m"]["a2"]
        assert arm.condition(angles) == pytest.approx(np.linalg.cond(J), rel=1e-9)
    assert np.array_equal([arm.lower, arm.upper], [LOWER, UPPER])


def test_reduction_along_x_follows_from_energy_and_force(arm):
    for angles in SHIPPED.joint_angles[::19]:
        ours = arm.reduction(angles, X)
        J = point_jacobian(angles, frames(angles)[-1][:3, 3], 6)
        M, K = mass_matrix(angles), np.array(DATA["joints"]["stiffness_N_m_per_rad"])
        rates = np.linalg.solve(J, np.eye(6)[0])  # the flange moves along x at 1 m/s and in no other way
        torques = J.T @ np.eye(6)[0]  # a force or an impulse along x, nothing else
        stiffness = rates @ (K * rates)
        assert ours == pytest.approx({
            "held": rates @ M @ rates,  # twice the kinetic energy
            "stiffness": stiffness,  # the force at a deflection of 1 m
            "damping": float(re.search(r"beta = (\S+) s", DATA["joints"]["damping_rule"])[1]) * stiffness,
            "effective": 1 / (J[0] @ np.linalg.solve(M, torques)),
            "effective_stiffness": 1 / (J[0] @ (torques / K)),
            "composite": composite_mass(angles),
        }, rel=1e-12)  # fmt: skip


def test_default_approach_is_straight_and_has_the_papers_mass():
    assert SHIPPED.at(0.2505).mass + 0.125 == pytest.approx(5.35, abs=1e-9)  # paper, section 3.2
    assert SHIPPED.at(0.2505).stiffness == pytest.approx(1.9e5, rel=1e-9)
    assert SHIPPED.start[1] == pytest.approx(0.0, abs=1e-15)
    assert SHIPPED.position[-1] - 0.2505 > 0.016 + 1 / 16  # delay and brake from 1 m/s at 8 m/s^2
    assert SHIPPED.joint_angles[:, 2].min() > 1.0  # rad, the elbow is up
    assert np.min([SHIPPED.joint_angles - LOWER, UPPER - SHIPPED.joint_angles]) > np.radians(10.0)
    for travel, angles in zip(SHIPPED.position, SHIPPED.joint_angles, strict=True):
        place = np.add(SHIPPED.start, (travel, 0.0, 0.0))
        assert_equal(frames(angles)[-1][:3], np.column_stack([FORWARD, place]), 1e-10)


def test_shipped_table_is_reproduced_with_all_its_digits(arm, tmp_path):
    viper.write_default_approach(file := tmp_path / "again.json")
    again, names = line_table.read(file), (*line_table.COLUMNS, "joint_angles", "start", "direction")
    for name in names:
        assert_equal(getattr(again, name), getattr(SHIPPED, name), 1e-9)
    line_table.write(file, SHIPPED, {"made_by": "a test"})
    assert all(np.array_equal(getattr(line_table.read(file), name), getattr(SHIPPED, name)) for name in names)


def test_only_an_arm_needs_mujoco(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)  # as if it were not installed
    assert default_approach.__wrapped__().at(0.2505).mass > 0
    with pytest.raises(ImportError, match=re.escape("pip install 'impact-gym[robot]'")):
        viper.viper()


def test_fixed_parameters_change_v_p_as_documented():
    robots = SHIPPED.at(IMPACT), SHIPPED.robot_table()
    fixed, along = (ig.simulate(scene(1e5, 1.0, None, robot), MOTION, 1.5).object_velocity for robot in robots)
    assert (round(fixed, 3), round(along, 3)) == (1.943, 1.956)
