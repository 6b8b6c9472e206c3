"""The independent solver: conservation of energy, and the floor of its damping.

The tests of the fast solver also compare the independent one with golden tables, closed forms and the paper's numbers.
tests/solver/test_agreement.py compares the two on random chains.
"""

from math import hypot

import pytest
from scenes import CRUISE, scene

import impact_gym as ig
from experiments.reference import simulate
from experiments.reference.chain import Chain
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
