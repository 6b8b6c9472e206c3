"""The slow solver against closed forms, printed numbers, conservation laws and a second, naive reading."""

from math import acos, acosh, exp, hypot, sin, sqrt
from types import SimpleNamespace as Record

import numpy as np
import pytest
from golden import BEHIND_A_SPRING, CRITICAL_PUSH, IMPACT_VELOCITY, OBJECT_VELOCITIES, PUSHED, SHAPES
from naive_chain import naive
from reference_scenes import CLOSURES, CRUISE, MOTION, RIGID, ROBOT, TABLE, bistable, law, scene, spring
from scipy.optimize import brentq
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


@pytest.mark.parametrize(("m", "n"), [(1.5, 1.5), (1.0, 1.0), (1.0, 0.0), (1.5, 0.0), (2.0, 1.5), (1.5, 2.0)])
def test_exact_dissipation_delivers_the_restitution(m, n):
    for e, m_p in ((0.1, 0.25), (0.5, 0.25), (0.5, 2.5), (0.9, 0.25), (1.0, 0.25)):
        contact = only(simulate(scene(1e4, e, m_p=m_p, **law("exact", m, n)), CRUISE, 2.5))
        assert contact.separation_velocity == pytest.approx(e, rel=1e-9)


@pytest.mark.parametrize("zeta", [0.2, 0.6, 0.95])
def test_linear_contact_is_the_closed_form(zeta):
    rate = sqrt(1e4 / 0.25)  # rad/s, undamped; the object against an imposed tool at 1 m/s
    damped = rate * sqrt(1 - zeta**2)
    clamped = 2 * acos(zeta) / damped  # the spring and damper would begin to pull
    e = exp(-zeta * rate * clamped)
    d = brentq(lambda x: 3 / 2 * (1 - x) / x - 2 * zeta, 1e-3, 1.0)  # Hu-Guo's restitution that gives d = 2 zeta
    contact = only(simulate(scene(1e4, d, **law("hu-guo", 1.0, 0.0)), CRUISE, 1.5))
    assert contact.separation_velocity == pytest.approx(e, rel=1e-9)
    coasting = e * sin(damped * clamped) / damped / e  # s, over the penetration that is left
    assert contact.end - contact.start == pytest.approx(clamped + coasting, rel=1e-9)
    time_of_peak = max(0.0, (3 * acos(zeta) - np.pi) / damped)
    decay, angle = exp(-zeta * rate * time_of_peak), damped * time_of_peak
    force = decay * (np.cos(angle) * 2 * zeta + (1 - 2 * zeta**2) / sqrt(1 - zeta**2) * sin(angle)) * 0.25 * rate
    assert contact.peak_force == pytest.approx(force, rel=1e-9)


def test_a_force_that_jumps_is_felt_at_once():
    outcome = simulate(scene(1e4, 0.3, **law("hu-guo", 1.0, 0.0)), MOTION, 1.5)
    assert outcome.detection_time == only(outcome).start
    assert only(outcome).peak_force == pytest.approx(3.5 * sqrt(1e4 * 0.25), rel=1e-9)  # c v, falling from there


@pytest.mark.parametrize("e", SHAPES)
def test_golden_scales_of_an_isolated_contact(e):
    contact, (duration, _, peak) = only(simulate(scene(e=e), CRUISE, 1.5)), SHAPES[e]
    delta0 = (0.25 / 1e5) ** 0.4  # m, and t0 in s at 1 m/s
    assert (contact.end - contact.start) / delta0 == pytest.approx(duration, rel=1e-9)
    assert contact.peak_force / (1e5 * delta0**1.5) == pytest.approx(peak, rel=1e-9)


def pushed(e, phi, wait=60.0):
    """One contact at 1 m/s, flange accelerated by phi v/t0 throughout."""
    a = 10.0  # m/s^2
    t0 = abs(phi) / a
    k_c = 0.25 / t0**2.5
    motion = Record(speed=1e3, acceleration=a, brake=None)
    begun, distance = 1 / a, 0.5 / a
    if phi < 0:
        motion = Record(speed=1.0, acceleration=a, brake=Record(threshold=0.0, delay=0.0, deceleration=a))
        begun, distance = 1 / a + 0.1, 0.5 / a + 0.1
    return simulate(scene(k_c, e, distance=distance), motion, begun + min(wait, 19 if phi < 0 else wait) * t0), t0


