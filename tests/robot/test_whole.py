"""All joints at once: against the compiled solver where an arm is one mass, laws, limits, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from arms import slides, two_links
from scipy.integrate import solve_ivp

import impact_gym as ig
from impact_gym.fidelity import advise
from impact_gym.robot import Line, follow, from_urdf, whole

pytest.importorskip("mujoco", reason="the extra robot is not installed")
COUPLINGS = (ig.Rigid(), ig.SpringDamper(50.0), ig.Bistable())
SCENE = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.1), ig.Contact(1e5, 0.5))
PAPERS = ig.Trapezoid(0.5, 8.0, ig.Brake())


def elastic(folder, factor=1.0, damping=(5.0, 2.0), **options):
    """The two links, joints `factor` times as stiff, and 0.1 m along a line."""
    stiffness = (9e3 * factor, 4e3 * factor)
    arm = from_urdf(two_links(folder), "base", "tip", joint_stiffness=stiffness, joint_damping=damping, **options)
    softer = from_urdf(two_links(folder), "base", "tip", joint_stiffness=(9e3, 4e3), joint_damping=damping)
    return arm, follow(softer, Line((0.2, 1.4), (1.0, 0.5, 0.0), ahead=0.1, behind=0.1))


@pytest.mark.parametrize("coupling", COUPLINGS, ids=lambda each: type(each).__name__)
def test_two_slides_are_the_chain_with_one_mass_on_a_spring(coupling, tmp_path):
    """Nothing turns, so every mass is that of both carriages and the compiled solver has the same equations."""
    arm = from_urdf(slides(tmp_path), "base", "tip", joint_stiffness=(1.9e5, 1e5), joint_damping=(50.4, 50.0))
    approach = follow(arm, Line((0.0, 0.0), ahead=0.1, behind=0.1))
    robot = ig.Robot(5.225, 1.9e5, 50.4)
    scene = replace(SCENE, coupling=coupling)
    ours = ig.simulate(replace(scene, robot=robot), PAPERS, duration=0.4)
    theirs = whole.simulate(arm, approach, scene, PAPERS, duration=0.4, rtol=1e-10)
    assert theirs.status == "ok"
    assert theirs.object_velocity == pytest.approx(ours.object_velocity, abs=1e-7)
    assert theirs.peak_force == pytest.approx(ours.peak_force, rel=1e-5)  # sampled
    assert theirs.contact_count == len(ours.contacts)
    first = ours.contacts[0]
    assert theirs.contact_time == pytest.approx(first.end - first.start, rel=1e-6)
    assert theirs.impulse == pytest.approx(0.25 * ours.object_velocity, abs=1e-7)
    assert max(theirs.sideways, theirs.turn) < 1e-12


def test_energy_and_momentum_stay_where_nothing_damps(tmp_path):
    """The arm stands, its motors too; the object comes, touches and leaves."""
    arm, approach = elastic(tmp_path, damping=0.0)
    scene = replace(SCENE, contact=ig.Contact(1e5, 1.0))
    made = whole._Whole(arm, approach, scene, whole._Path(whole.Reaction(())), True, False, False, None)
    y = made.begin(0.0)
    y[-2] = -0.4  # m/s, of the object
    assert made.damping == 0.0

    def energy(y):
        q, rates, (x, v) = y[:2], y[2:4], y[-3:-1]
        loaded, depth = made.arm.mass_matrix(q), max(made.seen(0.0, y)[-5] - x, 0.0)
        off = q - approach.joint_angles[0]
        return 0.5 * (rates @ loaded @ rates + off @ (arm.stiffness * off) + 0.25 * v * v) + 1e5 * depth**2.5 / 2.5

    done = solve_ivp(lambda t, y: made.rates(t, y, True), (0.0, 0.02), y, "DOP853", rtol=1e-12, atol=1e-14)
    found = [energy(state) for state in done.y.T]
    assert max(made.contact(made.seen(0.0, state)) for state in done.y.T) > 10.0
    assert np.ptp(found) < 1e-8 * found[0]
    assert done.y[-1, -1] == pytest.approx(0.25 * (done.y[-2, -1] + 0.4), rel=1e-8)  # impulse on the object


def test_stiffer_joints_come_to_a_rigid_robot_as_one_over_their_stiffness(tmp_path):
    """Over three decades."""
    scene = replace(SCENE, contact=ig.Contact(1e4, 0.5))
    rigid = ig.simulate(scene, PAPERS, duration=0.3).object_velocity
    off = []
    for factor in (10.0, 100.0, 1000.0):
        arm, approach = elastic(tmp_path, factor, damping=(5.0 * factor, 2.0 * factor))
        off.append(whole.simulate(arm, approach, scene, PAPERS, duration=0.3, rtol=1e-9).object_velocity - rigid)
    ratios = np.array(off[:-1]) / off[1:]
    assert ratios == pytest.approx([10.0, 10.0], rel=0.1)


@pytest.mark.parametrize("coupling", COUPLINGS[:2], ids=lambda each: type(each).__name__)
def test_small_motion_is_the_linear_one(coupling, tmp_path):
    """M and J as they are at the impact, the paper's step from eq. 10 to eq. 11: what it leaves out goes as the way."""
    arm, _ = elastic(tmp_path)
    off = []
    for size in (1e-3, 1e-4, 1e-5):
        approach = follow(arm, Line((0.2, 1.4), (1.0, 0.5, 0.0), ahead=0.1 * size, behind=0.1 * size, spacing=1e-4))
        scene = replace(SCENE, object=ig.Object(0.25, 0.1 * size), coupling=coupling)
        scene = replace(scene, contact=ig.Contact(1e5 / size**0.5, 0.5))  # scales with the way: a force of that size
        motion = ig.Trapezoid(0.5 * size, 8.0 * size)
        given = {"duration": 0.28, "rtol": 1e-11}
        full, linear = (whole.simulate(arm, approach, scene, motion, linear=each, **given) for each in (False, True))
        off.append(abs(full.object_velocity / linear.object_velocity - 1.0))
    assert off[2] < 1e-6
    assert off[0] > 5.0 * off[1]


