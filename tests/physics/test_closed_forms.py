"""Closed forms: Hertz's stiffness, the instantaneous impact (eq. 1-4, 22), the peak force; the bistable mechanism."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from solver_scenes import BOTH, CRUISE, log_uniform, scene

import impact_gym as ig
from experiments.reference.laws import BistableForce
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
        assert 0 < material.young[0] <= material.young[1] < 1e12
        assert material.poisson[0] > 0 or name == "memory-foam"  # an open-cell foam
        assert 0 <= material.poisson[0] <= material.poisson[1] <= 0.5
        if GENT not in material.source:  # sources print two digits of a modulus
            assert [float(f"{young:.2g}") for young in material.young] == list(material.young)
        least, most = material.restitution or (0, 1)
        assert 0 <= least <= most <= 1


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


RNG = np.random.default_rng(1)
M_T, M_P = RNG.uniform(0.01, 5.0, (2, 200))
V_T, V_P = RNG.uniform(-2.0, 2.0, (2, 200))
E = RNG.uniform(0.0, 1.0, 200)
PUSH = RNG.uniform(-1.0, 1.0, 200)


@pytest.mark.parametrize("push", [(), (PUSH,)], ids=["free", "pushed"])
def test_free_tool_obeys_push_and_restitution(push):
    after_t, after_p = impact.free_tool(M_T, M_P, V_T, V_P, E, *push)
    assert M_T * after_t + M_P * after_p == pytest.approx(M_T * V_T + M_P * V_P + sum(push), rel=1e-12, abs=1e-12)
    assert after_p - after_t == pytest.approx(E * (V_T - V_P), abs=1e-12)
    assert impact.rigid_tool(V_T, V_P, E) - V_T == pytest.approx(E * (V_T - V_P), abs=1e-12)
    heavy = impact.free_tool(1e12, M_P, V_T, V_P, E)[1]
    assert heavy == pytest.approx(impact.rigid_tool(V_T, V_P, E), abs=1e-10)


def test_rigid_and_free_tool_have_the_papers_examples():
    assert impact.rigid_tool(1.0, 0.0, [1.0, 0.0]) == pytest.approx([2.0, 1.0])  # section 2.1
    v_t, v_p = impact.free_tool(0.125, 0.25, 1.0, 0.0, [0.0, 1.0])
    assert v_t == pytest.approx([1 / 3, -1 / 3])  # Fig. 2, by hand
    assert v_p == pytest.approx([1 / 3, 2 / 3])
    assert impact.sliding_distance([1.0, 0.0, 2.0], [0.0, 0.0, 0.5]) == pytest.approx([math.inf, 0.0, 4 / 9.80665])


@pytest.mark.parametrize("restitution", [0.1, 0.5, 1.0])
def test_stiff_simulated_contact_approaches_eq_3_and_4(restitution):
    errors, stiffnesses = [], [1e11, 1e12, 1e13]
    for stiffness in stiffnesses:
        sprung = scene(stiffness, restitution, ig.SpringDamper(150.0), dissipation="exact")
        contact = ig.simulate(sprung, CRUISE, duration=0.5, rtol=1e-11).contacts[0]
        thing = impact.free_tool(0.125, 0.25, contact.approach_velocity, 0.0, restitution)[1]
        errors.append(contact.object_velocity / thing - 1)
    # the contact's duration, over which the coupling pushes, goes with k_c^(-2/5)
    assert np.polyfit(np.log(stiffnesses), np.log(errors), 1)[0] == pytest.approx(-0.4, abs=0.03)


def test_elastic_contact_stores_energy_and_work_of_the_push():
    random = np.random.default_rng(5)
    for share in random.uniform(0.01, 0.6, 100):
        k_c, mass, peak = (log_uniform(random, *ends) for ends in ((1e3, 1e7), (0.02, 5.0), (1.0, 1000.0)))
        deepest, push = (peak / k_c) ** (2 / 3), 0.4 * share * peak
        speed = math.sqrt(2.0 * (0.4 * peak - push) * deepest / mass)
        acceleration = push / mass
        met = scene(k_c, 1.0, m_p=mass, distance=speed**2 / (2.0 * acceleration))
        duration = speed / acceleration + 5.0 * deepest / speed
        outcome = ig.simulate(met, ig.Trapezoid(1e6, acceleration), duration)
        assert outcome.peak_force == pytest.approx(peak, rel=1e-5)


MECHANISM, TOOL_MASS = ig.Bistable(), 0.125  # kg


@pytest.mark.parametrize("force", [MECHANISM.force, np.vectorize(BistableForce(MECHANISM, TOOL_MASS).spring)])
def test_force_has_the_numbers_of_fig_22(force):
    x = np.linspace(0.0, 0.07, 100_001)
    barrier = quad(force, 0.0, MECHANISM.stroke)[0]
    assert force(x).max() == pytest.approx(1.0817, abs=5e-5)
    assert x[force(x).argmax()] == pytest.approx(25.69e-3, abs=5e-6)
    assert x[1:][force(x[1:]) > 0].max() == pytest.approx(64.156e-3, abs=1e-6)
    assert barrier == pytest.approx(44.1e-3, abs=5e-6)
    assert MECHANISM.energy([0.0, 0.01]) == pytest.approx([barrier, barrier - quad(force, 0.0, 0.01)[0]], rel=1e-9)
    assert MECHANISM.stroke == pytest.approx(64.156e-3, abs=5e-7)
    assert force(MECHANISM.stroke * np.array([-1.0, 0.0, 1.0])) == pytest.approx([0.0] * 3, abs=1e-14)


def test_slider_rests_where_its_front_stop_bears_the_preload():
    rng = np.random.default_rng(8)
    for stop_stiffness in [1e2, 1e5, 1e9] * 60:
        height = rng.uniform(0.005, 0.06)
        mechanism = ig.Bistable(rng.uniform(20.0, 2000.0), rng.uniform(1.05, 2.0) * height, height, 1e-6, -1e-6)
        front = mechanism.stroke * rng.uniform(0.01, 0.99)
        mechanism = replace(mechanism, front_stop=front, stop_stiffness=stop_stiffness)
        assert mechanism.rest == pytest.approx(BistableForce(mechanism, TOOL_MASS).x0, rel=1e-14)


@pytest.mark.parametrize(("share", "pressed", "held"), [(0.87, True, True), (0.97, False, True), (1.03, False, False)])
def test_mechanism_leaves_the_front_stop_above_its_preload(share, pressed, held):
    # The preload can accelerate the tool by preload / tool mass. After a sudden start the stop (zeta = 1) overshoots by
    # exp(-2), so the slider leaves it for a moment from a share of 1 / (1 + exp(-2)) = 0.8808 on.
    acceleration = share * MECHANISM.force(MECHANISM.front_stop) / TOOL_MASS
    far, motion = scene(1e3, 0.1, MECHANISM, distance=1e3), ig.Trapezoid(0.5, acceleration)
    trace = ig.simulate(far, motion, 0.5 / acceleration, 1e-10, trace=True).trace
    x = trace.tool_position - trace.flange_position + MECHANISM.rest
    assert np.all(x > MECHANISM.front_stop) == pressed  # throughout
    assert (x[-1] > MECHANISM.front_stop) == held


@BOTH
@pytest.mark.parametrize("zeta", [0.0, 0.1, 0.3, 0.5, 1.0, 2.0, 4.0])
def test_stop_returns_what_a_damper_that_never_pulls_returns(simulate, zeta):
    # exp(-2 zeta arccos(zeta) / sqrt(1 - zeta^2)), so exp(-2) = 0.1353 at zeta = 1: not 'completely inelastic'.
    # The spring is so weak that the tool stands still until the rear stop hits it at the flange's speed, 1 m/s.
    weak = ig.Bistable(stiffness=1e-9, front_stop=5e-3, rear_stop=-5e-3, stop_damping_ratio=zeta)
    outcome = simulate(scene(coupling=weak, distance=50.0), ig.Trapezoid(1.0, 1e3), 0.017)
    assert outcome.tool_velocity - 1 == pytest.approx(ig.physics.dissipation.delivered_linear(2 * zeta), rel=1e-7)
    assert len(outcome.snap_through) == 1
