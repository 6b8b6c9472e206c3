"""Random approaches, and hard ones, as two solvers have them that share nothing with ours.

One is experiments/reference, of SciPy's integrators, at rtol 1e-11; the other heyoka's Taylor series of order 20 and
more, see `taylor.py`.
"""

from functools import cache

import pytest
import taylor
from scenes import MOTION, ROBOTS, random_approach, scene, time_unit

import impact_gym as ig
from experiments import reference
from experiments.solver.solutions import Solution
from impact_gym.scene import Dissipation

SCENES = 150
RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)


def errors(approach, rtol, exact):
    """Largest relative error of each kind in one run; times count in t0, velocities in the approach velocity."""
    fast = ig.simulate(*approach, rtol)
    pairs = list(zip(fast.contacts, exact.contacts, strict=True))
    assert (fast.detection_time is None) == (exact.detection_time is None)
    assert all((a.end is None) == (b.end is None) for a, b in pairs)
    if not pairs:
        assert fast.object_velocity == fast.peak_force == 0.0
        return dict.fromkeys(("object velocity", "peak force", "impulse", "detection", "separation"), 0.0)
    impulse, first = sum(contact.impulse for contact in exact.contacts), exact.contacts[0]
    parting = [abs(a.separation_velocity - b.separation_velocity) for a, b in pairs if b.end is not None]
    return {
        "object velocity": abs(fast.object_velocity / exact.object_velocity - 1),
        "peak force": abs(fast.peak_force / exact.peak_force - 1),
        "impulse": max(abs(a.impulse - b.impulse) for a, b in pairs) / impulse,
        "detection": abs((fast.detection_time or 0.0) - (exact.detection_time or 0.0)) / time_unit(approach[0], first),
        "separation": max(parting, default=0.0) / first.approach_velocity,
    }


@pytest.mark.storm
@pytest.mark.parametrize("first", range(0, SCENES, 15))
def test_simulate_agrees_with_the_reference_to_the_tolerance_asked_for(first):
    too_large = {}
    for seed in range(first, first + 15):
        approach = random_approach(seed)
        exact = reference.simulate(*approach, rtol=1e-11)
        for rtol in (*RTOLS, 1e-10, 1e-13):
            for kind, error in errors(approach, rtol, exact).items():
                if error > max(rtol, 1e-10):  # the reference is as good as that
                    too_large[seed, rtol, kind] = error
    assert too_large == {}


@cache
def solved(coupling, robot):
    """Some approaches under any law, each with what the reference makes of it."""
    approaches = [random_approach(seed, coupling, robot, Dissipation.__args__, (10, 2000)) for seed in range(5)]
    return [(approach, reference.simulate(*approach, rtol=1e-12)) for approach in approaches]


@pytest.mark.parametrize("coupling", ["rigid", "spring", "bistable"])
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10])
def test_simulate_agrees_with_the_reference_for_every_coupling_on_every_robot(coupling, robot, rtol):
    for approach, slow in solved(coupling, robot):
        fast = ig.simulate(*approach, rtol)
        t0 = time_unit(approach[0], slow.contacts[0])
        close = 3 * rtol + 1e-9  # the reference's own error in flight
        assert fast.detection_time == pytest.approx(slow.detection_time, abs=close * t0)
        assert fast.snap_through == pytest.approx(slow.snap_through, abs=close)
        for ours, theirs in zip(fast.contacts, slow.contacts, strict=True):
            t0 = time_unit(approach[0], theirs)
            if theirs is not slow.contacts[0]:  # it inherits what rebounds between stops made of earlier errors
                close = 100 * rtol + 1e-9
            assert ours.start == pytest.approx(theirs.start, abs=close * t0)
            assert ours.end == pytest.approx(theirs.end, abs=close * t0)
            if theirs.end is not None:
                assert ours.end - ours.start == pytest.approx(theirs.end - theirs.start, rel=close)
            assert ours.peak_force == pytest.approx(theirs.peak_force, rel=close)
            assert ours.approach_velocity == pytest.approx(theirs.approach_velocity, rel=1e4 * rtol)
            assert ours.impulse == pytest.approx(theirs.impulse, rel=1e4 * rtol)
        assert fast.object_velocity == pytest.approx(slow.object_velocity, rel=1e3 * rtol)
        # rebounds between undamped stops multiply errors
        assert fast.coupling_impulse == pytest.approx(slow.coupling_impulse, rel=1e4 * rtol, abs=1e2 * rtol)
        assert fast.tool_velocity == pytest.approx(slow.tool_velocity, abs=1e5 * rtol)
        assert fast.flange_velocity == pytest.approx(slow.flange_velocity, abs=1e5 * rtol)
        assert fast.momentum_error < 1e-9


@pytest.mark.parametrize("e", [1.0, 0.8, 0.5])
@pytest.mark.parametrize("motion", [MOTION, ig.Trapezoid(3.0, 8.0, ig.Brake(5.0)), ig.Trapezoid(1.2, 12.0, ig.Brake())])
@pytest.mark.parametrize(
    "coupling",
    [ig.Rigid(), ig.SpringDamper(150.0, 0.4), ig.SpringDamper(50.0, 1.0), ig.Bistable()],
    ids=str,
)
def test_simulate_agrees_with_taylor_series(coupling, motion, e):
    pytest.importorskip("heyoka")
    chain = scene(1e5, e, coupling)
    ours = Solution.of(ig.simulate(chain, motion, 1.0, rtol=1e-13), 1.0)
    series = taylor.Run(chain, motion, 1.0, 1e-16).solve()
    assert (ours.contacts, ours.passes) == (series.contacts, series.passes)
    for name in ("velocity", "peak_force", "contact_duration", "detection_time"):
        assert getattr(ours, name) == pytest.approx(getattr(series, name), rel=1e-13)
