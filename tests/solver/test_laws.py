"""Every run obeys the laws of forces, momentum and energy, and closed forms, whatever the trace and the units."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from scipy.special import beta, betainc
from solver_scenes import COUPLINGS, ROBOTS, log_uniform, on_rough_ground, random_approach, scene, stored_energy

import impact_gym as ig
from impact_gym.physics.impact import GRAVITY
from impact_gym.quantities import BY_PATH
from impact_gym.scene import LAWS
from impact_gym.support import dotted_paths

SEEDS = range(1060, 1120)


@cache
def traced():
    return [(approach, ig.simulate(*approach, trace=True)) for approach in map(random_approach, SEEDS)]


def test_contact_force_is_that_of_eq_5_and_never_pulls():
    repeated = 0
    for (chain, _, _), outcome in traced():
        trace, k_c, e = outcome.trace, chain.contact.stiffness, chain.contact.restitution
        penetration = trace.tool_position - trace.object_position
        rate = trace.tool_velocity - trace.object_velocity
        expected = np.zeros_like(trace.time)
        for contact in outcome.contacts:
            inside = (trace.time > contact.start) & (trace.time < (contact.end or np.inf))
            chi = 1.5 * (1 - e) / e * k_c / contact.approach_velocity  # eq. 7
            force = (k_c + chi * rate) * np.maximum(penetration, 0.0) ** 1.5
            expected[inside] = np.maximum(force, 0.0)[inside]
        repeated += len(outcome.contacts) > 1
        # a penetration is a difference of positions with an error of 1e-16 m
        assert np.abs(trace.contact_force - expected).max() <= 2e-9 * outcome.peak_force
        assert trace.contact_force.min() >= 0.0
        assert np.diff(trace.object_velocity).min() > -1e-13
    assert repeated >= 5


def test_coupling_force_is_that_of_eq_17_or_of_imposed_motion():
    for (chain, motion, _), outcome in traced():
        trace, m = outcome.trace, chain.tool.mass
        if isinstance(chain.coupling, ig.Rigid):
            assert np.abs(trace.tool_position - trace.flange_position).max() < 1e-15
            imposed = m * np.array([motion.acceleration, 0.0, -motion.deceleration])
            inertia = trace.coupling_force - trace.contact_force
            assert np.abs(inertia[:, None] - imposed).min(axis=1).max() < 1e-9 * trace.contact_force.max()
            continue
        k, zeta = chain.coupling.stiffness, chain.coupling.damping_ratio
        force = k * (trace.flange_position - trace.tool_position)
        force += 2 * zeta * np.sqrt(k * m) * (trace.flange_velocity - trace.tool_velocity)
        assert np.abs(trace.coupling_force - force).max() <= 1e-10 * np.abs(force).max()


def test_trace_changes_nothing_and_is_where_shorter_runs_end():
    for approach, outcome in traced():
        (chain, motion, duration), trace = approach, outcome.trace
        assert outcome._replace(trace=None) == ig.simulate(*approach)
        assert trace.time[[0, -1]] == pytest.approx([0.0, duration], rel=3e-16)
        assert np.diff(trace.time).min() >= 0.0
        assert trace.contact_force.max() <= outcome.peak_force * (1 + 1e-12)
        for time in [time for contact in outcome.contacts for time in (contact.start, contact.end or duration)]:
            assert np.abs(trace.time / time - 1).min() < 3e-16
        for at in (len(trace.time) // 3, len(trace.time) // 2, -1):
            ended = ig.simulate(chain, motion, trace.time[at], trace=True).trace
            for body, (what, close) in product(("flange", "tool", "object"), (("position", 1e-9), ("velocity", 1e-7))):
                there, whole = (getattr(each, f"{body}_{what}") for each in (ended, trace))
                assert there[-1] == pytest.approx(whole[at], abs=close), body


def test_more_contacts_snaps_and_instants_than_allocated():
    # the tool accelerates behind an elastic object, which bounces off it every 0.2 ms
    bounces = scene(1e12, 1.0, distance=1e-7), ig.Trapezoid(2000.0, 20.0)
    many = ig.simulate(*bounces, 1.5, 1e-12)
    once = ig.simulate(scene(robot=ig.Robot(1.0, 1e10, 1e-3)), ig.Trapezoid(1.0, 8.0), 1.5, trace=True)
    assert min(len(many.contacts), len(once.trace.time)) > 4096  # the first allocation, of instants
    assert (len(once.contacts), once.trace.time[-1]) == (1, pytest.approx(1.5))
    approach, start = np.array([(contact.approach_velocity, contact.start) for contact in many.contacts]).T
    assert approach == pytest.approx(np.sqrt(2 * 20.0 * 1e-7), rel=1e-8)
    assert np.diff(start) == pytest.approx(start[1] - start[0], rel=1e-8)
    elastic = replace(COUPLINGS["bistable"], stop_damping_ratio=0.0)
    never = scene(1e3, 0.1, elastic, distance=1e3), ig.Trapezoid(1.0, 1e3)
    short, long = (ig.simulate(*never, duration).snap_through for duration in (0.5, 6.0))
    assert len(long) > 64
    assert long[: len(short)] == short


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_simulate_does_not_depend_on_the_units(coupling, robot):
    closed = robot == "rigid robot" and coupling != "bistable"  # otherwise flight is integrated
    rel = 1e-11 if closed else 1e-7  # the rounding of delta0, a power of 0.4
    some = [(2, 1, 1), (1e-4, 1e-5, 1e-5), (1, 1, 0.5), (3, 0.7, 1.3)]
    for seed, (mass, length, time) in product(SEEDS[:20] if closed else range(3), some):
        chain, motion, duration = random_approach(seed, coupling, robot, LAWS)
        speed, force = length / time, mass * length / time**2
        factors = {"kg": mass, "m": length, "s": time, "N": force, "m/s": speed, "m/s^2": speed / time}
        factors |= {"N/m": force / length, "N s/m": force / speed}
        factors[BY_PATH["contact.stiffness"].unit] = force / length**chain.contact.stiffness_exponent  # N/m^m
        records = {**dotted_paths.parts(chain), "motion": motion}
        numbers = {path: x * factors.get(BY_PATH[path].unit, 1.0) for path, x in dotted_paths.flatten(records).items()}
        other = dotted_paths.replaced(records, numbers)
        moved = other.pop("motion")
        if isinstance(chain.robot, ig.RobotTable):
            scales = {"position": length, "mass": mass, "stiffness": force / length, "damping": force / speed}
            table = {name: scale * np.array(getattr(chain.robot, name)) for name, scale in scales.items()}
            other["robot"] = ig.RobotTable(**table)
        a, b = ig.simulate(chain, motion, duration), ig.simulate(ig.Scene(**other), moved, duration * time)
        assert len(a.contacts) == len(b.contacts)
        assert b.object_velocity == pytest.approx(a.object_velocity * speed, rel=rel)
        assert b.peak_force == pytest.approx(a.peak_force * force, rel=rel)
        assert (b.detection_time or 0.0) == pytest.approx((a.detection_time or 0.0) * time, rel=rel)
        if closed:
            assert b.tool_velocity == pytest.approx(a.tool_velocity * speed, rel=1e-12, abs=1e-13 * speed)
            assert b.coupling_impulse == pytest.approx(a.coupling_impulse * force * time, rel=1e-11)


@pytest.mark.parametrize("features", [["friction"], ["stroke"], ["fixed"], ["friction", "stroke", "fixed"]])
def test_energy_grows_at_most_by_the_work_of_the_ground(features):
    """Energy (J) of object, contact, tool and coupling in the frame of the steady motion."""
    for seed in (seed for seed in range(60) if seed % 12 < 4):  # without a robot
        chain, motion, duration = on_rough_ground(seed, *features)
        v, m, k_c = motion.speed, chain.contact.stiffness_exponent, chain.contact.stiffness
        trace = ig.simulate(chain, replace(motion, brake=None), duration + 0.2, rtol=1e-11, trace=True).trace
        depth = np.maximum(trace.tool_position - trace.object_position, 0.0)
        energy = 0.5 * chain.object.mass * (trace.object_velocity - v) ** 2 + k_c * depth ** (m + 1) / (m + 1)
        energy += stored_energy(chain.coupling, trace.tool_position - trace.flange_position)
        if not isinstance(chain.coupling, ig.Rigid):  # else the motion of the tool is imposed
            energy += 0.5 * chain.tool.mass * (trace.tool_velocity - v) ** 2
        work = v * (chain.object.friction or 0.0) * chain.object.mass * GRAVITY * np.diff(trace.time)
        steady = trace.time[:-1] > v / motion.acceleration * (1 + 1e-12)
        assert (np.diff(energy) - work)[steady].max() < 1e-9 * energy.max()


@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
def test_peak_end_and_alarm_of_a_contact_are_of_a_closed_form(rtol):
    """In random elastic contacts with a tool of imposed motion. Energy is conserved, so all times are beta functions.

    From v^2 - delta_dot^2 = 2/n k/m delta^n with n = 5/2 of Hertz, or another, and x = (delta / deepest)^n:
    t(delta) = deepest/v / n B(x; 1/n, 1/2), which is half the duration at x = 1.
    """
    for seed, share in product(range(30), (1e-3, 0.5, 0.9, 0.999, 1 - 2 * rtol, 1 + 2 * rtol)):
        random = np.random.default_rng([13, seed])
        v, acceleration = random.uniform(0.2, 1.5), random.uniform(2, 20)
        mass, stiffness = log_uniform(random, 0.05, 2.5), log_uniform(random, 1e3, 1e7)
        exponent = (1.5, 1.0, 1.5, 2.0, 1.5, 3.0)[seed % 6]
        distance, n = v**2 / (2 * acceleration) + random.uniform(0.01, 0.2), exponent + 1
        start = distance / v + v / (2 * acceleration)
        deepest = (n / 2 * mass * v**2 / stiffness) ** (1 / n)
        peak, duration = stiffness * deepest**exponent, 2 / n * deepest / v * beta(1 / n, 0.5)
        powers = {"stiffness_exponent": exponent, "damping_exponent": exponent}
        elastic = scene(stiffness, 1.0, m_p=mass, distance=distance, **powers)
        motion = ig.Trapezoid(v, acceleration, ig.Brake(share * peak, delay=1.0))
        outcome = ig.simulate(elastic, motion, start + 2 * duration, rtol)
        (contact,) = outcome.contacts
        assert contact.peak_force == pytest.approx(peak, rel=rtol)
        assert contact.end - contact.start == pytest.approx(duration, rel=rtol + 1e-12 / duration)  # of a clock at 1 s
        assert contact.separation_velocity == pytest.approx(v, rel=rtol + 1e-12)
        if share > 1:
            assert outcome.detection_time is None
        else:  # as early or late as with a force that is wrong by rtol of its peak
            x = np.clip([share - rtol, share + rtol], 0.0, 1.0) ** (n / exponent)
            early, late = start + 0.5 * duration * betainc(1 / n, 0.5, x)
            assert early - 1e-14 < outcome.detection_time < late + 1e-14
