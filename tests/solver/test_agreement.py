"""Random and hard approaches, by our solver and by two solvers that share no code with it.

One is experiments/reference, with SciPy's integrators, at rtol 1e-11. The other is heyoka's Taylor series of order 20
and more, see `pieces.py`.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scenes import MOTION, ROBOTS, on_rough_ground, random_approach, scene

import impact_gym as ig
from experiments import reference
from experiments.studies.solvers.approaches import Solution
from experiments.studies.solvers.taylor import Run
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
