"""All joints at once: against the compiled solver for an arm that is one mass, laws, and limits."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from made_up_arms import LENGTHS, elastic, rods, slides
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


def lagrange(arm, approach):
    """The first contact by Lagrange's equations of the two links; motors by inverse kinematics; another method.

    Flange, Jacobian and mass matrix are the arm's; test_robot.py compares them with an independent chain.
    """
    (a, b), m, k_c = LENGTHS, 0.125, 1e5
    u, begin, K, D = approach.direction[:2], approach.start[:2], np.array([9e3, 4e3]), np.array([5.0, 2.0])

    def off(q):  # flange from the start of the line
        return arm.flange(q)[0][:2] - begin

    def jacobian(q):
        return arm.jacobian(q)[:2]

    def mass(q):
        return arm.mass_matrix(q) + m * jacobian(q).T @ jacobian(q)

    def motors(t):
        s, speed = (4.0 * t * t, 8.0 * t) if t < 0.0625 else (0.5 * (t - 0.03125), 0.5)
        x, y = begin + s * u
        elbow = np.arccos((x * x + y * y - a * a - b * b) / (2 * a * b))
        q = np.array([np.arctan2(y, x) - np.arctan2(b * np.sin(elbow), a + b * np.cos(elbow)), elbow])
        return q, np.linalg.solve(jacobian(q), u * speed)

    def gap(t, y):
        return u @ off(y[:2]) - y[4]

    def force(t, y, chi):
        return (k_c + chi * (u @ jacobian(y[:2]) @ y[2:4] - y[5])) * max(gap(t, y), 0.0) ** 1.5

    def rates(t, y, chi=None):  # chi None: no contact
        q, v, (q_m, v_m) = y[:2], y[2:4], motors(t)
        slopes = np.array([mass(q + step) - mass(q - step) for step in 1e-5 * np.eye(2)]) / 2e-5
        turning = np.tensordot(v, slopes, 1) @ v - 0.5 * (slopes @ v @ v)
        F = 0.0 if chi is None else max(force(t, y, chi), 0.0)
        torques = K * (q_m - q) + D * (v_m - v) - turning - jacobian(q).T @ u * F
        return [*v, *np.linalg.solve(mass(q), torques), y[5], F / 0.25]

    gap.terminal = True
    solve = partial(solve_ivp, method="RK45", events=gap, rtol=1e-10, atol=1e-13, dense_output=True)
    ramp = solve(rates, (0.0, 0.0625), [*approach.joint_angles[0], 0.0, 0.0, 0.1, 0.0])
    flight = solve(rates, (0.0625, 1.0), ramp.y[:, -1])
    met, touched = flight.y[:, -1], flight.t[-1]
    closing = u @ jacobian(met[:2]) @ met[2:4]
    chi, gap.direction = 1.5 * (1 - 0.5) / 0.5 * k_c / closing, -1.0  # Hu and Guo
    contact = solve(partial(rates, chi=chi), (touched, 1.0), met)
    looked = [(t, contact.sol(t)) for t in np.linspace(touched, contact.t[-1], 4001)]
    sideways = [abs(np.linalg.det([off(y[:2]), u])) for _, y in looked]
    peak = max(force(t, y, chi) for t, y in looked)
    return touched, contact.t[-1], closing, contact.y[5, -1], peak, sideways


def test_all_joints_are_those_of_an_independent_simulation(tmp_path):
    arm, approach = two_rods(tmp_path)
    touched, parted, closing, velocity, peak, sideways = lagrange(arm, approach)
    motion, duration = ig.Trapezoid(0.5, 8.0), parted + 1e-4
    ours = all_joints.simulate(arm, approach, SCENE, motion, duration=duration, rtol=1e-10)
    assert (ours.status, ours.contact_count) == ("ok", 1)
    assert ours.touch_time == pytest.approx(touched, abs=1e-8)
    assert ours.impact_velocity == pytest.approx(closing, abs=1e-7)
    assert ours.object_velocity == pytest.approx(velocity, abs=1e-7)
    assert ours.contact_time == pytest.approx(parted - touched, rel=1e-6)
    assert ours.peak_force == pytest.approx(peak, rel=1e-5)
    assert ours.sideways == pytest.approx(max(sideways), rel=1e-3)
    assert sideways[-1] < 0.9 * ours.sideways  # not largest at the end of the contact


def test_leaving_the_line_and_too_much_work_have_a_status(tmp_path):
    run = partial(all_joints.simulate, *two_rods(tmp_path), SCENE, duration=2.0)
    beyond, back = run(ig.Trapezoid(0.5, 8.0)), run(ig.Motion((0.0, 0.1, 0.3), (0.0, 0.2, -0.4)))
    assert beyond.status == "the motion leaves the line at 0.4313 s"  # 0.2 m at 0.5 m/s and 0.5 m/s at 8 m/s^2
    assert back.status.startswith("the motion leaves the line")
    assert (back.touch_time, back.impact_velocity, back.contact_time) == (None, None, None)
    assert run(PAPERS, most_evaluations=100).status == "more than 100 evaluations of the equations"


@pytest.mark.parametrize(("arm", "options", "tolerance", "masses"), [
    (two_rods, {"joint_stiffness": (9e4, 4e4)}, 0.05, {"robot one mass, held", "robot one mass, effective"}),
    (two_slides, {}, 1e-5, {"robot one mass, held"}),
])  # fmt: skip
def test_advise_compares_one_mass_with_all_joints(arm, options, tolerance, masses, tmp_path):
    arm = arm(tmp_path, **options)
    advice = ig.advise(SCENE, PAPERS, tolerance, duration=0.3, arm=arm)
    true = all_joints.simulate(*arm, SCENE, PAPERS, duration=0.3).object_velocity
    for model in advice.tried[1:]:
        chain = ig.simulate(model.simplify(SCENE), PAPERS, duration=0.3).object_velocity
        assert model.errors.tolist() == [abs(chain - true) / true]
    off = {model.name: model.bound for model in advice.tried}
    assert {"robot rigid", *masses} < set(off)
    assert advice.model is not advice.tried[0]
    assert advice.model.bound <= tolerance
    if not options:  # the slides are one mass on a spring
        assert advice.model.name.startswith("robot one mass")
        assert max(off[name] for name in off if name.startswith("robot one mass")) < 1e-6 < off["robot rigid"]
    assert ig.advise(SCENE, PAPERS, 1e-12, duration=0.3, arm=arm).model.name == "all joints"
