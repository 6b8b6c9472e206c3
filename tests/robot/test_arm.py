"""Any serial arm from a URDF: closed forms of small arms, all joints at once, and changes without an effect."""

import re
from contextlib import nullcontext
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from made_up_arms import ELASTIC, LENGTHS, SHOULDER, edited, elastic, joint, link, rods, seven_joints, slides, write
from refusal import refused
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import impact_gym as ig
from impact_gym.robot import all_joints

pytest.importorskip("mujoco", reason="the extra robot is not installed")
Q2, Q7 = np.array([0.3, 0.9]), np.array([0.2, 0.6, -0.3, 1.1, 0.4, 0.8, -0.2])
COLUMNS = ("held", "effective", "composite", "stiffness", "effective_stiffness", "damping", "joint_angles")
SCENE = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.1), ig.Contact(1e5, 0.5))
PAPERS = ig.Trapezoid(0.5, 8.0, ig.Brake())


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
    table = arm.along(Q2, back, 0.15)
    assert (table.position[0], table.position[-1]) == (0.0, 0.15)
    assert np.diff(table.position).max() <= 0.0025 + 1e-12
    assert table.direction == pytest.approx([-(0.5**0.5), -(0.5**0.5), 0.0])
    for place, angles in zip(table.position, table.joint_angles, strict=True):
        np.testing.assert_allclose(arm.flange(angles)[0], table.start + place * table.direction, atol=1e-10)
    for mass in ("held", "effective", "composite"):
        stiffness = table.effective_stiffness if mass == "effective" else table.stiffness
        robot = table.robot_table(mass)
        expected = getattr(table, mass), stiffness, table.damping * stiffness / table.stiffness
        np.testing.assert_allclose([robot.mass, robot.stiffness, robot.damping], expected, rtol=1e-12)


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
    ours, held_by = arm.reduction(q, (*(2.0 * u), 0.0)), np.linalg.inv(J / springs @ J.T)
    yielding = held_by @ u @ J / springs  # rates of the joints, held across by their springs
    expected = {
        "held": u @ np.linalg.inv(J @ np.linalg.solve(M, J.T)) @ u, "stiffness": u @ held_by @ u,
        "damping": yielding @ (dampers * yielding), "effective": 1 / (u @ J @ np.linalg.solve(M, J.T @ u)),
        "effective_stiffness": 1 / (u @ (J / springs) @ J.T @ u),
    }  # fmt: skip
    assert {name: ours[name] for name in expected} == pytest.approx(expected, rel=1e-10)
    assert arm.condition(q) == pytest.approx(np.linalg.cond(J), rel=1e-10)
    refused(lambda: arm.reduction(q, (0.0, 0.6, 0.8)), "direction must be one in which the flange can move")


def test_joint_parameter_is_one_one_per_joint_or_drawn(tmp_path):
    assert elastic(rods(tmp_path), joint_stiffness=5e3).stiffness.tolist() == [5e3, 5e3]
    pairs = (1e3, 1e4), (2e3, 2e3)
    drawn = [elastic(tmp_path / "arm.urdf", joint_stiffness=pairs, seed=k % 50).stiffness for k in range(51)]
    assert drawn[50].tolist() == drawn[0].tolist()
    first, second = np.transpose(drawn)
    assert np.median(first) == pytest.approx(10**3.5, rel=0.3)  # log-uniform; 5500 if uniform
    assert min(first) < 1.2e3 < 8.3e3 < max(first)
    assert second == pytest.approx([2e3] * 51)
    other = seven(tmp_path, joint_stiffness=(5e3, 2e4), rotor_inertia=np.full(7, 1e-4), gear=np.full(7, 100.0))
    assert other.rotors == pytest.approx(np.ones(7))


def on_tip(parts, *more):
    """An edit that welds links to the tip, each at x = 0.1 m, y = 0.05 m, and adds other parts."""
    welded = "".join(joint(f"weld {k}", "fixed", "tip", f"part {k}") + part for k, part in enumerate(parts))
    return "</robot>", "".join((welded, *more, "</robot>"))


