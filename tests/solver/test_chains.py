"""Every coupling on every robot under every contact law, on random scenes, against the independent slow solver."""

import math
from functools import cache

import numpy as np
import pytest

import impact_gym as ig
from experiments import reference
from impact_gym.robot import default_approach
from impact_gym.scene import Dissipation

LAWS = Dissipation.__args__
EXPONENTS = [(1.5, 1.5), (1.5, 1.5), (1.0, 0.0), (1.2, 1.2), (2.0, 2.0)]
CHAINS = {
    "bistable": ("bistable", "rigid"),
    "bistable on a robot": ("bistable", "robot"),
    "bistable on a table": ("bistable", "table"),
    "spring on a robot": ("spring", "robot"),
    "spring on a table": ("spring", "table"),
    "rigid on a table": ("tool", "table"),
    "spring": ("spring", "rigid"),
    "rigid": ("tool", "rigid"),
    "rigid on a robot": ("tool", "robot"),
}


def random_scene(random, coupling, robot):
    def log_uniform(low, high):
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    free_length = 0.07
    height = random.uniform(0.3, 0.8) * free_length
    stroke = math.sqrt(free_length**2 - height**2)
    couplings = {
        "tool": ig.Rigid(),
        "spring": ig.SpringDamper(log_uniform(10, 2000), random.uniform(0, 2)),
        "bistable": ig.Bistable(
            log_uniform(20, 200),
            free_length,
            height,
            front_stop=random.uniform(0.1, 0.8) * stroke,
            rear_stop=-random.uniform(0.1, 0.8) * stroke,
            stop_stiffness=log_uniform(1e4, 1e6),
            stop_damping_ratio=random.uniform(0.3, 2),
        ),
    }
    robots = {
        "rigid": None,
        "robot": ig.Robot(log_uniform(1, 10), log_uniform(1e4, 5e5), log_uniform(20, 200)),
        "table": default_approach().robot_table(),
    }
    m, n = EXPONENTS[random.integers(len(EXPONENTS))]
    contact = ig.Contact(log_uniform(1e3, 1e6), random.uniform(0.1, 1), LAWS[random.integers(len(LAWS))], m, n)
    target = ig.Object(log_uniform(0.05, 2.5), random.uniform(0.1, 0.3))
    brake = None
    if random.random() < 0.8:
        brake = ig.Brake(log_uniform(0.1, 10), random.uniform(0, 0.03), random.uniform(4, 20))
    motion = ig.Trapezoid(random.uniform(0.3, 1.5), random.uniform(4, 15), brake)
    return ig.Scene(ig.Tool(log_uniform(0.05, 0.5)), target, contact, couplings[coupling], robots[robot]), motion


@cache
def solved(coupling, robot):
    """Some scenes and motions, each with what the slow solver makes of it."""
    scenes = [random_scene(np.random.default_rng([2023, seed]), coupling, robot) for seed in range(5)]
    return [(scene, motion, reference.simulate(scene, motion, 0.8, rtol=1e-12)) for scene, motion in scenes]


EVERY_CHAIN = pytest.mark.parametrize(("coupling", "robot"), CHAINS.values(), ids=CHAINS)


@EVERY_CHAIN
def test_the_fast_solver_agrees_with_the_slow_one(coupling, robot):
    for scene, motion, slow in solved(coupling, robot):
        fast = ig.simulate(scene, motion, duration=0.8, rtol=1e-10)
        assert len(fast.contacts) == len(slow.contacts)
        assert fast.object_velocity == pytest.approx(slow.object_velocity, rel=1e-7)
        assert fast.peak_force == pytest.approx(slow.peak_force, rel=1e-7)
        assert fast.detection_time == pytest.approx(slow.detection_time, abs=1e-9)
        assert fast.snap_through == pytest.approx(slow.snap_through, abs=1e-6)
        # rebounds between undamped stops multiply errors, hence not 1e-7
        assert fast.coupling_impulse == pytest.approx(slow.coupling_impulse, rel=1e-6, abs=1e-8)
        assert fast.tool_velocity == pytest.approx(slow.tool_velocity, abs=1e-5)
        assert fast.flange_velocity == pytest.approx(slow.flange_velocity, abs=1e-5)
        assert fast.momentum_error < 1e-9
        for ours, theirs in zip(fast.contacts, slow.contacts, strict=True):
            assert ours.start == pytest.approx(theirs.start, abs=1e-8)
            assert ours.approach_velocity == pytest.approx(theirs.approach_velocity, rel=1e-6)
            assert ours.impulse == pytest.approx(theirs.impulse, rel=1e-6)
            assert ours.end == pytest.approx(theirs.end, abs=1e-7)


def time_unit(scene, contact):
    """t0 of a contact, with the flange as heavy as it may be."""
    free = not isinstance(scene.coupling, ig.Rigid)
    mass = scene.object.mass * (scene.tool.mass / (scene.tool.mass + scene.object.mass) if free else 1.0)
    v = contact.approach_velocity
    return (mass * v**2 / scene.contact.stiffness) ** (1 / (scene.contact.stiffness_exponent + 1)) / v


@EVERY_CHAIN
@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10])
def test_events_are_found_where_the_slow_solver_finds_them(coupling, robot, rtol):
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
