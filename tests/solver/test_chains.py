"""Every coupling on every robot under every contact law, on random scenes, against the independent slow solver."""

import math
from functools import cache

import numpy as np
import pytest
from scenes import log_uniform, time_unit

import impact_gym as ig
from experiments import reference
from impact_gym.robot import default_approach
from impact_gym.scene import Dissipation

LAWS = Dissipation.__args__
EXPONENTS = [(1.5, 1.5), (1.5, 1.5), (1.0, 0.0), (1.2, 1.2), (2.0, 2.0)]


def random_scene(random, coupling, robot):
    def log(low, high):
        return log_uniform(random, low, high)

    free_length = 0.07
    height = random.uniform(0.3, 0.8) * free_length
    stroke = math.sqrt(free_length**2 - height**2)
    couplings = {
        "rigid": ig.Rigid(),
        "spring": ig.SpringDamper(log(10, 2000), random.uniform(0, 2)),
        "bistable": ig.Bistable(
            log(20, 200),
            free_length,
            height,
            front_stop=random.uniform(0.1, 0.8) * stroke,
            rear_stop=-random.uniform(0.1, 0.8) * stroke,
            stop_stiffness=log(1e4, 1e6),
            stop_damping_ratio=random.uniform(0.3, 2),
        ),
    }
    robots = {
        "rigid": None,
        "robot": ig.Robot(log(1, 10), log(1e4, 5e5), log(20, 200)),
        "table": default_approach().robot_table(),
    }
    m, n = EXPONENTS[random.integers(len(EXPONENTS))]
    contact = ig.Contact(log(1e3, 1e6), random.uniform(0.1, 1), LAWS[random.integers(len(LAWS))], m, n)
    target = ig.Object(log(0.05, 2.5), random.uniform(0.1, 0.3))
    brake = None
    if random.random() < 0.8:
        brake = ig.Brake(log(0.1, 10), random.uniform(0, 0.03), random.uniform(4, 20))
    motion = ig.Trapezoid(random.uniform(0.3, 1.5), random.uniform(4, 15), brake)
    return ig.Scene(ig.Tool(log(0.05, 0.5)), target, contact, couplings[coupling], robots[robot]), motion


@cache
def solved(coupling, robot):
    """Some scenes and motions, each with what the slow solver makes of it."""
    scenes = [random_scene(np.random.default_rng([2023, seed]), coupling, robot) for seed in range(5)]
    return [(scene, motion, reference.simulate(scene, motion, 0.8, rtol=1e-12)) for scene, motion in scenes]


@pytest.mark.parametrize("coupling", ["rigid", "spring", "bistable"])
@pytest.mark.parametrize("robot", ["rigid", "robot", "table"])
@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10])
def test_the_fast_solver_agrees_with_the_slow_one(coupling, robot, rtol):
    for scene, motion, slow in solved(coupling, robot):
        fast = ig.simulate(scene, motion, duration=0.8, rtol=rtol)
        t0 = time_unit(scene, slow.contacts[0])
        close = 3 * rtol + 1e-9  # the slow solver's own error in flight
        assert fast.detection_time == pytest.approx(slow.detection_time, abs=close * t0)
        assert fast.snap_through == pytest.approx(slow.snap_through, abs=close)
        for ours, theirs in zip(fast.contacts, slow.contacts, strict=True):
            t0 = time_unit(scene, theirs)
            if theirs is not slow.contacts[0]:  # it inherits what rebounds between stops made of earlier errors
                close = 100 * rtol + 1e-9
            assert ours.start == pytest.approx(theirs.start, abs=close * t0)
            assert ours.end == pytest.approx(theirs.end, abs=close * t0)
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
