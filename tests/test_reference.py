"""The slow solver against closed forms, conservation laws and a second, naive reading.

That it comes to the golden tables and the paper's numbers is tested where the fast one is.
"""

from math import exp, hypot
from types import SimpleNamespace as Record

import pytest
from naive_chain import naive
from reference_scenes import CLOSURES, CRUISE, MOTION, ROBOT, TABLE, bistable, law, scene, spring
from scipy.special import lambertw

from experiments.reference import simulate
from experiments.reference.chain import Chain


def only(outcome):
    (contact,) = outcome.contacts
    return contact


@pytest.mark.parametrize("exponent", [1.0, 1.5, 3.0])
@pytest.mark.parametrize("dissipation", CLOSURES)
def test_restitution_of_equal_exponents_is_the_closed_form(dissipation, exponent):
    for e in (0.1, 0.5, 0.9):
        d = CLOSURES[dissipation](e)
        contact = only(simulate(scene(e=e, **law(dissipation, exponent, exponent)), CRUISE, 1.5))
        effective = (1 + lambertw(-(1 + d) * exp(-(1 + d))).real) / d
        assert contact.separation_velocity == pytest.approx(effective, rel=1e-9)


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
    "robot": scene(robot=ROBOT, distance=0.28),
    "robot, spring": scene(coupling=spring(150.0), robot=ROBOT),
    "bistable": scene(1e4, 0.9, bistable()),
    "bistable, robot": scene(1e3, 0.3, bistable(), ROBOT),
    "table": scene(robot=TABLE, distance=0.28),
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
