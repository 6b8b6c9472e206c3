"""Every run obeys the laws of forces, momentum and motion, and depends on neither trace, units nor frame."""

import math
from dataclasses import is_dataclass, replace
from itertools import product

import numpy as np
import pytest
from impact_gym.kernels import APPROACH, CHAIN, approach_rows
from solver_scenes import COUPLINGS, MOTION, ROBOTS, random_approach, scene

import impact_gym as ig
from impact_gym.scene import Dissipation
from impact_gym.simulation import MAX_STEPS, NOTHING_RECORDED
from impact_gym.to_kernel import LOCAL_SHARE, approach_to_kernel

SEEDS = range(1060, 1120)


def runs(seeds=SEEDS, trace=True, **options):
    for seed in seeds:
        approach = random_approach(seed)
        yield approach, ig.simulate(*approach, trace=trace, **options)


def test_contact_force_is_that_of_eq_5_with_the_approach_velocity_of_each_contact_and_never_pulls():
    repeated = 0
    for (chain, _, _), outcome in runs():
        trace, k_c, e = outcome.trace, chain.contact.stiffness, chain.contact.restitution
        penetration = trace.tool_position - trace.object_position
        rate = trace.tool_velocity - trace.object_velocity
        expected = np.zeros_like(trace.time)
        for contact in outcome.contacts:
            inside = (trace.time > contact.start) & (trace.time < (contact.end or math.inf))
            chi = 1.5 * (1 - e) / e * k_c / contact.approach_velocity  # eq. 7
            force = (k_c + chi * rate) * np.maximum(penetration, 0.0) ** 1.5
            expected[inside] = np.maximum(force, 0.0)[inside]
        repeated += len(outcome.contacts) > 1
        # a penetration is a difference of positions with an error of 1e-16 m
        assert trace.contact_force == pytest.approx(expected, abs=1e-9 * outcome.peak_force, rel=1e-9)
        assert trace.contact_force.min() >= 0.0
        assert np.diff(trace.object_velocity).min() > -1e-13
    assert repeated >= 5


def test_coupling_force_is_that_of_eq_17_or_of_the_imposed_motion():
    for (chain, motion, _), outcome in runs():
        trace, m = outcome.trace, chain.tool.mass
        if isinstance(chain.coupling, ig.Rigid):
            assert trace.tool_position == pytest.approx(trace.flange_position, abs=1e-15)
            imposed = m * np.array([motion.acceleration, 0.0, -motion.deceleration])
            inertia = trace.coupling_force - trace.contact_force
            assert np.abs(inertia[:, None] - imposed).min(axis=1).max() < 1e-9 * trace.contact_force.max()
            continue
        k, zeta = chain.coupling.stiffness, chain.coupling.damping_ratio
        force = k * (trace.flange_position - trace.tool_position)
        force += 2 * zeta * math.sqrt(k * m) * (trace.flange_velocity - trace.tool_velocity)
        assert trace.coupling_force == pytest.approx(force, abs=1e-10 * np.abs(force).max())


def test_trace_does_not_change_the_outcome_and_ends_with_it():
    for (approach, traced), (_, plain) in zip(runs(), runs(trace=False), strict=True):
        assert traced._replace(trace=None) == plain
        trace, duration = traced.trace, approach[2]
        assert trace.time[0] == 0.0
        assert trace.time[-1] == pytest.approx(duration, rel=3e-16)
        assert np.diff(trace.time).min() >= 0.0
        for name in ("flange_velocity", "tool_velocity", "object_velocity"):
            assert getattr(trace, name)[-1] == pytest.approx(getattr(plain, name), rel=1e-14, abs=1e-15)
        assert trace.contact_force.max() <= plain.peak_force * (1 + 1e-12)
        for contact in plain.contacts:
            for time in (contact.start, contact.end or duration):
                assert np.abs(trace.time / time - 1).min() < 3e-16


