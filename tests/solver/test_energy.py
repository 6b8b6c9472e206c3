"""Energy in the frame of a flange that moves at a constant speed: only friction under the object can add to it."""

from dataclasses import replace

import numpy as np
import pytest
from solver_scenes import BOTH, CRUISE, fast, on_rough_ground, scene, stored_energy

import impact_gym as ig
from impact_gym.physics.impact import GRAVITY


def energy(chain, speed, bodies):
    """Energy (J) of object, contact, tool and coupling in the frame that moves at `speed`."""
    m, stretch = chain.contact.stiffness_exponent, bodies.tool_position - bodies.flange_position
    depth = np.maximum(bodies.tool_position - bodies.object_position, 0.0)
    moving = chain.object.mass * (bodies.object_velocity - speed) ** 2
    if not isinstance(chain.coupling, ig.Rigid):  # else the motion of the tool is imposed
        moving = moving + chain.tool.mass * (bodies.tool_velocity - speed) ** 2
    return 0.5 * moving + chain.contact.stiffness * depth ** (m + 1) / (m + 1) + stored_energy(chain.coupling, stretch)


@pytest.mark.parametrize(
    "features", [("friction",), ("stroke",), ("fixed",), ("friction", "stroke", "fixed")], ids="-".join
)
def test_energy_grows_at_most_by_the_work_of_the_ground(features):
    for seed in range(0, 240, 12):  # without a robot
        chain, motion, duration = on_rough_ground(seed, *features)
        v, friction = motion.speed, (chain.object.friction or 0.0) * chain.object.mass * GRAVITY
        trace = ig.simulate(chain, replace(motion, brake=None), duration + 0.2, rtol=1e-11, trace=True).trace
        now = energy(chain, v, trace)
        made = np.diff(now) - v * friction * np.diff(trace.time)
        steady = trace.time[:-1] > v / motion.acceleration * (1 + 1e-12)
        assert made[steady].max() < 1e-9 * now.max()


@BOTH
@pytest.mark.parametrize("robot", [None, ig.Robot(5.225, 1.5e5, 0.0)], ids=["imposed", "robot"])
@pytest.mark.parametrize("coupling", [ig.SpringDamper(150.0, 0.0), ig.Bistable(stop_damping_ratio=0.0)], ids=str)
def test_undamped_chain_keeps_its_energy(simulate, coupling, robot):
    undamped, times, energies = scene(1e4, 1.0, coupling, robot), (0.3, 0.6, 1.0), []
    for t in times:
        outcome = bodies = simulate(undamped, CRUISE, t, **({"trace": True} if simulate is fast else {}))
        if simulate is fast:
            bodies = ig.Trace(*(values[-1] for values in outcome.trace))
        energies.append(energy(undamped, 1.0, bodies))
        if robot is not None:
            lag = t - 1 / 16 - bodies.flange_position
            energies[-1] += 0.5 * robot.stiffness * lag**2 + 0.5 * robot.mass * (bodies.flange_velocity - 1) ** 2
    assert len(outcome.contacts) >= 1
    assert outcome.snap_through or isinstance(coupling, ig.SpringDamper)
    assert energies[1:] == pytest.approx(energies[:1] * 2, rel=1e-9)
