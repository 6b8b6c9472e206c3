"""Any serial arm from a URDF: closed forms of small ones, what must not matter, and files that are no arm."""

import re

import numpy as np
import pytest
from arms import TWO_LINKS, joint, link, rod, slides, two_links, two_links_matrices, write

from impact_gym.robot import Line, along, follow, from_urdf

pytest.importorskip("mujoco", reason="the extra robot is not installed")
ELASTIC = {"joint_stiffness": (9e3, 4e3), "joint_damping": (5.0, 2.0)}
POSES = [(0.3, 0.9), (-1.0, 2.0), (1.4, -1.2)]


@pytest.mark.parametrize("q", POSES)
def test_two_links_have_the_masses_stiffnesses_and_frequencies_of_the_textbook(q, tmp_path):
    arm, (M, J) = from_urdf(two_links(tmp_path), "base", "tip", **ELASTIC), two_links_matrices(q)
    np.testing.assert_allclose(arm.mass_matrix(q), M, rtol=1e-12)
    np.testing.assert_allclose(arm.jacobian(q)[:2], J, atol=1e-12)
    u, K, D = np.array([np.cos(0.4), np.sin(0.4)]), np.diag([9e3, 4e3]), np.diag([5.0, 2.0])
    ours = along(arm, q, (*u, 0.0))
    back = np.linalg.inv(J)  # the plane is all that the tip has: held across, it moves along u alone
    a, b = (mass * length for mass, length in zip(TWO_LINKS["masses"], TWO_LINKS["lengths"], strict=True))
    expected = {
        "mass": u @ back.T @ M @ back @ u, "stiffness": u @ back.T @ K @ back @ u, "damping": u @ back.T @ D @ back @ u,
        "effective_mass": 1 / (u @ J @ np.linalg.inv(M) @ J.T @ u),
        "effective_stiffness": 1 / (u @ J @ np.linalg.inv(K) @ J.T @ u),
    }  # fmt: skip
    assert {name: ours[name] for name in expected} == pytest.approx(expected, rel=1e-10)
    # all as one body: centre, moment about it, and the lever of the tip
    (l1, l2), (m, n), both = TWO_LINKS["lengths"], TWO_LINKS["masses"], q[0] + q[1]
    upper = 0.5 * l1 * np.array([np.cos(q[0]), np.sin(q[0])])
    fore, tip = 2 * upper + 0.5 * l2 * np.array([np.cos(both), np.sin(both)]), 2 * upper
    tip = tip + l2 * np.array([np.cos(both), np.sin(both)])
    centre = (m * upper + n * fore) / (m + n)
    moment = (
        rod(m, l1)[2] + rod(n, l2)[2] + m * (upper - centre) @ (upper - centre) + n * (fore - centre) @ (fore - centre)
    )
    lever = (tip - centre)[0] * u[1] - (tip - centre)[1] * u[0]
    assert ours["composite_mass"] == pytest.approx(1 / (1 / (m + n) + lever**2 / moment), rel=1e-10)
    half, product = np.trace(np.linalg.inv(M) @ K) / 2, np.linalg.det(K) / np.linalg.det(M)
    squares = half + np.array([-1, 1]) * np.sqrt(half**2 - product)  # omega^2 of a quadratic equation
    found = np.sort(np.linalg.eigvals(np.linalg.solve(arm.mass_matrix(q), np.diag(arm.stiffness))))
    np.testing.assert_allclose(found, squares, rtol=1e-10)
    assert (a, b) == (1.5, 0.8)


def test_neither_names_nor_the_turn_of_the_base_matter(tmp_path):
    q, turn = (0.3, 0.9), 0.7
    plain = from_urdf(two_links(tmp_path), "base", "tip", **ELASTIC)
    other = from_urdf(two_links(tmp_path, f"0 0 {turn}", ("zulu", "alpha")), "world", "tip", **ELASTIC)
    line = {"ahead": 0.1, "behind": 0.05}
    ours = follow(plain, Line(q, (1.0, 0.2, 0.0), **line))
    cos, sin = np.cos(turn), np.sin(turn)
    theirs = follow(other, Line(q, (cos - 0.2 * sin, sin + 0.2 * cos, 0.0), **line))
    assert theirs.joints == ("zulu", "alpha")
    for name in ("mass", "effective_mass", "composite_mass", "stiffness", "damping", "joint_angles"):
        np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), rtol=1e-9)


