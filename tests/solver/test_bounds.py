"""Bounds that end a search for a touch: energy of what holds the tool, and how far the tool can still swing."""

import numpy as np
import pytest
from opened import kernels
from scenes import random_mechanism
from scipy.integrate import quad, solve_ivp

import impact_gym as ig
from impact_gym.lowering import mount

TOOL_MASS = 0.125  # kg


def law_of(coupling, robot=None):
    return kernels().laws_of(np.array([mount(TOOL_MASS, coupling, robot)[0]], kernels().MOUNT))


def holding(coupling, stretch):
    """Force of coupling and stops on the tool (N), a slow one."""
    if isinstance(coupling, ig.SpringDamper):
        beyond = max(abs(stretch) - coupling.stroke, 0.0) * np.sign(stretch)
        return -coupling.stiffness * stretch - 1e5 * beyond
    x = coupling.rest + stretch
    beyond = max(x - coupling.front_stop, 0.0) - max(coupling.rear_stop - x, 0.0)
    return coupling.force(x) - coupling.stop_stiffness * beyond


COUPLINGS = [
    *(random_mechanism(np.random.default_rng(seed)) for seed in range(4)), ig.SpringDamper(80.0, 0.5, stroke=0.01)
]  # fmt: skip


@pytest.mark.parametrize("coupling", COUPLINGS, ids=lambda coupling: type(coupling).__name__)
def test_energy_of_a_coupling_is_the_work_against_its_force_and_bounds_its_reach(coupling):
    law, random = law_of(coupling), np.random.default_rng(7)
    if isinstance(coupling, ig.Bistable):
        low, high = (stop - coupling.rest for stop in (coupling.rear_stop, coupling.front_stop))
    else:
        low, high = -coupling.stroke, coupling.stroke
    marks = [low, high]
    at_rest = kernels().energy_and_reach(law, 0.0, 0.0)[0]
    for stretch in random.uniform(low - 2e-3, high + 2e-3, 12):
        energy = kernels().energy_and_reach(law, stretch, 0.0)[0]
        work = -quad(lambda s: holding(coupling, s), 0.0, stretch, points=marks, epsabs=1e-13, limit=200)[0]
        assert energy - at_rest == pytest.approx(work, rel=1e-7, abs=1e-9)
        for kinetic in (1e-4, 1e-2, 1.0):
            reach = kernels().energy_and_reach(law, stretch, kinetic)[1]
            allowed = energy + kinetic
            if isinstance(coupling, ig.Bistable) and stretch < -coupling.rest == reach:  # behind what it cannot pass
                assert coupling.energy(0.0) > allowed
                continue
            beyond = np.linspace(max(reach, stretch), max(reach, stretch) + 0.01, 50)[1:]
            assert min(kernels().energy_and_reach(law, s, 0.0)[0] for s in beyond) > allowed * (1 - 1e-9)
    close = kernels().energy_and_reach(law, 0.0, 1e-4)[1]  # from rest: about as far as the stop or the spring gives way
    stiffness = coupling.stop_stiffness if isinstance(coupling, ig.Bistable) else coupling.stiffness
    assert close == pytest.approx(np.sqrt(2e-4 / stiffness), rel=0.05)


def test_reach_of_a_tool_on_a_robot_holds_and_is_not_far_off():
    coupling, robot, random = ig.SpringDamper(150.0, 0.0), ig.Robot(5.0, 5e3, 0.0), np.random.default_rng(3)
    law, shares = law_of(coupling, robot), []
    k, m_t, k_r, m_r = coupling.stiffness, TOOL_MASS, robot.stiffness, robot.mass
    for _ in range(40):
        y, y_dot, q, q_dot = random.standard_normal(4) * [0.01, 0.3, 0.003, 0.3] * random.choice([0.1, 1.0], 4)
        chain = np.zeros(1, kernels().CHAIN)
        chain["deflection"], chain["deflection_rate"] = y, y_dot
        chain["flange_offset"], chain["flange_offset_rate"] = q, q_dot

        def rates(_, s):
            return [s[1], -k * (s[0] - s[2]) / m_t, s[3], (k * (s[0] - s[2]) - k_r * s[2]) / m_r]

        swing = solve_ivp(rates, (0.0, 20.0), [y, y_dot, q, q_dot], rtol=1e-8, atol=1e-10, max_step=5e-3).y[0]
        shares.append(swing.max() / kernels().swing_reach(law, chain))
    assert 0.7 < max(shares) <= 1.0
    assert min(shares) > 0.2