@pytest.mark.parametrize(("e", "phi"), PUSHED)
def test_golden_contact_under_push(e, phi):
    outcome, t0 = pushed(e, phi)
    contact, (speed, duration) = outcome.contacts[0], PUSHED[e, phi]
    assert contact.separation_velocity == pytest.approx(speed, abs=1e-9)
    assert (contact.end - contact.start) / t0 == pytest.approx(duration, abs=1e-6)


@pytest.mark.parametrize("e", CRITICAL_PUSH)
def test_a_contact_ends_below_the_golden_push_and_not_above(e):
    below, above = (pushed(e, side * CRITICAL_PUSH[e], 200.0)[0].contacts[0] for side in (0.9999, 1.0001))
    assert below.end is not None
    assert above.end is None


@pytest.mark.parametrize(("e", "k_c", "duration", "object_velocity"), BEHIND_A_SPRING)
def test_golden_contact_of_a_settled_sprung_tool(e, k_c, duration, object_velocity):
    contact = simulate(scene(k_c, e, spring(150.0), distance=3.0), CRUISE, 3.5).contacts[0]
    assert contact.end - contact.start == pytest.approx(duration, abs=5.1e-11)  # half of the last digit given
    assert contact.object_velocity == pytest.approx(object_velocity, abs=5.1e-10)


@pytest.mark.parametrize(("figure", "m_p", "k_c"), [("13b", 0.25, 1e5), ("14a", 2.5, 1e5), ("14b", 2.5, 1e6)])
def test_printed_figures_13b_and_14(figure, m_p, k_c):
    outcome = simulate(scene(k_c, robot=ROBOT, m_p=m_p, distance=0.280), MOTION, 1.5)
    assert outcome.object_velocity == pytest.approx(OBJECT_VELOCITIES[figure], abs=5e-5)
    assert only(outcome).approach_velocity == pytest.approx(IMPACT_VELOCITY, abs=5e-5)


def test_printed_figures_23_to_25():
    snapping, sprung, rigid = (simulate(scene(1e3, 0.1, one), MOTION, 1.5) for one in (bistable(), spring(50.0), RIGID))
    assert snapping.object_velocity == pytest.approx(OBJECT_VELOCITIES["23a"], abs=5e-6)
    assert snapping.coupling_impulse == pytest.approx(0.0058, abs=5e-5)
    assert sprung.coupling_impulse == pytest.approx(0.0791, abs=5e-5)
    assert 1 - snapping.object_velocity / rigid.object_velocity == pytest.approx(0.510, abs=5e-4)
    (crossing,) = snapping.snap_through
    assert only(snapping).start < crossing < only(snapping).end
    for rear_stop in (-0.01, -0.03):  # "any value gives the same object velocity"
        moved = simulate(scene(1e3, 0.1, bistable(rear_stop=rear_stop)), MOTION, 1.5)
        assert moved.object_velocity == pytest.approx(snapping.object_velocity, rel=1e-12)


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


@pytest.mark.parametrize("robot", [None, Record(mass=5.225, stiffness=1.5e5, damping=0.0)], ids=["imposed", "robot"])
@pytest.mark.parametrize("coupling", [spring(150.0, 0.0), bistable(stop_damping_ratio=0.0)], ids=["spring", "bistable"])
def test_energy_is_kept_in_the_frame_of_the_cruise(coupling, robot):
    case = scene(1e4, 1.0, coupling, robot)
    chain = Chain(case, CRUISE)

    def energy(outcome, t):
        deflection = outcome.flange_position - outcome.tool_position
        stored = 0.5 * coupling.stiffness * deflection**2
        if chain.bistable is not None:
            x = chain.bistable.x0 - deflection
            stored = 0.5 * coupling.stiffness * (coupling.free_length - hypot(coupling.height, x)) ** 2
            stored += 0.5 * coupling.stop_stiffness * max(0.0, x - coupling.front_stop, coupling.rear_stop - x) ** 2
        if robot is not None:
            lag = t - 1 / 16 - outcome.flange_position
            stored += 0.5 * robot.stiffness * lag**2 + 0.5 * robot.mass * (outcome.flange_velocity - 1) ** 2
        moving = 0.125 * (outcome.tool_velocity - 1) ** 2 + 0.25 * (outcome.object_velocity - 1) ** 2
        return stored + 0.5 * moving

    before, *after = [(simulate(case, CRUISE, t), t) for t in (0.3, 0.6, 1.0)]
    assert len(after[-1][0].contacts) >= 1
    assert len(after[-1][0].snap_through) >= (1 if chain.bistable else 0)
    for outcome, t in after:
        assert energy(outcome, t) == pytest.approx(energy(*before), rel=1e-9)


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
