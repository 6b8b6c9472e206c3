"""Random and hard approaches, by our solver and by two solvers that share no code with it.

One is experiments/reference, with SciPy's integrators, at rtol 1e-11. The other is heyoka's Taylor series of order 20
and more, see experiments/studies/solvers/taylor.py. At the end: energy, the floor of the damping and the search for
events of the first one, which tests of our solver also compare with golden tables and closed forms.
"""

from dataclasses import replace
from itertools import product
from math import hypot, pi
from types import SimpleNamespace as Record

import numpy as np
import pytest
from solver_scenes import CRUISE, MOTION, ROBOTS, on_rough_ground, random_approach, scene

import impact_gym as ig
from experiments import reference
from experiments.reference.chain import Chain
from experiments.reference.integration import Switch, advance
from experiments.studies.solvers.approaches import Solution
from experiments.studies.solvers.taylor import Run
from impact_gym.physics import dissipation
from impact_gym.scene import Dissipation

RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-13)


def time_unit(scene, contact):
    """t0 of a contact with a flange that does not yield, s."""
    mass, v = scene.object.mass, contact.approach_velocity
    if not isinstance(scene.coupling, ig.Rigid):
        mass = mass * scene.tool.mass / (mass + scene.tool.mass)
    return (mass * v**2 / scene.contact.stiffness) ** (1 / (scene.contact.stiffness_exponent + 1)) / v


def errors(approach, rtol, exact):
    """The largest relative error of each kind in one run; of times in t0, of velocities in the approach velocity."""
    fast = ig.simulate(*approach, rtol)
    pairs = list(zip(fast.contacts, exact.contacts, strict=True))
    assert (fast.detection_time is None) == (exact.detection_time is None)
    assert all((a.end is None) == (b.end is None) for a, b in pairs)
    if not pairs:
        assert fast.object_velocity == fast.peak_force == 0.0
        return {}
    impulse, first = sum(contact.impulse for contact in exact.contacts), exact.contacts[0]
    parting = [abs(a.separation_velocity - b.separation_velocity) for a, b in pairs if b.end is not None]
    return {
        "object velocity": abs(fast.object_velocity / exact.object_velocity - 1),
        "peak force": abs(fast.peak_force / exact.peak_force - 1),
        "impulse": max(abs(a.impulse - b.impulse) for a, b in pairs) / impulse,
        "detection": abs((fast.detection_time or 0.0) - (exact.detection_time or 0.0)) / time_unit(approach[0], first),
        "separation": max(parting, default=0.0) / first.approach_velocity,
    }


@pytest.mark.parametrize("first", range(0, 150, 10))
def test_simulate_agrees_with_the_reference_to_the_tolerance_asked_for(first):
    too_large = {}
    for seed in range(first, first + 10):
        approach = random_approach(seed)
        exact = reference.simulate(*approach, rtol=1e-11)
        for rtol in RTOLS:
            for kind, error in errors(approach, rtol, exact).items():
                if error > max(rtol, 1e-10):  # the accuracy of the reference
                    too_large[seed, rtol, kind] = error
    assert too_large == {}


def numbers(approach, outcome):
    """All numbers of an outcome, and the unit of the error of each; for times it is the t0 of their contact."""
    units = [time_unit(approach[0], contact) for contact in outcome.contacts]
    values = [(outcome.detection_time or 0.0, units[0]), *((time, units[0]) for time in outcome.snap_through)]
    for contact, t0 in zip(outcome.contacts, units, strict=True):
        ended = [] if contact.end is None else [contact.end, contact.end - contact.start]
        values += [(time, t0) for time in (contact.start, *ended)]
        values += [(size, size) for size in (contact.peak_force, contact.approach_velocity, contact.impulse)]
    velocity, impulse = outcome.contacts[0].approach_velocity, outcome.contacts[0].impulse
    values += [(getattr(outcome, f"{body}_velocity"), velocity) for body in ("object", "tool", "flange")]
    return np.array([*values, (outcome.coupling_impulse, impulse)]).T


def sensitivity(approach):
    """The largest change of each number per relative change of a parameter of contact, tool or object."""
    chain, *rest = approach
    here, _ = numbers(approach, ig.simulate(*approach, 1e-13))
    moved = []
    for part, name in (("contact", "stiffness"), ("contact", "restitution"), ("tool", "mass"), ("object", "mass")):
        record = getattr(chain, part)
        record = replace(record, **{name: getattr(record, name) * (1 - 1e-7)})
        other = replace(chain, **{part: record}), *rest
        moved.append(numbers(other, ig.simulate(*other, 1e-13))[0] - here)
    return np.abs(moved).max(axis=0) / 1e-7


