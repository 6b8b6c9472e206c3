"""Any serial arm from a URDF: closed forms of small arms, and changes without an effect."""

import re
from contextlib import nullcontext

import numpy as np
import pytest
from made_up_arms import SHOULDER, edited, elastic, joint, link, rods, seven_joints
from refusal import refused
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco", reason="the extra robot is not installed")
Q2, Q7 = np.array([0.3, 0.9]), np.array([0.2, 0.6, -0.3, 1.1, 0.4, 0.8, -0.2])
COLUMNS = ("held", "effective", "composite", "stiffness", "effective_stiffness", "damping", "joint_angles")


def seven(folder, names=tuple("abcdefg"), **options):
    springs = {"joint_stiffness": 1e4, "joint_damping": 1.0}
    return elastic(seven_joints(folder, names), "link 0", **springs | options)


@pytest.mark.parametrize(("make", "base", "count"), [(rods, "base", 2), (seven_joints, "link 0", 7)])
def test_names_and_rotation_of_the_base_have_no_effect(make, base, count, tmp_path):
    names, turn, there = tuple("zyxwvut"[:count]), (0.4, -0.9, 2.1), (-1.0, 0.2, 0.0)
    springs = {"joint_stiffness": tuple(np.linspace(9e3, 4e3, count)), "joint_damping": tuple(range(count))}
    ours = elastic(make(tmp_path), base, **springs).along(Q7[:count], there, 0.15)
    turned = elastic(make(tmp_path, names=names, turn=" ".join(map(str, turn))), "world", **springs)
    theirs = turned.along(Q7[:count], Rotation.from_euler("xyz", turn).apply(there), 0.15)
    assert theirs.joints == names
    for name in COLUMNS:
        np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), rtol=1e-9)


def test_line_is_straight_and_its_table_has_the_chosen_mass(tmp_path):
    arm, back = elastic(rods(tmp_path)), (-3.0, -3.0, 0.0)
    assert len(arm.along(Q2, back, (0.0, 0.01, 0.02, 0.03)).position) == 4  # no fewer are allowed
    table = arm.along(Q2, back, 0.15)
    assert (table.position[0], table.position[-1]) == (0.0, 0.15)
    assert np.diff(table.position).max() <= 0.0025 + 1e-12
    assert table.direction == pytest.approx([-(0.5**0.5), -(0.5**0.5), 0.0])
    for place, angles in zip(table.position, table.joint_angles, strict=True):
        np.testing.assert_allclose(arm.flange(angles)[0], table.start + place * table.direction, atol=1e-10)
    for mass in ("held", "effective", "composite"):
        stiffness = table.effective_stiffness if mass == "effective" else table.stiffness
        damping = table.damping * stiffness / table.stiffness
        for row in (0, 17, -1):
            robot = table.robot_table(mass).at(table.position[row])
            expected = getattr(table, mass)[row], stiffness[row], damping[row]
            assert (robot.mass, robot.stiffness, robot.damping) == pytest.approx(expected, rel=1e-12)


def test_seven_joints_change_little_and_fewer_than_six_may_turn(tmp_path):
    arm = seven(tmp_path)
    approach = arm.along(Q7, (1.0, 0.0, 0.0), np.linspace(0.0, 0.02, 21))
    for step, angles in zip(np.diff(approach.joint_angles, axis=0), approach.joint_angles, strict=False):
        free = np.linalg.svd(arm.jacobian(angles))[2][-1]
        assert abs(free @ step) < 2e-2 * np.linalg.norm(step)  # the path curves within a step
    for count, rows in ((5, 3), (6, 6), (7, 6)):
        assert seven(tmp_path, names="abcdefg"[:count]).held_rows(Q7[:count]).shape == (rows, count)


def test_third_joint_in_a_plane_yields_by_inertia_and_springs(tmp_path):
    """The plane has two directions in which the flange is held, and the arm three joints."""
    path = rods(tmp_path, (0.4, 0.4, 0.4), (3.0, 2.0, 1.0), ("first", "second", "third"))
    springs, dampers = np.array([9e3, 4e3, 2e3]), np.array([5.0, 2.0, 4.0])
    arm = elastic(path, joint_stiffness=springs, joint_damping=dampers)
    q, u = np.array([0.3, 0.9, 0.7]), np.array([0.6, 0.8])
    J, M = arm.jacobian(q)[:2], arm.mass_matrix(q)  # compared with an independent chain in test_robot.py
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
    refused(lambda: arm.reduction(q, (0.0, 0.6, 0.8)), "direction must be one in which the flange can move")
    refused(lambda: arm.reduction((0.3, 0.0, 0.0), (*u, 0.0)), "too near a singularity")


def test_joint_parameter_is_one_one_per_joint_or_drawn(tmp_path):
    path = rods(tmp_path)
    for given in (5e3, (5e3, 5e3)):
        assert elastic(path, joint_stiffness=given).stiffness.tolist() == [5e3, 5e3]
    drawn = [elastic(path, joint_stiffness=((1e3, 1e4), (2e3, 2e3)), seed=k % 50).stiffness for k in range(51)]
    assert drawn[50].tolist() == drawn[0].tolist()
    first, second = np.transpose(drawn)
    assert np.median(first) == pytest.approx(10**3.5, rel=0.3)  # log-uniform; 5500 if uniform
    assert min(first) < 1.2e3 < 8.3e3 < max(first)
    assert second == pytest.approx([2e3] * 51)
    other = seven(tmp_path, joint_stiffness=(5e3, 2e4), rotor_inertia=np.full(7, 1e-4), gear=np.full(7, 100.0))
    assert len(set(other.stiffness.tolist())) == 7
    assert other.rotors == pytest.approx(np.ones(7))


