"""A robot that yields: against matrix exponentials, its limits, and the paper's Fig. 13b and 14.

That every chain with a robot, or a table of one, agrees with the slow solver is in tests/solver/test_agreement.py.
"""

import dataclasses
import math

import numpy as np
import pytest
from golden import IMPACT_VELOCITY, OBJECT_VELOCITIES
from scenes import MOTION, scene
from scipy.linalg import expm
from solvers import BOTH

import impact_gym as ig
from impact_gym.robot import default_approach

TOOL_MASS = 0.125
ROBOT = ig.Robot(5.225, 1.9e5, 50.4)
FAR = 1e3  # m, an object that is never met
COUPLINGS = [ig.Rigid(), ig.SpringDamper(150.0), ig.SpringDamper(5000.0, 0.1), ig.Bistable()]
EVERY_COUPLING = pytest.mark.parametrize("coupling", COUPLINGS, ids=str)


def approach(coupling, robot, *, k_c=1e5, e=1.0, duration=1.0, **target):
    return ig.simulate(scene(k_c, e, coupling, robot, **target), MOTION, duration, 1e-10, trace=True)


@BOTH
@pytest.mark.parametrize(("figure", "k_c", "m_p"), [("13b", 1e5, 0.25), ("14a", 1e5, 2.5), ("14b", 1e6, 2.5)])
def test_simulate_gives_the_velocities_of_figure(simulate, figure, k_c, m_p):
    outcome = simulate(scene(k_c, 1.0, robot=ROBOT, m_p=m_p), MOTION, 1.0)
    (contact,) = outcome.contacts
    assert contact.approach_velocity == pytest.approx(IMPACT_VELOCITY, abs=1e-6)
    assert outcome.object_velocity == pytest.approx(OBJECT_VELOCITIES[figure], abs=1e-6)


def test_robot_and_fixed_tool_are_one_mass_on_the_robots_spring():
    spring_damper = ig.SpringDamper(ROBOT.stiffness, ROBOT.damping / 2 / math.sqrt(ROBOT.stiffness * 5.35))
    same = ig.simulate(scene(1e5, 1.0, spring_damper, m_t=5.35), MOTION, duration=1.0, rtol=1e-10, trace=True)
    robot = approach(ig.Rigid(), ROBOT)
    assert robot.object_velocity == pytest.approx(same.object_velocity, rel=1e-12)
    assert robot.trace.tool_position == pytest.approx(same.trace.tool_position, abs=1e-12)
    assert robot.flange_velocity == robot.tool_velocity
    assert (robot.trace.flange_position == robot.trace.tool_position).all()
    assert robot.trace.command_position == pytest.approx(same.trace.flange_position, abs=1e-12)


@pytest.mark.parametrize("coupling", COUPLINGS[1:3], ids=str)
def test_robot_flange_and_tool_fly_as_the_matrix_exponential_says(coupling):
    trace = approach(coupling, ROBOT, distance=FAR, duration=0.5).trace
    m_r, k_r, c_r = ROBOT.mass, ROBOT.stiffness, ROBOT.damping
    k_t, c_t = coupling.stiffness, 2 * coupling.damping_ratio * math.sqrt(coupling.stiffness * TOOL_MASS)
    # offsets of flange and tool from the imposed motion, their rates, and the imposed acceleration
    rates = np.zeros((5, 5))
    rates[0, 2] = rates[1, 3] = 1.0
    rates[2] = np.array([-k_r - k_t, k_t, -c_r - c_t, c_t, -m_r]) / m_r
    rates[3] = np.array([k_t, -k_t, c_t, -c_t, -TOOL_MASS]) / TOOL_MASS
    for time in (0.06, 0.125, 0.3, 0.5):
        at = np.argmin(np.abs(trace.time - time))
        t = trace.time[at]
        state = expm(rates * min(t, 0.125)) @ np.array([0, 0, 0, 0, 8.0])
        state[4] = 0.0
        state = expm(rates * max(t - 0.125, 0.0)) @ state
        offsets = [trace.flange_position[at], trace.tool_position[at]] - trace.command_position[at]
        assert offsets == pytest.approx(state[:2], abs=1e-11)
        speeds = [trace.flange_velocity[at], trace.tool_velocity[at]] - trace.command_velocity[at]
        assert speeds == pytest.approx(state[2:4], abs=1e-9)


@EVERY_COUPLING
def test_robot_that_hardly_yields_is_a_rigid_one(coupling):
    rigid = approach(coupling, None, k_c=1e3, e=0.1)
    errors = []
    for stiffness in (1e7, 1e8):
        hard = ig.Robot(5.225, stiffness, 2 * 0.7 * math.sqrt(stiffness * 5.225))
        errors.append(abs(approach(coupling, hard, k_c=1e3, e=0.1).object_velocity - rigid.object_velocity))
    assert errors[1] < 1e-4
    assert errors[1] < 0.5 * errors[0]


def test_robot_frozen_at_the_impact_gives_another_object_velocity():
    robot = default_approach()
    frozen, varying = approach(ig.Rigid(), robot.at(0.2505)), approach(ig.Rigid(), robot.robot_table())
    # the table's robot is softer on the way, so that it arrives in another phase of its swing (docs/provenance.md)
    assert 0.01 < abs(frozen.object_velocity - varying.object_velocity) < 0.1
    assert abs(frozen.contacts[0].start - varying.contacts[0].start) < 1e-3


TABLE = ig.RobotTable((0.0, 0.1, 0.2, 0.3), (5.0,) * 4, (1e5,) * 4, (0.5, 0.4, 0.4, 0.5))  # falls to 0.3875 N s/m


@pytest.mark.parametrize(("change", "error", "field"), [
    ({"position": (0.0, 0.2, 0.1, 0.3)}, ValueError, "position"),
    ({"position": (0.0, 0.1, 0.2)}, ValueError, "position"),
    ({"position": (0.0, 0.1, 0.2, math.nan)}, ValueError, r"position\[3\]"),
    ({"mass": (5.0, 5.0, 5.0)}, ValueError, "mass"),
    ({"mass": (5.0, 0.0, 5.0, 5.0)}, ValueError, r"mass\[1\]"),
    ({"mass": (9.0, 0.1, 9.0, 0.1)}, ValueError, "mass must stay positive"),
    ({"stiffness": "1e5"}, TypeError, "stiffness"),
    ({"stiffness": None}, TypeError, "stiffness"),
    ({"damping": (50.0, "1", 50.0, 50.0)}, TypeError, r"damping\[1\]"),
    ({"damping": (50.0, -1.0, 50.0, 50.0)}, ValueError, r"damping\[1\]"),
])  # fmt: skip
def test_robot_table_refuses_bad_columns(change, error, field):
    with pytest.raises(error, match=rf"RobotTable\.{field}"):
        dataclasses.replace(TABLE, **change)
