"""The instantaneous impact (paper, eq. 1-4, 22) against conservation laws, its limits, and stiff simulated contacts."""

import math

import numpy as np
import pytest
from scenes import CRUISE, scene

import impact_gym as ig
from impact_gym.physics import impact

RNG = np.random.default_rng(1)
M_T, M_P = RNG.uniform(0.01, 5.0, (2, 200))
V_T, V_P = RNG.uniform(-2.0, 2.0, (2, 200))
E = RNG.uniform(0.0, 1.0, 200)
PUSH = RNG.uniform(-1.0, 1.0, 200)


@pytest.mark.parametrize("push", [(), (PUSH,)], ids=["free", "pushed"])
def test_free_tool_keeps_momentum_but_for_the_push_and_reverses_and_reduces_the_relative_velocity(push):
    after_t, after_p = impact.free_tool(M_T, M_P, V_T, V_P, E, *push)
    assert M_T * after_t + M_P * after_p == pytest.approx(M_T * V_T + M_P * V_P + sum(push), rel=1e-12, abs=1e-12)
    assert after_p - after_t == pytest.approx(E * (V_T - V_P), abs=1e-12)
    assert impact.rigid_tool(V_T, V_P, E) - V_T == pytest.approx(E * (V_T - V_P), abs=1e-12)


def test_free_tool_that_is_heavy_is_a_rigid_one():
    heavy = impact.free_tool(1e12, M_P, V_T, V_P, E)[1]
    assert heavy == pytest.approx(impact.rigid_tool(V_T, V_P, E), abs=1e-10)


def test_rigid_and_free_tool_have_the_papers_examples():
    assert impact.rigid_tool(1.0, 0.0, [1.0, 0.0]) == pytest.approx([2.0, 1.0])  # section 2.1
    v_t, v_p = impact.free_tool(0.125, 0.25, 1.0, 0.0, [0.0, 1.0])
    assert v_t == pytest.approx([1 / 3, -1 / 3])  # Fig. 2, by hand
    assert v_p == pytest.approx([1 / 3, 2 / 3])


def test_sliding_distance_is_infinite_without_friction_and_none_at_rest():
    assert impact.sliding_distance([1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.5, 0.5])[:2].tolist() == [np.inf, 0.0]


@pytest.mark.parametrize("restitution", [0.1, 0.5, 1.0])
def test_simulated_contact_comes_to_eq_3_and_4_where_it_is_stiff(restitution):
    errors, stiffnesses, share = [], [1e11, 1e12, 1e13], 0.125 / 0.375
    for stiffness in stiffnesses:
        sprung = scene(stiffness, restitution, ig.SpringDamper(150.0), dissipation="exact")
        contact = ig.simulate(sprung, CRUISE, duration=0.5, rtol=1e-11).contacts[0]
        args = (0.125, 0.25, contact.approach_velocity, 0.0, restitution)
        tool, thing = impact.free_tool(*args)
        # what the spring adds is bounded by its force on a tool that lags by its full jump
        jump, duration = contact.approach_velocity - tool, contact.end - contact.start
        bound = (2 * math.sqrt(150.0 * 0.125) + 150.0 * duration) * jump * duration / 0.375
        assert 0 < contact.object_velocity - thing < 1.001 * bound
        assert contact.object_velocity - contact.separation_velocity == pytest.approx(tool, abs=2 * bound / share)
        errors.append(contact.object_velocity / thing - 1)
        # eq. 22 takes the coupling's impulse along: what is left is that the push also changes the restitution
        lost = contact.separation_velocity - restitution * contact.approach_velocity
        left = contact.object_velocity - impact.free_tool(*args, contact.coupling_impulse)[1]
        assert left == pytest.approx(share * lost, abs=1e-12)
    # the contact's duration, over which the coupling pushes, goes with k_c^(-2/5)
    assert np.polyfit(np.log(stiffnesses), np.log(errors), 1)[0] == pytest.approx(-0.4, abs=0.03)
