"""A compliant robot, compared with matrix exponentials.

tests/solver/test_agreement.py compares every chain with a robot, or with a table, with the slow solver.
"""

import math
from dataclasses import astuple

import numpy as np
import pytest
from scenes import MOTION, scene
from scipy.linalg import expm

import impact_gym as ig

ROBOT = ig.Robot(5.225, 1.9e5, 50.4)


def approach(*chain, duration=1.0, **target):
    return ig.simulate(scene(1e5, 1.0, *chain, **target), MOTION, duration, 1e-10, trace=True)


def test_robot_and_fixed_tool_are_one_mass_on_the_robots_spring():
    spring_damper = ig.SpringDamper(ROBOT.stiffness, ROBOT.damping / 2 / math.sqrt(ROBOT.stiffness * 5.35))
    same, robot = approach(spring_damper, m_t=5.35), approach(ig.Rigid(), ROBOT)
    assert robot.object_velocity == pytest.approx(same.object_velocity, rel=1e-12)
    assert robot.trace.tool_position == pytest.approx(same.trace.tool_position, abs=1e-12)
    assert robot.flange_velocity == robot.tool_velocity
    assert (robot.trace.flange_position == robot.trace.tool_position).all()
    assert robot.trace.command_position == pytest.approx(same.trace.flange_position, abs=1e-12)


@pytest.mark.parametrize("coupling", [ig.SpringDamper(150.0), ig.SpringDamper(5000.0, 0.1)], ids=str)
def test_flight_of_flange_and_tool_is_the_matrix_exponential(coupling):
    trace = approach(coupling, ROBOT, distance=1e3, duration=0.5).trace  # the object is not reached
    (m_r, k_r, c_r), m_t, k_t = astuple(ROBOT), 0.125, coupling.stiffness
    c_t = 2 * coupling.damping_ratio * math.sqrt(k_t * m_t)
    # offsets of flange and tool from the imposed motion, their rates, and the imposed acceleration
    rates = np.zeros((5, 5))
    rates[0, 2] = rates[1, 3] = 1.0
    rates[2] = np.array([-k_r - k_t, k_t, -c_r - c_t, c_t, -m_r]) / m_r
    rates[3] = np.array([k_t, -k_t, c_t, -c_t, -m_t]) / m_t
    for time in (0.06, 0.125, 0.3, 0.5):
        at = np.argmin(np.abs(trace.time - time))
        t = trace.time[at]
        state = expm(rates * min(t, 0.125)) @ np.array([0, 0, 0, 0, 8.0])
        state = expm(rates * max(t - 0.125, 0.0)) @ (state * [1, 1, 1, 1, 0])
        offsets = [trace.flange_position[at], trace.tool_position[at]] - trace.command_position[at]
        assert offsets == pytest.approx(state[:2], abs=1e-11)
        speeds = [trace.flange_velocity[at], trace.tool_velocity[at]] - trace.command_velocity[at]
        assert speeds == pytest.approx(state[2:4], abs=1e-9)
