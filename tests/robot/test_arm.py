"""Any serial arm from a URDF: closed forms of small ones, and what must not matter."""

from dataclasses import replace

import numpy as np
import pytest
from arms import edited, joint, link, rods, seven_joints
from scipy.spatial.transform import Rotation

import impact_gym as ig
from impact_gym.robot import from_urdf

pytest.importorskip("mujoco", reason="the extra robot is not installed")
ELASTIC = {"joint_stiffness": (9e3, 4e3), "joint_damping": (5.0, 2.0)}
Q7, THERE = np.array([0.2, 0.6, -0.3, 1.1, 0.4, 0.8, -0.2]), (-1.0, 0.2, 0.0)
COLUMNS = ("held", "effective", "composite", "stiffness", "effective_stiffness", "damping", "joint_angles")


@pytest.mark.parametrize("count", [2, 7])
def test_neither_names_nor_the_turn_of_the_base_matter(count, tmp_path):
    make, q = (rods, Q7[:2]) if count == 2 else (seven_joints, Q7)
    names, turn = [f"{word} {k}" for k, word in enumerate(("zulu", "alpha") * 4)][:count], (0.4, -0.9, 2.1)
    elastic = {"joint_stiffness": tuple(np.linspace(9e3, 4e3, count)), "joint_damping": tuple(range(count))}
    base = "base" if count == 2 else "link 0"
    plain = from_urdf(make(tmp_path), base, "tip", **elastic)
    other = from_urdf(make(tmp_path, names=names, turn=" ".join(map(str, turn))), "world", "tip", **elastic)
    ours, theirs = (
        arm.along(q, turned.apply(THERE), 0.15)
        for arm, turned in ((plain, Rotation.identity()), (other, Rotation.from_euler("xyz", turn)))
    )
    assert theirs.joints == tuple(names)
    for name in COLUMNS:
        np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), rtol=1e-9)


def test_line_is_straight_and_its_table_names_its_columns_and_the_chosen_mass(tmp_path):
    arm = ig.robot.from_urdf(rods(tmp_path), "base", "tip", **ELASTIC)
    table = arm.along((0.3, 0.9), (-3.0, -3.0, 0.0), 0.15)
    assert (table.position[0], table.position[-1]) == (0.0, 0.15)
    assert np.diff(table.position).max() <= 0.0025 + 1e-12
    for place, angles in zip(table.position, table.joint_angles, strict=True):
        np.testing.assert_allclose(arm.flange(angles)[0], table.start + place * table.direction, atol=1e-10)
    assert table.x == pytest.approx([arm.flange(angles)[0][0] for angles in table.joint_angles], abs=1e-10)
    assert np.linalg.norm(table.direction) == pytest.approx(1.0)
    for mass in ("held", "effective", "composite"):
        chosen, stiffness = replace(table, chosen=mass), "effective_stiffness" if mass == "effective" else "stiffness"
        assert chosen.robot_table() == table.robot_table(mass)
        for place in (0, 17, -1):
            robot = chosen.at(table.position[place])
            assert robot.mass == pytest.approx(getattr(table, mass)[place], rel=1e-12)
            assert robot.stiffness == pytest.approx(getattr(table, stiffness)[place], rel=1e-12)


def test_seven_joints_go_the_shortest_way(tmp_path):
    """Of all angles that reach a place nearby the joints take those that change least."""
    arm = from_urdf(seven_joints(tmp_path), "link 0", "tip", joint_stiffness=1e4, joint_damping=1.0)
    approach = arm.along(Q7, (1.0, 0.0, 0.0), np.linspace(0.0, 0.02, 21))
    assert "least change" in approach.rule
    for step, angles in zip(np.diff(approach.joint_angles, axis=0), approach.joint_angles, strict=False):
        free = np.linalg.svd(arm.jacobian(angles))[2][-1]
        assert abs(free @ step) < 2e-2 * np.linalg.norm(step)  # the bend of the way within a step