def part(mass, moments=(0.0, 0.0, 0.0), name="part 0", turn="0 0 0"):
    return link(name, mass, (0.1, 0.05, 0.0), moments).replace(' 0.05 0.0"', f' 0.05 0.0" rpy="{turn}"')


POINT = re.sub("<inertia .*?/>", "", part(0.5))
AXES, CLAW = (1e-3, 2e-3, 2.5e-3), '<mimic joint="elbow"/>'
READ = {  # edit of two rods; mass (kg) and moment about z (kg m^2) added at (0.5, 0.05) m of the second rod; a warning
    "a point payload": (*on_tip([POINT]), 0.5, 0.0, None),
    "an IMU against the triangle rule": (*on_tip([part(1e-7, (1e-11, 1e-11, 9e-11))]), 1e-7, 9e-11, None),
    "moments along turned axes": (*on_tip([part(0.5, AXES, turn="1.5707963267948966 0 0")]), 0.5, 2e-3, None),
    "inertia without mass": (*on_tip([part("0", (1, 1, 1))]), 0.0, 0.0, "link 'part 0' has inertia but no mass"),
    "a finger follows the arm": (*on_tip([POINT], joint("finger", "revolute", "tip", "claw", extra=CLAW), link("claw")),
                                 0.5, 0.0, "joint 'finger' mimics 'elbow'"),
    "a fixed link": (*on_tip([], joint("other", "planar", "base", "hull"), part("nan", name="hull")), 0, 0, None),
    "an unused xacro tag": (*on_tip([], '<xacro:property name="width" value="0.2"/>'), 0.0, 0.0, None),
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
    np.testing.assert_allclose(arm.mass_matrix(Q2), expected, rtol=1e-12)


def test_wrist_without_mass_is_judged_by_the_mass_matrix(tmp_path):
    """A hand on three joints with axes z, y and z through one point; with y at 0 the other two are one axis."""
    parts = [link("base")]
    for before, after, axis in (("base", "fore", "0 0 1"), ("fore", "wrist", "0 1 0"), ("wrist", "tip", "0 0 1")):
        parts += [joint(f"to {after}", "revolute", before, after, axis=axis), link(after, 2.0 * (after == "tip"))]
    with pytest.warns(UserWarning, match="has no mass") as caught:
        arm = elastic(write(tmp_path, *parts), joint_stiffness=1e3, joint_damping=1.0)
    assert [str(each.message).split(",")[0] for each in caught] == ["link 'fore'", "link 'wrist'"]
    q = np.array([0.4, 0.9, -0.5])
    axes = np.transpose([(-np.sin(q[1]), 0.0, np.cos(q[1])), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])  # before the last turn
    axes = Rotation.from_euler("z", -q[2]).as_matrix() @ axes
    np.testing.assert_allclose(arm.mass_matrix(q), axes.T @ np.diag([0.01, 0.02, 0.02]) @ axes, rtol=1e-12, atol=1e-16)
    refused(lambda: arm.mass_matrix(q * (1, 0, 1)), "joint 'to fore' and 'to tip' can move without moving any mass")


def test_balanced_inertia_is_the_mean_of_impossible_moments(tmp_path):
    """Only the upper rod breaks the triangle rule; the other keeps its moments."""
    balanced = elastic(edited(tmp_path, 'ixx="0.0001"', 'ixx="0.2"'), inertia="balanced").mass_matrix(Q2)
    change = balanced - elastic(rods(tmp_path)).mass_matrix(Q2)
    np.testing.assert_allclose(change, [[(0.2 + 0.0625 + 0.0626) / 3 - 0.0626, 0.0], [0.0, 0.0]], atol=1e-14)


def two_rods(folder, **options):
    """Two rods, and 0.2 m along a line."""
    arm = elastic(rods(folder), **options)
    return arm, arm.along((0.1, 1.6), (1.0, 0.5, 0.0), 0.2)


# kg, N s/m; the tool is held along the line
@pytest.mark.parametrize(("coupling", "sagging", "across"), [
    (ig.Rigid(), 5.35, 50.0), (ig.Rigid(), 5.35, 1e6), (ig.SpringDamper(50.0), 0.0, 50.0), (ig.Bistable(), 5.225, 50.0),
    (ig.SpringDamper(50.0, 0.4, 0.021), 0.0, 50.0),
], ids=["rigid", "stiff", "spring", "bistable", "stroke"])  # fmt: skip
def test_upright_slides_are_one_mass_that_sags_on_a_spring(coupling, sagging, across, tmp_path):
    """Nothing rotates: the compiled solver has the same equations, from m g / k farther away."""
    scene = replace(SCENE, coupling=coupling)
    arm = elastic(slides(tmp_path), joint_stiffness=(1.9e5, 1e5), joint_damping=(50.4, across))
    approach = arm.along((0.0, 0.0), (0.0, 0.0, 1.0), 0.25)
    assert arm.units == ("m", "m")
    chain = replace(scene, robot=ig.Robot(5.225, 1.9e5, 50.4), object=ig.Object(0.25, 0.1 + sagging * 9.80665 / 1.9e5))
    ours = ig.simulate(chain, PAPERS, duration=0.4)
    run = partial(all_joints.simulate, arm, approach, scene, PAPERS, duration=0.4, gravity=sagging > 0.0, rtol=1e-10)
    theirs, first = run(), ours.contacts[0]
    assert (theirs.status, theirs.contact_count) == ("ok", len(ours.contacts))
    assert theirs.object_velocity == pytest.approx(ours.object_velocity, abs=1e-7)
    assert theirs.touch_time == pytest.approx(first.start, abs=1e-8)
    assert theirs.peak_force == pytest.approx(ours.peak_force, rel=1e-5)  # sampled
    assert theirs.contact_time == pytest.approx(first.end - first.start, rel=1e-6)
    assert theirs.impulse == pytest.approx(0.25 * ours.object_velocity, abs=1e-7)
    assert theirs.sideways < 1e-12


def test_good_servo_is_nearly_exact_and_a_bad_one_has_a_status(tmp_path):
    arm, approach = two_rods(tmp_path, rotor_inertia=1e-4, gear=100.0)
    run = partial(all_joints.simulate, arm, approach, scene=SCENE, motion=PAPERS, duration=0.25)
    imposed = run().object_velocity
    found = [run(servo=all_joints.Servo(delay=delay)).object_velocity for delay in (0.0, 1e-3, 1.5e-3)]
    assert found == pytest.approx([imposed] * 3, rel=0.05)
    assert len(set(found)) == 3
    weak = run(motion=ig.Trapezoid(0.5, 50.0), servo=all_joints.Servo(0.5, 1.0, 0.02, 0.0))  # stable, but 20 ms late
    unstable = [run(servo=all_joints.Servo(*numbers)) for numbers in ((5e3, 1.0, 2e-3), (100.0, 1.0, 0.1))]
    for lost in (weak, *unstable):
        assert lost.status.startswith("the servo does not hold the arm on its line: a motor is")
        assert np.isfinite([lost.object_velocity, lost.peak_force, lost.impulse, lost.sideways]).all()


def lagrange(start, u):
    """The first contact by Lagrange's equations of two rods in closed form, in the complex plane."""
    (a, b), m, k_c, K, D = LENGTHS, 0.125, 1e5, *map(np.array, ELASTIC.values())
    fore = 2.0 * b**2 / 3 + 1e-4 + m * b**2
    both, h = fore + 3.0 * a**2 / 3 + 1e-4 + (2.0 + m) * a**2, (2.0 / 2 + m) * a * b

    def flange(q):  # along the line (real) and across it (imaginary), and its slopes
        hand = b * np.exp(1j * (q[0] + q[1]))
        place = a * np.exp(1j * q[0]) + hand
        return (place - start) / u, 1j * np.array([place, hand]) / u

    def penetration(y):
        place, J = flange(y[:2])
        return place.real - y[4], J.real @ y[2:4] - y[5]

    def force(y, chi):
        depth, rate = penetration(y)
        return max((k_c + chi * rate) * max(depth, 0.0) ** 1.5, 0.0)

    def motors(t):
        place = start + 4.0 * t * t * u
        elbow = np.arccos((abs(place) ** 2 - a * a - b * b) / (2 * a * b))
        q = np.array([np.angle(place / (a + b * np.exp(1j * elbow))), elbow])
        J = flange(q)[1]
        return q, np.linalg.solve([J.real, J.imag], [8.0 * t, 0.0])

    def rates(t, y, chi):
        q, v, (q_m, v_m), F = y[:2], y[2:4], motors(t), force(y, chi)
        turning, c = -h * np.sin(q[1]) * np.array([(2 * v[0] + v[1]) * v[1], -(v[0] ** 2)]), h * np.cos(q[1])
        torques = K * (q_m - q) + D * (v_m - v) - turning - flange(q)[1].real * F
        return [*v, *np.linalg.solve([[both + 2 * c, fore + c], [fore + c, fore]], torques), y[5], F / 0.25]

    def gap(t, y, chi):
        return penetration(y)[0]

    gap.terminal = True
    solve = partial(solve_ivp, rates, method="DOP853", events=gap, rtol=1e-11, atol=1e-13)
    flight = solve((0.0, 1.0), [*motors(0.0)[0], 0.0, 0.0, 0.1, 0.0], args=(0.0,))
    closing = penetration(flight.y[:, -1])[1]
    chi, gap.direction = 1.5 * (1 - 0.5) / 0.5 * k_c / closing, -1.0  # Hu and Guo
    contact = solve((flight.t[-1], 1.0), flight.y[:, -1], args=(chi,), dense_output=True)
    states = contact.sol(np.linspace(flight.t[-1], contact.t[-1], 2001)).T
    sideways = [abs(flange(y[:2])[0].imag) for y in states]
    return flight.t[-1], contact.t[-1], closing, contact.y[5, -1], sideways


def test_all_joints_obey_lagranges_equations(tmp_path):
    arm, approach = two_rods(tmp_path)
    line = [complex(*vector[:2]) for vector in (approach.start, approach.direction)]
    touched, parted, closing, velocity, sideways = lagrange(*line)
    motion = ig.Trapezoid(2.0, 8.0)  # it still accelerates at the contact
    ours = all_joints.simulate(arm, approach, SCENE, motion, duration=parted + 1e-4, rtol=1e-10)
    assert (ours.status, ours.contact_count) == ("ok", 1)
    assert ours.touch_time == pytest.approx(touched, abs=1e-8)
    assert (ours.impact_velocity, ours.object_velocity) == pytest.approx((closing, velocity), abs=1e-7)
    assert ours.contact_time == pytest.approx(parted - touched, rel=1e-6)
    assert ours.sideways == pytest.approx(max(sideways), rel=1e-3)


def test_leaving_the_line_and_too_much_work_have_a_status(tmp_path):
    run = partial(all_joints.simulate, *two_rods(tmp_path), SCENE, duration=2.0)
    beyond, back = run(ig.Trapezoid(0.5, 8.0)), run(ig.Motion((0.0, 0.1, 0.3), (0.0, 0.2, -0.4)))
    assert beyond.status == "the motion leaves the line at 0.4313 s"  # 0.2 m at 0.5 m/s and 0.5 m/s at 8 m/s^2
    assert back.status.startswith("the motion leaves the line")
    assert (back.touch_time, back.impact_velocity, back.contact_time) == (None, None, None)
    assert run(PAPERS, most_evaluations=100).status == "more than 100 evaluations of the equations"


def test_advise_compares_one_mass_with_all_joints(tmp_path):
    arm = two_rods(tmp_path, joint_stiffness=(9e4, 4e4))
    advice = ig.advise(SCENE, PAPERS, 0.005, duration=0.3, arm=arm)
    true = all_joints.simulate(*arm, SCENE, PAPERS, duration=0.3).object_velocity
    for model in advice.tried[1:]:
        chain = ig.simulate(model.simplify(SCENE), PAPERS, duration=0.3).object_velocity
        assert model.errors.tolist() == [abs(chain - true) / true]
    off = {model.name: model.bound for model in advice.tried}
    assert {"robot rigid", "robot one mass, held", "robot one mass, effective"} < set(off)
    assert advice.model.name.startswith("robot one mass")
    assert advice.model.bound <= 0.005 < off["robot rigid"]
    assert ig.advise(SCENE, PAPERS, 1e-12, duration=0.3, arm=arm).model.name == "all joints"
