"""The slow solver against conservation of energy and a second, naive reading; and its parts.

That it comes to closed forms, golden tables and the paper's numbers is tested where the fast one is.
"""

from math import hypot, pi
from types import SimpleNamespace as Record

import numpy as np
import pytest
import scenes
from naive_chain import naive
from reference_scenes import CLOSURES, CRUISE, MOTION, RIGID, ROBOT, TABLE, bistable, law, scene, spring

import impact_gym as ig
from experiments.reference import simulate
from experiments.reference.chain import Chain, Scales, System
from experiments.reference.command import Command
from experiments.reference.phases import Switch, advance
from impact_gym.physics import dissipation


def energy(case, outcome, t):
    """In the frame of the cruise, in which the object ahead of an undamped chain moves, J."""
    coupling, robot = case.coupling, case.robot
    deflection = outcome.flange_position - outcome.tool_position
    stored = 0.5 * coupling.stiffness * deflection**2
    if hasattr(coupling, "height"):
        x = Chain(case, CRUISE).bistable.x0 - deflection
        stored = 0.5 * coupling.stiffness * (coupling.free_length - hypot(coupling.height, x)) ** 2
        stored += 0.5 * coupling.stop_stiffness * max(0.0, x - coupling.front_stop, coupling.rear_stop - x) ** 2
    if robot is not None:
        lag = t - 1 / 16 - outcome.flange_position
        stored += 0.5 * robot.stiffness * lag**2 + 0.5 * robot.mass * (outcome.flange_velocity - 1) ** 2
    return stored + 0.5 * (0.125 * (outcome.tool_velocity - 1) ** 2 + 0.25 * (outcome.object_velocity - 1) ** 2)


@pytest.mark.parametrize("robot", [None, Record(mass=5.225, stiffness=1.5e5, damping=0.0)], ids=["imposed", "robot"])
@pytest.mark.parametrize("coupling", [spring(150.0, 0.0), bistable(stop_damping_ratio=0.0)], ids=["spring", "bistable"])
def test_energy_is_kept_in_the_frame_of_the_cruise(coupling, robot):
    case, times = scene(1e4, 1.0, coupling, robot), (0.3, 0.6, 1.0)
    outcomes = [simulate(case, CRUISE, t) for t in times]
    assert len(outcomes[-1].contacts) >= 1
    assert outcomes[-1].snap_through or not hasattr(coupling, "height")
    before, *after = (energy(case, outcome, t) for outcome, t in zip(outcomes, times, strict=True))
    assert after == pytest.approx([before] * 2, rel=1e-9)


NAIVE = {
    "robot": scene(robot=ROBOT),
    "robot, spring": scene(coupling=spring(150.0), robot=ROBOT),
    "bistable, robot": scene(1e3, 0.3, bistable(), ROBOT),
    "table": scene(robot=TABLE),
    "table, spring, linear contact": scene(1e4, 0.6, spring(150.0), TABLE, **law("flores", 1.0, 0.0)),
    "table, bistable": scene(1e3, 0.1, bistable(), TABLE),
}


@pytest.mark.parametrize("name", NAIVE)
def test_a_naive_solver_in_absolute_coordinates_agrees(name):
    outcome, other = simulate(NAIVE[name], MOTION, 1.0), naive(NAIVE[name], MOTION, 1.0, CLOSURES)
    assert outcome.object_velocity == pytest.approx(other.object_velocity, rel=3e-9)
    assert outcome.tool_velocity == pytest.approx(other.tool_velocity, abs=3e-9)
    assert outcome.object_position == pytest.approx(other.object_position, abs=3e-9)
    assert outcome.detection_time == pytest.approx(other.detection_time, abs=1e-10)
    assert outcome.snap_through == pytest.approx(other.snap_through, abs=1e-7)


def first_turn(switches, method="DOP853"):
    """x'' = -x from (0, 1): x = sin(tau)."""
    swing = Record(rates=lambda _, y: [y[1], -y[0]], jacobian=lambda _, y: np.array([[0.0, 1.0], [-1.0, 0.0]]))
    return advance(swing, 10.0, np.array([0.0, 1.0]), switches, method, 1e-11, np.full(2, 1e-13), np.inf)


@pytest.mark.parametrize("method", ["DOP853", "Radau", "LSODA"])
@pytest.mark.parametrize("above", [1e-3, 1e-6, 1e-8])
def test_a_switch_that_turns_there_and_back_within_a_step_is_found(above, method):
    tau, y, switch = first_turn([Switch("touch", False, lambda _, y: y[0] - (1 - above))], method)
    assert switch is not None
    # the closer to the summit, the less an error of x says about the time
    assert tau == pytest.approx(np.arcsin(1 - above), abs=1e-10 / np.sqrt(2 * above))
    assert y[0] == pytest.approx(1 - above, abs=1e-10)
    assert first_turn([Switch("touch", False, lambda _, y: y[0] - (1 + above))], method)[2] is None


