"""Closed forms: Hertz's stiffness, the instantaneous impact (eq. 1-4, 22), the peak force; the bistable mechanism."""

import math
import re

import numpy as np
import pytest
from scipy.integrate import quad
from solver_scenes import scene

import impact_gym as ig
from impact_gym.physics import impact
from impact_gym.physics.hertz import GENT, rubber
from impact_gym.task import ScenarioRanges

STEEL = (206e9, 0.3)


@pytest.mark.parametrize(("tool", "thing"), [(STEEL, (3e9, 0.4)), ((3e9, 0.4), STEEL), ((1e30, 0.3), (2e6, 0.5))])
def test_hertz_is_the_closed_form_for_a_sphere_on_a_plane(tool, thing):
    radius, force = 0.02, 50.0
    k = ig.hertz(radius, *tool, *thing)
    modulus = 1.0 / sum((1 - poisson**2) / young for young, poisson in (tool, thing))
    approach = (9.0 * force**2 / (16.0 * radius * modulus**2)) ** (1 / 3)  # Johnson, Contact Mechanics, eq. 4.23
    assert k * approach**1.5 == pytest.approx(force, rel=1e-12)


def test_materials_have_physical_numbers_and_a_source():
    for name, material in ig.MATERIALS.items():
        assert re.search(r"\bread\b|not checked here", material.source), name
        assert 0 < material.young[0] <= material.young[1] < 1e12, name
        assert 0 <= material.poisson[0] <= material.poisson[1] <= 0.5, name
        digits = 17 if GENT in material.source else 2  # what sources print of a modulus
        assert [float(f"{young:.{digits}g}") for young in material.young] == list(material.young), name
        least, most = material.restitution or (0, 1)
        assert 0 <= least <= most <= 1, name


@pytest.mark.parametrize("shore", [20.0, 40.0, 60.0, 80.0])
def test_modulus_of_rubber_is_that_of_a_flat_durometer(shore):
    # ASTM D2240, type A: the indenter is a cone from 1.27 to 0.79 mm; 0.55 to 8.05 N; 2.54 mm deep at hardness 0
    radius, force, depth = (0.79e-3 + 1.27e-3) / 4, 0.55 + 0.075 * shore, 2.54e-3 * (1 - shore / 100)
    young = (1 - 0.5**2) * force / (2 * radius * depth)  # Johnson, Contact Mechanics, eq. 3.36, incompressible
    low, high = rubber(shore).young
    assert math.sqrt(low * high) == pytest.approx(young, rel=0.01)
    assert high / low == pytest.approx(1.2**2)
    if shore in (40.0, 60.0):
        assert math.sqrt(low * high) == pytest.approx({40.0: 1.7e6, 60.0: 3.6e6}[shore], rel=0.02)  # of Gent's table


def test_material_ranges_contain_a_pair_and_are_of_a_scenario():
    ranges = ig.material_ranges((0.01, 0.03), "rubber, Shore A 50", "steel")
    low, high = ranges["contact_stiffness"]
    assert low < ig.hertz(0.02, 2.5e6, 0.48, 200e9, 0.29) < high
    assert "restitution" not in ranges
    assert ig.material_ranges(0.01, "glass", "glass")["restitution"] == [0.96, 0.98]
    assert ScenarioRanges.of(ranges).contact_stiffness == (low, high)


@pytest.mark.parametrize("pushed", [False, True])
def test_free_tool_obeys_push_and_restitution(pushed):
    random = np.random.default_rng(1)
    (m_t, m_p), (v_t, v_p) = random.uniform(0.01, 5.0, (2, 200)), random.uniform(-2.0, 2.0, (2, 200))
    e, push = random.uniform(0.0, 1.0, 200), random.uniform(-1.0, 1.0, 200) * pushed
    after_t, after_p = impact.free_tool(m_t, m_p, v_t, v_p, e, *([push] if pushed else []))
    assert m_t * after_t + m_p * after_p == pytest.approx(m_t * v_t + m_p * v_p + push, rel=1e-12, abs=1e-12)
    assert after_p - after_t == pytest.approx(e * (v_t - v_p), abs=1e-12)
    rigid = impact.rigid_tool(v_t, v_p, e)
    assert rigid - v_t == pytest.approx(e * (v_t - v_p), abs=1e-12)
    assert impact.free_tool(1e12, m_p, v_t, v_p, e)[1] == pytest.approx(rigid, abs=1e-10)


def test_sliding_distance_is_that_of_constant_friction():
    assert impact.sliding_distance([1.0, 0.0, 2.0], [0.0, 0.0, 0.5]) == pytest.approx([math.inf, 0.0, 4 / 9.80665])


def test_force_has_the_numbers_of_fig_22():
    mechanism = ig.Bistable()
    force, x = mechanism.force, np.linspace(0.0, 0.07, 100_001)
    barrier = quad(force, 0.0, mechanism.stroke)[0]
    assert force(x).max() == pytest.approx(1.0817, abs=5e-5)
    assert x[force(x).argmax()] == pytest.approx(25.69e-3, abs=5e-6)
    assert x[1:][force(x[1:]) > 0].max() == pytest.approx(64.156e-3, abs=1e-6)
    assert barrier == pytest.approx(44.1e-3, abs=5e-6)
    assert mechanism.energy([0.0, 0.01]) == pytest.approx([barrier, barrier - quad(force, 0.0, 0.01)[0]], rel=1e-9)
    assert mechanism.stroke == pytest.approx(64.156e-3, abs=5e-7)
    assert force(mechanism.stroke * np.array([-1.0, 0.0, 1.0])) == pytest.approx([0.0] * 3, abs=1e-14)


@pytest.mark.parametrize("zeta", [0.0, 0.1, 0.3, 0.5, 1.0, 2.0, 4.0])
def test_stop_returns_what_a_damper_that_never_pulls_returns(zeta):
    # exp(-2 zeta arccos(zeta) / sqrt(1 - zeta^2)), so exp(-2) = 0.1353 at zeta = 1: not 'completely inelastic'.
    # The spring is so weak that the tool stands still until the rear stop hits it at the flange's speed, 1 m/s.
    weak = ig.Bistable(stiffness=1e-9, front_stop=5e-3, rear_stop=-5e-3, stop_damping_ratio=zeta)
    outcome = ig.simulate(scene(coupling=weak, distance=50.0), ig.Trapezoid(1.0, 1e3), 0.017, 1e-12)
    assert outcome.tool_velocity - 1 == pytest.approx(ig.physics.dissipation.delivered_linear(2 * zeta), rel=1e-7)
    assert len(outcome.snap_through) == 1