def test_line_is_straight_and_its_table_has_the_chosen_mass(tmp_path):
    arm = from_urdf(two_links(tmp_path), "base", "tip", **ELASTIC)
    approach = follow(arm, Line((0.3, 0.9), (1.0, 1.0, 0.0), ahead=0.1, behind=0.05))
    for travel, angles in zip(approach.travel, approach.joint_angles, strict=True):
        np.testing.assert_allclose(arm.flange(angles)[0], approach.start + travel * approach.direction, atol=1e-10)
    row, at = approach.impact_row, approach.impact_travel
    for name, mass in (("held", approach.mass), ("effective", approach.effective_mass)):
        assert approach.robot_table(name).at(at).mass == pytest.approx(mass[row], rel=1e-12)
        assert approach.at_impact(name).mass == mass[row]
    assert approach.at_impact("composite").stiffness == approach.stiffness[row]
    assert approach.at_impact("effective").stiffness == approach.effective_stiffness[row]
    with pytest.raises(ValueError, match=r"mass must be .*'held'"):
        approach.robot_table("light")


def test_seven_joints_go_the_shortest_way(tmp_path):
    """Of all angles that reach a place nearby the joints take those that change least."""
    axes, parts = ["0 0 1", "0 1 0"] * 3 + ["0 0 1"], [link("link 0")]
    for k, axis in enumerate(axes):
        parts += [joint(f"joint {k}", "revolute", f"link {k}", f"link {k + 1}", (0, 0, 0.2), axis),
                  link(f"link {k + 1}", 1.0, (0, 0, 0.1))]  # fmt: skip
    arm = from_urdf(write(tmp_path, *parts), "link 0", "link 7", joint_stiffness=1e4, joint_damping=1.0)
    q = np.array([0.2, 0.6, -0.3, 1.1, 0.4, 0.8, -0.2])
    approach = follow(arm, Line(tuple(q), (1.0, 0.0, 0.0), ahead=0.01, behind=0.01, spacing=0.001))
    steps, middles = np.diff(approach.joint_angles, axis=0), approach.joint_angles[:-1]
    for step, angles in zip(steps, middles, strict=True):
        free = np.linalg.svd(arm.jacobian(angles))[2][-1]
        assert abs(free @ step) < 2e-2 * np.linalg.norm(step)  # the bend of the way within a step
    rows = along(arm, q, (1.0, 0.0, 0.0))
    assert rows["effective_mass"] <= rows["mass"]
    J, M = arm.jacobian(q), arm.mass_matrix(q)
    rates = np.linalg.solve(M, J.T) @ np.linalg.solve(J @ np.linalg.solve(M, J.T), np.eye(6)[0])
    np.testing.assert_allclose(J @ rates, np.eye(6)[0], atol=1e-12)  # along the line and in no other way
    assert rows["mass"] == pytest.approx(rates @ M @ rates, rel=1e-10)


def test_stiffness_is_a_number_one_for_each_joint_or_drawn_between_two(tmp_path):
    def stiffness(given, seed=0):
        return from_urdf(
            two_links(tmp_path), "base", "tip", joint_stiffness=given, joint_damping=0.0, seed=seed
        ).stiffness

    assert stiffness(5e3).tolist() == [5e3, 5e3]
    assert stiffness((5e3, 4e3)).tolist() == [5e3, 4e3]
    drawn = [stiffness(((1e3, 1e4), (2e3, 2e3)), seed) for seed in range(50)]
    assert np.array_equal(drawn[3], stiffness(((1e3, 1e4), (2e3, 2e3)), 3))
    assert np.ptp(np.log([each[0] for each in drawn])) > 0.8 * np.log(10)
    assert np.ptp([each[1] for each in drawn]) < 1e-9


GRIPPER = joint("finger", "prismatic", "tip", "claw", extra='<mimic joint="elbow"/>') + link("claw", 0.1)


SHOULDER = '(name="shoulder".*?lower=)"-3" upper="3"'


def edited(folder, old, new):
    """The two links with a piece of the file exchanged."""
    path = two_links(folder)
    text = path.read_text()
    assert re.search(old, text)
    path.write_text(re.sub(old, new, text, count=1))
    return path


def test_what_hangs_on_the_arm_moves_with_it(tmp_path):
    arm = from_urdf(edited(tmp_path, "</robot>", GRIPPER + "</robot>"), "base", "tip", **ELASTIC)
    assert arm.joints == ("shoulder", "elbow")
    assert arm.composite((0.3, 0.9))[0] == pytest.approx(5.1)