def test_the_first_of_two_switches_counts_and_one_on_the_wrong_side_turns_at_once():
    late, early = (Switch(name, True, lambda _, y, x=x: x - y[0]) for name, x in (("late", 0.6), ("early", 0.5)))
    tau, _, switch = first_turn([late, early])
    assert (switch.name, tau) == ("early", pytest.approx(pi / 6, rel=1e-12))
    tau, y, switch = first_turn([Switch("wrong", True, lambda _, y: y[0] - 2.0)])
    assert (switch.name, tau, y.tolist()) == ("wrong", 0.0, [0.0, 1.0])


CHAINS = {
    "rigid": (RIGID, None),
    "robot": (RIGID, ROBOT),
    "spring": (spring(150.0, 0.4), None),
    "table, spring": (spring(150.0), TABLE),
    "bistable, robot": (bistable(), ROBOT),
}


@pytest.mark.parametrize("exponents", [(1.5, 1.5), (1.0, 0.0), (2.0, 1.5)])
@pytest.mark.parametrize("name", CHAINS)
def test_the_jacobian_is_that_of_the_rates(name, exponents):
    chain = Chain(scene(1e4, 0.4, *CHAINS[name], **law("hu-guo", *exponents)), MOTION)
    chain.on["rear"] = True
    system = System(chain, Scales(2e-3, 3e-3, 7.0), touching=True)
    system.enter(0.2, 0.0)
    for y in np.random.default_rng(5).uniform(0.2, 1.5, (5, 8)):
        steps = 1e-5 * np.eye(8)
        columns = [np.subtract(system.rates(0.1, y + h), system.rates(0.1, y - h)) / 2e-5 for h in steps]
        jacobian = system.jacobian(0.1, y)
        assert jacobian == pytest.approx(np.array(columns).T, rel=1e-6, abs=1e-6 * abs(jacobian).max())


@pytest.mark.parametrize("name", CHAINS)
def test_an_implicit_method_comes_to_the_same(name):
    case = scene(1e4, 0.4, *CHAINS[name])
    explicit, implicit = simulate(case, MOTION, 1.0), simulate(case, MOTION, 1.0, rtol=1e-9, method="Radau")
    assert implicit.object_velocity == pytest.approx(explicit.object_velocity, rel=1e-7)
    assert implicit.peak_force == pytest.approx(explicit.peak_force, rel=1e-7)
    assert implicit.snap_through == pytest.approx(explicit.snap_through, abs=1e-8)


def test_below_its_floor_the_approach_velocity_counts_as_the_floor_in_the_damping():
    slow = Record(speed=1e-7, acceleration=1e-3, brake=None)  # m/s, a tenth of the floor
    outcome = simulate(scene(1e5, 0.1, distance=1e-8), slow, 1.0)
    (contact,) = outcome.contacts
    assert contact.approach_velocity == pytest.approx(1e-7, rel=1e-9)
    delivered = dissipation.delivered(1.5 * 0.9 / 0.1 * 0.1)
    assert contact.separation_velocity == pytest.approx(1e-7 * delivered, rel=1e-8)


def test_the_command_is_cut_at_nodes_and_keeps_its_position_through_the_brake():
    command = Command(MOTION, nodes=(0.01, 0.2, 0.35))
    assert command.at(0.0)[3] == pytest.approx((2 * 0.01 / 8) ** 0.5, rel=1e-12)
    assert command.at(command.at(0.0)[3])[3] == 0.125
    assert command.at(0.125)[3] == pytest.approx(0.2 + 1 / 16, rel=1e-12)
    command.detect(0.3)
    assert command.at(0.3)[3] == 0.316
    x, v, a, cut = command.at(0.35)
    assert (v, a) == (pytest.approx(1 - 8 * 0.034, rel=1e-12), -8.0)
    assert x == pytest.approx(0.316 - 1 / 16 + 0.034 - 4 * 0.034**2, rel=1e-12)
    assert cut == 0.316 + 0.125  # comes to rest before the last node
    assert command.at(1.0)[:3] == (pytest.approx(0.316, rel=1e-12), 0.0, 0.0)


@pytest.mark.parametrize(
    ("changes", "options", "says"),
    [
        ({"e": 0.5, "dissipation": "guess"}, {}, "no dissipation 'guess'"),
        ({}, {"method": "Euler"}, "method must be one of"),
        ({"coupling": Record(stiffness=1.0)}, {}, "no coupling like"),
    ],
)
def test_what_it_does_not_know_it_refuses(changes, options, says):
    with pytest.raises((ValueError, NotImplementedError), match=says):
        simulate(scene(**changes), CRUISE, 0.1, **options)


def test_the_records_of_the_package_read_the_same():
    nodes = {name: tuple(values.tolist()) for name, values in vars(TABLE).items()}
    packaged = scenes.scene(1e3, 0.3, ig.Bistable(), ig.RobotTable(**nodes), **law("flores", 1.5, 1.0))
    plain = scene(1e3, 0.3, bistable(), TABLE, **law("flores", 1.5, 1.0))
    motion = ig.Trapezoid(1.0, 8.0, ig.Brake(1.0, 0.016, 8.0))
    assert simulate(packaged, motion, 0.6) == simulate(plain, MOTION, 0.6)