def test_three_joints_in_a_plane_are_two_that_hold_and_one_that_yields(tmp_path):
    """The plane has two directions to hold; held across, the third joint goes where inertia and springs let it."""
    path = rods(tmp_path, (0.4, 0.4, 0.4), (3.0, 2.0, 1.0), ("first", "second", "third"))
    springs, dampers = np.array([9e3, 4e3, 2e3]), np.array([5.0, 2.0, 4.0])
    arm = from_urdf(path, "base", "tip", joint_stiffness=springs, joint_damping=dampers)
    q, u = np.array([0.3, 0.9, 0.7]), np.array([0.6, 0.8])
    J, M = arm.jacobian(q)[:2], arm.mass_matrix(q)  # as those of an independent chain in test_robot.py
    ours, held_by = arm.reduction(q, (*u, 0.0)), np.linalg.inv(J / springs @ J.T)
    yielding = held_by @ u @ J / springs  # rates of the joints, held across by their springs
    expected = {
        "held": u @ np.linalg.inv(J @ np.linalg.solve(M, J.T)) @ u, "stiffness": u @ held_by @ u,
        "damping": yielding @ (dampers * yielding), "effective": 1 / (u @ J @ np.linalg.solve(M, J.T @ u)),
        "effective_stiffness": 1 / (u @ (J / springs) @ J.T @ u),
    }  # fmt: skip
    assert {name: ours[name] for name in expected} == pytest.approx(expected, rel=1e-10)
    assert arm.reduction(q, (2.0, 0.0, 0.0)) == arm.reduction(q, (1.0, 0.0, 0.0))
    stretched = np.linalg.svd(J, compute_uv=False)
    assert arm.condition(q) == pytest.approx(stretched[0] / stretched[1], rel=1e-10)
    with pytest.raises(ValueError, match="the arm cannot move along"):
        arm.reduction(q, (0.0, 0.6, 0.8))
    with pytest.raises(ValueError, match="too near a singularity"):
        arm.reduction((0.3, 0.0, 0.0), (*u, 0.0))


def test_numbers_of_joints_are_one_for_all_one_for_each_or_drawn_between_two(tmp_path):
    def stiffness(given, seed=0):
        options = {"joint_stiffness": given, "joint_damping": 0.0, "seed": seed}
        return from_urdf(rods(tmp_path), "base", "tip", **options).stiffness

    assert stiffness(5e3).tolist() == [5e3, 5e3]
    assert stiffness((5e3, 4e3)).tolist() == [5e3, 4e3]
    drawn = [stiffness(((1e3, 1e4), (2e3, 2e3)), seed) for seed in range(50)]
    assert np.array_equal(drawn[3], stiffness(((1e3, 1e4), (2e3, 2e3)), 3))
    assert np.ptp(np.log([each[0] for each in drawn])) > 0.8 * np.log(10)
    assert np.ptp([each[1] for each in drawn]) < 1e-9
    seven = from_urdf(seven_joints(tmp_path), "link 0", "tip", joint_stiffness=(5e3, 2e4), joint_damping=np.ones(7),
                      rotor_inertia=np.full(7, 1e-4), gear=np.full(7, 100.0))  # fmt: skip
    assert len(set(seven.stiffness.tolist())) == 7
    assert 5e3 <= seven.stiffness.min() <= seven.stiffness.max() <= 2e4
    assert seven.rotors == pytest.approx(np.ones(7))


GRIPPER = joint("finger", "prismatic", "tip", "claw", extra='<mimic joint="elbow"/>') + link("claw", 0.1)


@pytest.mark.parametrize(("old", "new", "mass"), [
    ("</robot>", GRIPPER + "</robot>", 5.1),
    ('velocity="1"', 'velocity="1" drake:acceleration="9"', 5.0),  # as in a file of airo-models
], ids=["what hangs on the arm moves with it", "a prefix that nobody declared is a name"])  # fmt: skip
def test_arm_is_what_its_file_says(old, new, mass, tmp_path):
    arm = from_urdf(edited(tmp_path, old, new), "base", "tip", **ELASTIC)
    assert arm.joints == ("shoulder", "elbow")
    assert arm.composite((0.3, 0.9))[0] == pytest.approx(mass)