def on_tip(parts, *more):
    """An edit that welds links to the tip, each at x = 0.1 m, y = 0.05 m, and adds other parts."""
    welded = "".join(joint(f"weld {k}", "fixed", "tip", f"part {k}") + part for k, part in enumerate(parts))
    return "</robot>", "".join((welded, *more, "</robot>"))


def part(mass, moments=(0.0, 0.0, 0.0), name="part 0", turn="0 0 0"):
    return link(name, mass, (0.1, 0.05, 0.0), moments).replace(' 0.05 0.0"', f' 0.05 0.0" rpy="{turn}"')


POINT = re.sub("<inertia .*?/>", "", part(0.5))
MASSLESS = part("0", (1, 1, 1))
AXES, CLAW = (1e-3, 2e-3, 2.5e-3), '<mimic joint="elbow"/>'
READ = {  # edit of two rods; mass (kg) and moment about z (kg m^2) added at (0.5, 0.05) m of the second rod; a warning
    "a point payload": (*on_tip([POINT]), 0.5, 0.0, None),
    "an IMU against the triangle rule": (*on_tip([part(1e-7, (1e-11, 1e-11, 9e-11))]), 1e-7, 9e-11, None),
    "moments along turned axes": (*on_tip([part(0.5, AXES, turn="1.5707963267948966 0 0")]), 0.5, 2e-3, None),
    "inertia without mass": (*on_tip([MASSLESS]), 0.0, 0.0, "link 'part 0' has inertia but no mass"),
    "a finger follows the arm": (*on_tip([POINT], joint("finger", "revolute", "tip", "claw", extra=CLAW), link("claw")),
                                 0.5, 0.0, "joint 'finger' mimics 'elbow'"),
    "a fixed link": (*on_tip([], joint("other", "planar", "base", "hull"), part("nan", name="hull")), 0, 0, None),
    "six digits of a plate": ('izz="[^"]*"', f'izz="{0.0626 * (1 + 4e-7)}"', 0.0, 0.0, None),
    "a comment and a mesh": ("<link name=\"tip\">", '<!-- <link name="upper"/> --><link name="tip"><visual><geometry>'
                             '<mesh filename="package://no/such.stl"/></geometry></visual>', 0.0, 0.0, None),
    "an undeclared prefix": ('velocity="1"', 'velocity="1" drake:acceleration="9"', 0.0, 0.0, None),
    "limits of 10 rad": (SHOULDER, r'\1"-10" upper="10"', 0.0, 0.0, None),
    "a lower limit in degrees": (SHOULDER, r'\1"-10.01" upper="3"', 0.0, 0.0, "limits of -10.01 and 3 rad"),
    "an upper limit in degrees": (SHOULDER, r'\1"-3" upper="10.01"', 0.0, 0.0, "'shoulder' has limits of -3 and 10.01"),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "mass", "moment", "warning"), READ.values(), ids=READ)
def test_mass_matrix_is_the_sum_over_all_moving_links(old, new, mass, moment, warning, tmp_path):
    """The sum of m J' J and the moments about z, both written down for a chain in a plane."""
    with pytest.warns(UserWarning, match=warning) if warning else nullcontext() as caught:
        arm = elastic(edited(tmp_path, old, new))
    assert not caught or caught[0].filename == elastic.__code__.co_filename  # the warning points to the caller
    expected = np.zeros((2, 2))
    for rod, m, x, y, about_z in (
        (0, 3.0, 0.25, 0.0, 0.0626), (1, 2.0, 0.2, 0.0, 2 * 0.4**2 / 12 + 1e-4), (1, mass, 0.5, 0.05, moment)
    ):  # fmt: skip
        place = x + 1j * y  # of the plane, as complex numbers
        first = place if rod == 0 else 0.5 + place * np.exp(1j * Q2[1])
        moves = np.array([first, rod * place * np.exp(1j * Q2[1])])
        turns = np.array([1, rod])
        expected += m * (np.outer(moves.conj(), moves)).real + about_z * np.outer(turns, turns)
    assert arm.joints == ("shoulder", "elbow")
    assert arm.composite(Q2)[0] == pytest.approx(5.0 + mass, rel=1e-12)
    np.testing.assert_allclose(arm.mass_matrix(Q2), expected, rtol=1e-6 if "izz" in old else 1e-12)


def test_balanced_inertia_is_the_mean_of_impossible_moments(tmp_path):
    """Only the upper rod breaks the triangle rule; the other keeps its moments."""
    paths = rods(tmp_path).rename(tmp_path / "plain.urdf"), edited(tmp_path, 'ixx="0.0001"', 'ixx="0.2"')
    plain, balanced = (elastic(path, inertia="balanced").mass_matrix(Q2) for path in paths)
    changed = np.array([[(0.2 + 0.0625 + 0.0626) / 3 - 0.0626, 0.0], [0.0, 0.0]])
    np.testing.assert_allclose(balanced, plain + changed, rtol=1e-12)
