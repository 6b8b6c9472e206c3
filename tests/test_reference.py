"""The slow solver against closed forms, conservation laws and a second, naive reading.

That it comes to the golden tables and the paper's numbers is tested where the fast one is.
"""

from math import acos, acosh, exp, hypot, sqrt
from types import SimpleNamespace as Record

import pytest
from naive_chain import naive
from reference_scenes import CLOSURES, CRUISE, MOTION, RIGID, ROBOT, TABLE, bistable, law, scene, spring
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


@pytest.mark.parametrize(
    ("zeta", "restitution"),
    [
        (0.0, 1.0),
        (0.3, exp(-2 * 0.3 * acos(0.3) / sqrt(1 - 0.3**2))),
        (1.0, exp(-2)),
        (4.0, exp(-2 * 4.0 * acosh(4.0) / sqrt(4.0**2 - 1))),
    ],
)
def test_restitution_of_a_stop_is_that_of_a_spring_and_damper_that_never_pulls(zeta, restitution):
    # a spring of next to no force lets the tool stand still until the rear stop takes it, at the flange's 1 m/s
    coupling = bistable(stiffness=1e-9, front_stop=5e-3, rear_stop=-5e-3, stop_damping_ratio=zeta)
    motion = Record(speed=1.0, acceleration=1e3, brake=None)
    outcome = simulate(scene(coupling=coupling, distance=50.0), motion, 0.017)
    assert outcome.tool_velocity - 1 == pytest.approx(restitution, rel=1e-7)
    assert len(outcome.snap_through) == 1


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


@pytest.mark.parametrize("robot", [None, ROBOT], ids=["imposed", "robot"])
@pytest.mark.parametrize("coupling", [RIGID, spring(150.0), bistable()], ids=["rigid", "spring", "bistable"])
def test_momentum_over_a_contact_is_the_impulse_of_the_coupling(coupling, robot):
    outcome = simulate(scene(1e3, 0.3, coupling, robot), MOTION, 1.5)
    contact = only(outcome)
    moving = 0.125 + (robot.mass if robot is not None and coupling is RIGID else 0.0)
    gained = contact.object_velocity - contact.separation_velocity - contact.approach_velocity
    exchanged = moving * gained + 0.25 * contact.object_velocity
    assert outcome.coupling_impulse == pytest.approx(exchanged, abs=1e-9 * moving)  # paper, eq. 20-21
    assert contact.impulse == pytest.approx(0.25 * outcome.object_velocity, rel=1e-12)


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
