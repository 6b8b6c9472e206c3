"""The independent solver: conservation of energy, the floor of its damping, and its search for events.

The tests of the fast solver also compare the independent one with golden tables, closed forms and the paper's numbers.
tests/solver/test_agreement.py compares the two on random chains.
"""

from math import hypot, pi
from types import SimpleNamespace as Record

import numpy as np
import pytest
from scenes import CRUISE, scene

import impact_gym as ig
from experiments.reference import simulate
from experiments.reference.chain import Chain
from experiments.reference.integration import Switch, advance
from impact_gym.physics import dissipation


def energy(case, outcome, t):
    """Energy (J) of an undamped chain and the object in the frame of the cruise, in which the object moves."""
    coupling, robot = case.coupling, case.robot
    deflection = outcome.flange_position - outcome.tool_position
    stored = 0.5 * coupling.stiffness * deflection**2
    if isinstance(coupling, ig.Bistable):
        x = Chain(case, CRUISE).bistable.x0 - deflection
        stored = 0.5 * coupling.stiffness * (coupling.free_length - hypot(coupling.height, x)) ** 2
        stored += 0.5 * coupling.stop_stiffness * max(0.0, x - coupling.front_stop, coupling.rear_stop - x) ** 2
    if robot is not None:
        lag = t - 1 / 16 - outcome.flange_position
        stored += 0.5 * robot.stiffness * lag**2 + 0.5 * robot.mass * (outcome.flange_velocity - 1) ** 2
    return stored + 0.5 * (0.125 * (outcome.tool_velocity - 1) ** 2 + 0.25 * (outcome.object_velocity - 1) ** 2)


@pytest.mark.parametrize("robot", [None, ig.Robot(5.225, 1.5e5, 0.0)], ids=["imposed", "robot"])
@pytest.mark.parametrize("coupling", [ig.SpringDamper(150.0, 0.0), ig.Bistable(stop_damping_ratio=0.0)], ids=str)
def test_simulate_keeps_the_energy_in_the_frame_of_the_cruise(coupling, robot):
    case, times = scene(1e4, 1.0, coupling, robot), (0.3, 0.6, 1.0)
    outcomes = [simulate(case, CRUISE, t) for t in times]
    assert len(outcomes[-1].contacts) >= 1
    assert outcomes[-1].snap_through or isinstance(coupling, ig.SpringDamper)
    before, *after = (energy(case, outcome, t) for outcome, t in zip(outcomes, times, strict=True))
    assert after == pytest.approx([before] * 2, rel=1e-9)


def test_simulate_has_a_floor_for_the_approach_velocity_in_the_damping():
    outcome = simulate(scene(1e5, 0.1, distance=1e-8), ig.Trapezoid(1e-7, 1e-3), 1.0)  # m/s, a tenth of the floor
    (contact,) = outcome.contacts
    assert contact.approach_velocity == pytest.approx(1e-7, rel=1e-9)
    delivered = dissipation.delivered(1.5 * 0.9 / 0.1 * 0.1)
    assert contact.separation_velocity == pytest.approx(1e-7 * delivered, rel=1e-8)


def first_turn(switches, method="DOP853"):
    """x'' = -x from (0, 1): x = sin(tau)."""
    swing = Record(rates=lambda _, y: [y[1], -y[0]])
    return advance(swing, 10.0, np.array([0.0, 1.0]), switches, method, 1e-11, np.full(2, 1e-13), np.inf)


@pytest.mark.parametrize("method", ["DOP853", "Radau", "LSODA"])
@pytest.mark.parametrize("above", [1e-3, 1e-6, 1e-8])
def test_advance_finds_a_switch_that_turns_there_and_back_within_a_step(above, method):
    tau, y, switch = first_turn([Switch("touch", False, lambda _, y: y[0] - (1 - above))], method)
    assert switch is not None
    # near the maximum a small error of x is a large error of the time
    assert tau == pytest.approx(np.arcsin(1 - above), abs=1e-10 / np.sqrt(2 * above))
    assert y[0] == pytest.approx(1 - above, abs=1e-10)
    assert first_turn([Switch("touch", False, lambda _, y: y[0] - (1 + above))], method)[2] is None


def test_advance_stops_at_the_first_of_two_switches_and_at_once_on_the_wrong_side():
    late, early = (Switch(name, True, lambda _, y, x=x: x - y[0]) for name, x in (("late", 0.6), ("early", 0.5)))
    tau, _, switch = first_turn([late, early])
    assert (switch.name, tau) == ("early", pytest.approx(pi / 6, rel=1e-12))
    tau, y, switch = first_turn([Switch("wrong", True, lambda _, y: y[0] - 2.0)])
    assert (switch.name, tau, y.tolist()) == ("wrong", 0.0, [0.0, 1.0])
