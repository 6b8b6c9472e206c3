"""All joints at once: against the compiled solver for an arm that is one mass, laws, and limits."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from made_up_arms import ELASTIC, LENGTHS, elastic, rods, slides
from scipy.integrate import solve_ivp

import impact_gym as ig
from impact_gym.robot import all_joints

pytest.importorskip("mujoco", reason="the extra robot is not installed")
SCENE = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.1), ig.Contact(1e5, 0.5))
PAPERS = ig.Trapezoid(0.5, 8.0, ig.Brake())
G = 9.80665  # m/s^2


def two_rods(folder, **options):
    """Two rods, and 0.2 m along a line."""
    arm = elastic(rods(folder), **options)
    return arm, arm.along((0.1, 1.6), (1.0, 0.5, 0.0), 0.2)


def two_slides(folder):
    """The two slides, and 0.25 m along the first, upwards."""
    path = slides(folder, axis="0 0 1")
    arm = elastic(path, joint_stiffness=(1.9e5, 1e5), joint_damping=(50.4, 50.0))
    return arm, arm.along((0.0, 0.0), (0.0, 0.0, 1.0), 0.25)


@pytest.mark.parametrize(("coupling", "sagging"), [
    (ig.Rigid(), 5.35), (ig.SpringDamper(50.0), 0.0), (ig.Bistable(), 5.225),  # kg; the tool is held along the line
], ids=["rigid", "spring", "bistable"])  # fmt: skip
def test_upright_slides_are_one_mass_that_sags_on_a_spring(coupling, sagging, tmp_path):
    """Nothing rotates: the compiled solver has the same equations, from m g / k farther away."""
    (arm, approach), scene = two_slides(tmp_path), replace(SCENE, coupling=coupling)
    assert arm.units == ("m", "m")
    chain = replace(scene, robot=ig.Robot(5.225, 1.9e5, 50.4), object=ig.Object(0.25, 0.1 + sagging * G / 1.9e5))
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


def test_error_of_a_rigid_robot_is_inverse_to_the_stiffness(tmp_path):
    """Over three decades: all arms follow the same line."""
    scene, (_, approach) = replace(SCENE, contact=ig.Contact(1e4, 0.5)), two_rods(tmp_path)
    rigid, off = ig.simulate(scene, PAPERS, duration=0.3, rtol=1e-11).object_velocity, []
    for factor in (1e2, 1e5):
        springs, dampers = (9e3 * factor, 4e3 * factor), (5.0 * factor, 2.0 * factor)
        arm = elastic(rods(tmp_path), joint_stiffness=springs, joint_damping=dampers)
        off.append(all_joints.simulate(arm, approach, scene, PAPERS, duration=0.3, rtol=1e-9).object_velocity - rigid)
    assert off[0] / off[1] == pytest.approx(1e3, rel=0.02)


def test_good_servo_is_nearly_exact_and_a_bad_one_has_a_status(tmp_path):
    arm, approach = two_rods(tmp_path, rotor_inertia=1e-4, gear=100.0)
    assert arm.rotors == pytest.approx([1.0, 1.0])
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
    peak = max(force(y, chi) for y in states)
    return flight.t[-1], contact.t[-1], closing, contact.y[5, -1], peak, sideways


def test_all_joints_obey_lagranges_equations(tmp_path):
    arm, approach = two_rods(tmp_path)
    line = [complex(*vector[:2]) for vector in (approach.start, approach.direction)]
    touched, parted, closing, velocity, peak, sideways = lagrange(*line)
    motion = ig.Trapezoid(2.0, 8.0)  # it still accelerates at the contact
    ours = all_joints.simulate(arm, approach, SCENE, motion, duration=parted + 1e-4, rtol=1e-10)
    assert (ours.status, ours.contact_count) == ("ok", 1)
    assert ours.touch_time == pytest.approx(touched, abs=1e-8)
    assert (ours.impact_velocity, ours.object_velocity) == pytest.approx((closing, velocity), abs=1e-7)
    assert ours.contact_time == pytest.approx(parted - touched, rel=1e-6)
    assert ours.peak_force == pytest.approx(peak, rel=1e-5)
    assert ours.sideways == pytest.approx(max(sideways), rel=1e-3)


def test_leaving_the_line_and_too_much_work_have_a_status(tmp_path):
    run = partial(all_joints.simulate, *two_rods(tmp_path), SCENE, duration=2.0)
    beyond, back = run(ig.Trapezoid(0.5, 8.0)), run(ig.Motion((0.0, 0.1, 0.3), (0.0, 0.2, -0.4)))
    assert beyond.status == "the motion leaves the line at 0.4313 s"  # 0.2 m at 0.5 m/s and 0.5 m/s at 8 m/s^2
    assert back.status.startswith("the motion leaves the line")
    assert (back.touch_time, back.impact_velocity, back.contact_time) == (None, None, None)
    assert run(PAPERS, most_evaluations=100).status == "more than 100 evaluations of the equations"


@pytest.mark.parametrize(("arm", "options", "tolerance"), [
    (two_rods, {"joint_stiffness": (9e4, 4e4)}, 0.005), (two_slides, {}, 1e-5),
])  # fmt: skip
def test_advise_compares_one_mass_with_all_joints(arm, options, tolerance, tmp_path):
    arm = arm(tmp_path, **options)
    advice = ig.advise(SCENE, PAPERS, tolerance, duration=0.3, arm=arm)
    true = all_joints.simulate(*arm, SCENE, PAPERS, duration=0.3).object_velocity
    for model in advice.tried[1:]:
        chain = ig.simulate(model.simplify(SCENE), PAPERS, duration=0.3).object_velocity
        assert model.errors.tolist() == [abs(chain - true) / true]
    off = {model.name: model.bound for model in advice.tried}
    one_mass = {name for name in off if name.startswith("robot one mass")}
    assert {"robot rigid", "robot one mass, held"} < set(off)
    assert ("robot one mass, effective" in off) == bool(options)  # for the slides it is the same
    assert advice.model.name in one_mass
    assert advice.model.bound <= tolerance < off["robot rigid"]
    if not options:  # the slides are one mass on a spring
        assert max(off[name] for name in one_mass) < 1e-6
    assert ig.advise(SCENE, PAPERS, 1e-12, duration=0.3, arm=arm).model.name == "all joints"