@pytest.mark.parametrize("coupling", ["rigid", "spring", "bistable"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_simulate_agrees_with_the_reference_for_every_coupling_on_every_robot(coupling, robot):
    for seed in range(5):
        approach = random_approach(seed, coupling, robot, Dissipation.__args__, (10, 2000))
        theirs, size = numbers(approach, reference.simulate(*approach, rtol=1e-12))
        unit = size + sensitivity(approach)
        for rtol in (1e-6, 1e-8, 1e-10):
            fast = ig.simulate(*approach, rtol)
            # in a mechanism's flight rtol bounds the error of each step; rebounds between its stops multiply errors
            bound = (100 if coupling == "bistable" else 3) * rtol + 1e-9  # the reference's own error in flight
            assert (np.abs(numbers(approach, fast)[0] - theirs) / unit).max() < bound
            assert fast.momentum_error < 1e-9


ROUGH = [("friction",), ("stroke",), ("fixed",)]


@pytest.mark.parametrize(
    ("features", "scenes"),  # 12: every coupling on every robot
    [(sum(ROUGH, ()), 12), *((features, 24) for features in ROUGH)],
)
def test_simulate_agrees_with_the_reference_on_rough_ground_at_stops_and_under_a_fixed_damping(features, scenes):
    slid = stopped = 0
    for seed in range(scenes):
        approach = on_rough_ground(seed, *features)
        chain, slow, fast = approach[0], reference.simulate(*approach), ig.simulate(*approach, rtol=1e-10)
        close = 1e-8 if isinstance(chain.coupling, ig.Bistable) else 1e-9  # in its flight rtol is the error of a step
        assert fast.peak_object_velocity == pytest.approx(slow.peak_object_velocity, rel=0, abs=close)
        assert fast.object_velocity == pytest.approx(slow.object_velocity, rel=0, abs=close)
        assert len(fast.contacts) == len(slow.contacts)
        assert fast.momentum_error < 1e-9
        if fast.slide is not None and fast.object_velocity == 0.0:
            assert fast.slide == pytest.approx(slow.object_position - chain.object.distance, rel=0, abs=close)
            slid += fast.slide > 0.0
        stopped += slow.stop_hits > 0
    assert slid >= scenes // 8 or "friction" not in features
    assert stopped >= scenes // 8 or "stroke" not in features


@pytest.mark.parametrize(
    "coupling", [ig.Rigid(), ig.SpringDamper(150.0, 0.4), ig.SpringDamper(50.0, 1.0), ig.Bistable()], ids=str
)
def test_simulate_agrees_with_taylor_series(coupling):
    pytest.importorskip("heyoka")
    motions = MOTION, ig.Trapezoid(3.0, 8.0, ig.Brake(5.0)), ig.Trapezoid(1.2, 12.0, ig.Brake())
    for motion, e in product(motions, (1.0, 0.8, 0.5)):
        chain = scene(1e5, e, coupling)
        ours = Solution.of(ig.simulate(chain, motion, 1.0, rtol=1e-13), 1.0)
        series = Run(chain, motion, 1.0, 1e-16).solve()
        assert (ours.contacts, ours.passes) == (series.contacts, series.passes)
        for name in ("velocity", "peak_force", "contact_duration", "detection_time"):
            assert getattr(ours, name) == pytest.approx(getattr(series, name), rel=1e-13)


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
def test_reference_keeps_the_energy_in_the_frame_of_the_cruise(coupling, robot):
    case, times = scene(1e4, 1.0, coupling, robot), (0.3, 0.6, 1.0)
    outcomes = [reference.simulate(case, CRUISE, t) for t in times]
    assert len(outcomes[-1].contacts) >= 1
    assert outcomes[-1].snap_through or isinstance(coupling, ig.SpringDamper)
    before, *after = (energy(case, outcome, t) for outcome, t in zip(outcomes, times, strict=True))
    assert after == pytest.approx([before] * 2, rel=1e-9)


def test_reference_has_a_floor_for_the_approach_velocity_in_the_damping():
    a_tenth = scene(1e5, 0.1, distance=1e-8), ig.Trapezoid(1e-7, 1e-3)  # of the floor
    (contact,) = reference.simulate(*a_tenth, 1.0).contacts
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