def test_weight_hangs_the_joints_and_coriolis_is_small_but_there(tmp_path):
    arm, approach = elastic(tmp_path)
    plain, still, heavy = (
        whole.simulate(arm, approach, SCENE, PAPERS, duration=0.3, **each).object_velocity
        for each in ({}, {"coriolis": False}, {"gravity": True})
    )
    assert plain == heavy  # the arm turns about the vertical
    assert 1e-7 < abs(plain - still) < 0.01 * plain


def test_good_servo_is_nearly_an_imposed_motion_and_a_bad_one_has_a_status(tmp_path):
    arm, approach = elastic(tmp_path, rotor_inertia=1e-4, gear=100.0)
    assert arm.rotors == pytest.approx([1.0, 1.0])
    imposed = whole.simulate(arm, approach, SCENE, PAPERS, duration=0.25).object_velocity
    servo = whole.simulate(arm, approach, SCENE, PAPERS, duration=0.25, servo=whole.Servo()).object_velocity
    assert servo == pytest.approx(imposed, rel=0.05)
    lost = whole.simulate(arm, approach, SCENE, PAPERS, duration=0.25, servo=whole.Servo(5000.0, 1.0, 2e-3))
    assert lost.status.startswith("the servo does not hold the arm on its line")
    assert np.isfinite(lost.object_velocity)


def test_advise_names_the_cheapest_mass_beside_all_joints(tmp_path):
    arm, approach = elastic(tmp_path, 10.0)
    approach = follow(arm, Line((0.2, 1.4), (1.0, 0.5, 0.0), ahead=0.1, behind=0.1))
    advice = advise(SCENE, PAPERS, 0.05, duration=0.3, arm=(arm, approach))
    true = whole.simulate(arm, approach, SCENE, PAPERS, duration=0.3).object_velocity
    for model in advice.tried[1:]:
        chain = ig.simulate(model.simplify(SCENE), PAPERS, duration=0.3).object_velocity
        assert model.errors.tolist() == [abs(chain - true) / true]
    assert {"robot rigid", "robot one mass, held", "robot one mass, effective"} < {model.name for model in advice.tried}
    assert advice.model.bound <= 0.05
    assert advice.model is not advice.tried[0]


@pytest.mark.parametrize(("change", "options", "message"), [
    ({"robot": ig.Robot(5.0, 1e5, 10.0)}, {}, "scene.robot"),
    ({"object": ig.Object(0.25, 0.1, friction=0.3)}, {}, "object.friction"),
    ({"object": ig.Object(0.25, 0.3)}, {}, "object.distance is 0.3 m, but the line ends after 0.2 m"),
    ({"contact": ig.Contact(1e5, 0.5, damping_exponent=1.0, dissipation="exact")}, {}, "damping_exponent"),
    ({}, {"servo": whole.Servo()}, "rotor_inertia"),
    ({}, {"duration": -1.0}, "duration"),
])  # fmt: skip
def test_scenes_that_it_has_no_equations_for_are_refused(change, options, message, tmp_path):
    arm, approach = elastic(tmp_path)
    with pytest.raises(ValueError, match=message):
        whole.simulate(arm, approach, replace(SCENE, **change), PAPERS, **{"duration": 0.2} | options)