def integral(time, values):
    """Integral from the first time to every second time, by the trapezoidal rule.

    Pairs of steps with similar lengths are extrapolated. Between other steps a smooth piece may end.
    """
    fine = (0.5 * (values[1:] + values[:-1]) * np.diff(time))[: (len(time) - 1) // 2 * 2].reshape(-1, 2).sum(axis=1)
    coarse = 0.5 * (values[:-2:2] + values[2::2]) * (time[2::2] - time[:-2:2])
    first, second = np.diff(time)[: 2 * len(fine)].reshape(-1, 2).T
    alike = np.maximum(first, second) < 2.0 * np.minimum(first, second)
    return np.cumsum(fine + np.where(alike, (fine - coarse) / 3.0, 0.0))


def test_trace_is_a_motion_under_its_forces():
    for (chain, _, _), outcome in runs(rtol=1e-10):
        trace = outcome.trace
        names = [(f"{body}_position", f"{body}_velocity") for body in ("flange", "tool", "object")]
        grown = [(getattr(trace, whole), getattr(trace, rate), 5e-5) for whole, rate in names]
        grown.append((chain.object.mass * trace.object_velocity, trace.contact_force, 5e-4))
        if not isinstance(chain.coupling, ig.Rigid):  # else the tool's motion is imposed
            net = trace.coupling_force - trace.contact_force
            grown.append((chain.tool.mass * trace.tool_velocity, net, 1e-3))  # two forces that nearly cancel
        for whole, rate, close in grown:
            expected = integral(trace.time, rate)
            assert whole[2::2] - whole[0] == pytest.approx(expected, abs=close * np.abs(whole).max())


def test_momentum_given_is_momentum_received():
    for (chain, _, _), outcome in runs(range(1000, 2000), trace=False):
        assert outcome.momentum_error < 1e-9
        received = chain.object.mass * outcome.object_velocity
        assert sum(contact.impulse for contact in outcome.contacts) == pytest.approx(received, rel=1e-12)
        if outcome.contacts:
            assert outcome.contacts[-1].object_velocity == pytest.approx(outcome.object_velocity, rel=1e-12)
            assert outcome.peak_force == max(contact.peak_force for contact in outcome.contacts)


def test_simulate_records_more_contacts_snaps_and_points_than_it_first_allocates():
    # the tool accelerates behind an elastic object, which bounces off it every 0.2 ms
    bounces = scene(1e12, 1.0, distance=1e-7), ig.Trapezoid(2000.0, 20.0)
    few, many = ig.simulate(*bounces, 0.5, 1e-12, trace=True), ig.simulate(*bounces, 1.5, 1e-12)
    assert len(many.contacts) > 4096  # the first allocation
    approach, start = np.array([(contact.approach_velocity, contact.start) for contact in many.contacts]).T
    assert approach == pytest.approx(math.sqrt(2 * 20.0 * 1e-7), rel=1e-8)
    assert np.diff(start) == pytest.approx(start[1] - start[0], rel=1e-8)
    together = len(few.contacts) - 1  # the last contact may be cut off by the end
    assert many.contacts[:together] == few.contacts[:together]
    assert len(few.trace.time) > 4096
    elastic = replace(COUPLINGS["bistable"], stop_damping_ratio=0.0)
    short, long = (
        ig.simulate(scene(1e3, 0.1, elastic, distance=1e3), ig.Trapezoid(1.0, 1e3), duration, trace=True)
        for duration in (0.5, 6.0)
    )
    assert len(long.snap_through) > 64
    assert long.snap_through[: len(short.snap_through)] == short.snap_through
    assert len(long.trace.time) > 6000
    assert long.trace.time[-1] == 6.0
    assert np.diff(long.trace.time).max() < 1.001e-3


LENGTHS = ("distance", "position", "free_length", "height", "front_stop", "rear_stop")


def in_units(value, mass, length, time, name=""):
    """A number or a record in other units; `mass`, `length` and `time` are the factors of the numbers."""
    force = mass * length / time**2
    if isinstance(value, ig.Contact):  # N/m^m
        reference = value.reference_velocity and value.reference_velocity * length / time
        stiffness = value.stiffness * force / length**value.stiffness_exponent
        return replace(value, stiffness=stiffness, reference_velocity=reference)
    if is_dataclass(value):
        names = [name for name in value.__dataclass_fields__ if getattr(value, name) is not None]
        return replace(value, **{name: in_units(getattr(value, name), mass, length, time, name) for name in names})
    factors = {"mass": mass, "speed": length / time, "threshold": force, "delay": time}
    factors["damping"] = force * time / length
    factors |= dict.fromkeys(LENGTHS, length) | dict.fromkeys(("acceleration", "deceleration"), length / time**2)
    factors |= dict.fromkeys(("stiffness", "stop_stiffness"), force / length)
    if isinstance(value, tuple):
        return tuple(number * factors[name] for number in value)
    return value * factors.get(name, 1.0) if isinstance(value, float) else value


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_simulate_does_not_depend_on_the_units(coupling, robot):
    closed = robot == "rigid robot" and coupling != "bistable"  # otherwise flight is integrated
    some = [(2, 1, 1), (1e-4, 1e-5, 1e-5), (1, 1, 0.5), (3, 0.7, 1.3)]
    for seed, units in product(SEEDS if closed else range(3), some):
        chain, motion, duration = random_approach(seed, coupling, robot, Dissipation.__args__)
        mass, length, time = units
        speed, force = length / time, mass * length / time**2
        a = ig.simulate(chain, motion, duration)
        b = ig.simulate(in_units(chain, *units), in_units(motion, *units), duration * time)
        assert len(a.contacts) == len(b.contacts)
        rel = 1e-12 if closed else 1e-8  # the rounding of delta0, a power of 0.4
        assert b.object_velocity == pytest.approx(a.object_velocity * speed, rel=rel)
        assert b.peak_force == pytest.approx(a.peak_force * force, rel=rel if closed else 1e-7)
        if a.detection_time is not None:
            assert b.detection_time == pytest.approx(a.detection_time * time, rel=rel)
        if closed:
            assert b.tool_velocity == pytest.approx(a.tool_velocity * speed, rel=1e-12, abs=1e-13 * speed)
            assert b.coupling_impulse == pytest.approx(a.coupling_impulse * force * time, rel=1e-11)


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_object_velocity_does_not_depend_on_the_frame(coupling):
    approach, there = (scene(1e5, 0.5, COUPLINGS[coupling]), MOTION, 0.8), []
    plan, table = approach_to_kernel(*approach)
    for boost in (0.0, 2.0, -3.0):  # m/s, of the room and of all bodies at the start
        plans, chains = np.array([plan], APPROACH), np.empty(1, CHAIN)
        plans["frame"] = boost
        approach_rows(plans, table, chains, 0, 1, LOCAL_SHARE * 1e-8, MAX_STEPS, NOTHING_RECORDED)
        end = chains[0]
        there.append(end["flange_velocity"] + end["deflection_rate"] - end["penetration_rate"] - boost)
    assert there[0] == ig.simulate(*approach).object_velocity
    # the error of an integrated flight is relative to the speed of the flange, which depends on the frame
    assert there[1:] == pytest.approx([there[0]] * 2, rel=1e-8 if coupling == "bistable" else 1e-11)


def test_peak_of_a_touch_of_less_than_a_millinewton_is_that_of_hertz():
    touch = ig.simulate(scene(1e3, 1.0, distance=1e-5), ig.Trapezoid(1e-4, 8.0), duration=5.0)
    assert touch.peak_force == pytest.approx(1.25**0.6 * 1e3**0.4 * (0.25 * 1e-8) ** 0.6, rel=1e-7)
    assert touch.contacts[0].peak_force == touch.peak_force < 1e-3