@pytest.mark.parametrize(("old", "new", "message"), [
    ('type="revolute"', 'type="floating"', r"joint 'shoulder' is floating, allowed are revolute, continuous,"),
    ("</robot>", joint("again", "fixed", "base", "fore") + "</robot>", "link 'fore' hangs on two joints, a loop"),
    ('<parent link="upper"/>', '<parent link="uper"/>', "joint 'elbow' has the parent 'uper', which is no link"),
    ('(name="shoulder".*?)<limit', r'\1<mimic joint="elbow"/><limit', "joint 'shoulder' mimics another"),
    (SHOULDER, r'\1"3" upper="-3"', "joint 'shoulder' has limits of 3 and -3 rad, which must rise"),
    ("<inertial>.*?</inertial>", "", "joint 'shoulder' moves no mass"),
    ('<mass value="3.0"/>', '<mass value="-3"/>', "mass of upper must be .*kg.*, got -3.0"),
    ('ixx="0.0001"', 'ixx="-1"', "link 'upper' has principal moments of inertia of -1, .* above 0"),
    ('ixx="0.0001"', 'ixx="9"', "link 'upper' has principal moments .* at most the sum of the others"),
    ('ixx="0.0001"', 'ixx="nan"', "ixx of upper must be .*kg m.2.*, got nan"),
    ("<robot ", "<sdf ", "no URDF that can be read"),
    ("</robot>", '<x:include xmlns:x="http://ros.org/wiki/xacro"/></robot>', "a xacro, turn it into a URDF first"),
])  # fmt: skip
def test_files_that_are_no_arm_are_refused_in_one_line(old, new, message, tmp_path):
    path = edited(tmp_path, old, new)
    with pytest.raises(ValueError, match=message) as refusal:
        from_urdf(path, "base", "tip", **ELASTIC)
    assert str(refusal.value).startswith(str(path))
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("base", "tip", "options", "message"), [
    ("tip", "base", {}, "the tip 'base' is not below the base 'tip'"),
    ("base", "hand", {}, r"no link 'hand', there are \['base'"),
    ("upper", "tip", {}, "an arm has two joints or more, between 'upper' and 'tip' there are 1"),
    ("base", "tip", {"joint_stiffness": (1.0, 2.0, 3.0)}, "joint_stiffness must be a number or 2 of them"),
    ("base", "tip", {"joint_stiffness": 0.0}, "joint_stiffness must be .*above 0.*, got 0.0"),
    ("base", "tip", {"joint_stiffness": (-1.0, 5.0)}, r"joint_stiffness\[0\] must be .*above 0.*, got -1.0"),
    ("base", "tip", {"joint_stiffness": float("nan")}, "joint_stiffness must be .*, got nan"),
    ("base", "tip", {"joint_stiffness": ((3.0, 2.0), (1.0, 2.0))}, "joint_stiffness must have pairs that rise"),
    ("base", "tip", {"joint_damping": -1.0}, "joint_damping must be .*, got -1.0"),
])  # fmt: skip
def test_ends_and_numbers_that_are_none_are_refused(base, tip, options, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        from_urdf(two_links(tmp_path), base, tip, **ELASTIC | options)


def test_lines_that_leave_limits_pass_a_singularity_or_have_slipped_units_are_refused(tmp_path):
    arm = from_urdf(two_links(tmp_path), "base", "tip", **ELASTIC)
    with pytest.raises(ValueError, match=r"cannot reach x = .* misses it by|too near a singularity.* joint 'elbow'"):
        follow(arm, Line((0.0, 0.5), ahead=0.1, behind=0.2))  # beyond the stretched arm
    short = from_urdf(edited(tmp_path, SHOULDER, r'\1"0.2" upper="0.4"'), "base", "tip", **ELASTIC)
    with pytest.raises(ValueError, match=r"joint 'shoulder' would be at .* rad, its limits are 0.2 and 0.4 rad"):
        follow(short, Line((0.3, 0.9), ahead=0.1, behind=0.1))
    soft = from_urdf(two_links(tmp_path), "base", "tip", joint_stiffness=9.0, joint_damping=0.0)
    with pytest.raises(ValueError, match=r"is joint_stiffness in N m/rad\?"):
        follow(soft, Line((0.3, 0.9), ahead=0.1, behind=0.1))
    slide = from_urdf(slides(tmp_path), "base", "tip", joint_stiffness=1e5, joint_damping=1.0)
    assert slide.units == ("m", "m")
    with pytest.raises(ValueError, match="angles must be 2 numbers"):
        follow(slide, Line((0.0,), ahead=0.1))
