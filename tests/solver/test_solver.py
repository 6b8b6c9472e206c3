"""The fast solver against an independent slow one, and the laws that every run must obey."""

import math
from itertools import product

import numpy as np
import pytest
from scenes import MOTION, log_uniform, scene, time_unit

import impact_gym as ig
from experiments import reference
from impact_gym import simulation

SCENES = 150
RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
STIFF = ig.SpringDamper(1e8)


def random_case(seed):
    """Scene, motion and duration of a random approach that ends well after its first contact."""
    random = np.random.default_rng([2020, seed])
    speed, acceleration, distance = random.uniform(0.2, 1.5), random.uniform(1, 20), random.uniform(0.05, 0.35)
    coupling, brake = ig.Rigid(), None
    if random.random() < 0.8:
        coupling = ig.SpringDamper(log_uniform(random, 20, 300), random.uniform(0, 3))
    if random.random() < 0.85:
        brake = ig.Brake(log_uniform(random, 0.05, 20), random.uniform(0, 0.03), random.uniform(1, 20))
    chain = ig.Scene(
        ig.Tool(log_uniform(random, 0.05, 0.5)),
        ig.Object(log_uniform(random, 0.1, 2.5), distance),
        ig.Contact(log_uniform(random, 1e3, 1e6), random.uniform(0.1, 1)),
        coupling,
    )
    return chain, ig.Trapezoid(speed, acceleration, brake), distance / speed + speed / acceleration + 0.25


def errors(seed, rtol, exact):
    """Largest relative error of each kind in one run; times count in t0, velocities in the approach velocity."""
    case = random_case(seed)
    fast = ig.simulate(*case, rtol)
    pairs = list(zip(fast.contacts, exact.contacts, strict=True))
    assert (fast.detection_time is None) == (exact.detection_time is None)
    assert all((a.end is None) == (b.end is None) for a, b in pairs)
    if not pairs:
        assert fast.object_velocity == fast.peak_force == 0.0
        return dict.fromkeys(("object velocity", "peak force", "impulse", "detection", "separation"), 0.0)
    impulse, first = sum(contact.impulse for contact in exact.contacts), exact.contacts[0]
    parting = [abs(a.separation_velocity - b.separation_velocity) for a, b in pairs if b.end is not None]
    return {
        "object velocity": abs(fast.object_velocity / exact.object_velocity - 1),
        "peak force": abs(fast.peak_force / exact.peak_force - 1),
        "impulse": max(abs(a.impulse - b.impulse) for a, b in pairs) / impulse,
        "detection": abs((fast.detection_time or 0.0) - (exact.detection_time or 0.0)) / time_unit(case[0], first),
        "separation": max(parting, default=0.0) / first.approach_velocity,
    }


@pytest.mark.storm
@pytest.mark.parametrize("first", range(0, SCENES, 15))
def test_the_fast_solver_agrees_with_the_slow_one_to_the_tolerance_asked_for(first):
    too_large = {}
    for seed in range(first, first + 15):
        exact = reference.simulate(*random_case(seed), rtol=1e-11)
        for rtol in (*RTOLS, 1e-10, 1e-13):
            for kind, error in errors(seed, rtol, exact).items():
                if error > max(rtol, 1e-10):  # the slow solver is as good as that
                    too_large[seed, rtol, kind] = error
    assert too_large == {}


@pytest.fixture(scope="module")
def errors_by_tolerance():
    """Of each scene at each tolerance, by kind (SCENES, tolerances)."""
    # at a tight tolerance our own solver is as good as the slow one, as the storm shows
    exact = [ig.simulate(*random_case(seed), rtol=1e-13) for seed in range(SCENES)]
    found = [[errors(seed, rtol, one) for rtol in RTOLS] for seed, one in enumerate(exact)]
    return {kind: np.array([[error[kind] for error in row] for row in found]) for kind in found[0][0]}


@pytest.mark.parametrize("kind", ["object velocity", "peak force", "detection", "separation"])
def test_each_smaller_tolerance_gives_a_smaller_error(kind, errors_by_tolerance):
    found = errors_by_tolerance[kind]
    assert np.all(np.median(found, axis=0) <= RTOLS)  # ten times as much would be allowed
    largest = np.quantile(found, 0.9, axis=0)
    assert np.all(np.diff(largest) < 0.0)
    # six orders of rtol; a detection is where the force crosses the threshold, met to rounding in a third of the scenes
    assert largest[-1] < largest[0] * (1e-5 if kind != "detection" else 1e-3)


@pytest.mark.parametrize("push", [-1.0, -2.0, -3.0])
def test_a_force_clamped_at_zero_costs_no_accuracy(push):
    t0 = (0.25 / 1e5) ** 0.4
    for delay in np.linspace(0.0, 0.6, 13):
        brake = ig.Brake(threshold=0.0, delay=delay * t0, deceleration=-push / t0)
        case = scene(1e5, 0.2, distance=0.1), ig.Trapezoid(1.0, 8.0, brake), 0.1 + 1 / 16 + 30 * t0
        exact = reference.simulate(*case, rtol=1e-11)
        for rtol in np.geomspace(1e-3, 1e-8, 41):
            outcome = ig.simulate(*case, rtol)
            assert outcome.object_velocity == pytest.approx(exact.object_velocity, rel=rtol), (delay, rtol)


def barely_parting(coupling_stiffness):
    """Below about 13.86 N/m the second contact parts and a third follows; above, the second goes on."""
    return scene(1e6, 0.3, ig.SpringDamper(float(coupling_stiffness))), MOTION, 1.5


@pytest.mark.parametrize(("stiffness", "contacts", "velocity"), [(13.86003, 3, 0.6183), (13.86004, 2, 0.6210)])
def test_the_slow_solver_changes_sides_between_two_springs(stiffness, contacts, velocity):
    exact = reference.simulate(*barely_parting(stiffness), rtol=1e-11)
    assert len(exact.contacts) == contacts
    assert exact.object_velocity == pytest.approx(velocity, abs=5e-5)


@pytest.mark.parametrize("rtol", [1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12])
def test_a_contact_that_only_just_parts_is_not_stepped_over(rtol, monkeypatch):
    monkeypatch.setattr(simulation, "MAX_STEPS", 100_000)  # a few hundred are needed; fail in less than a minute
    low, high = 13.8, 13.9
    while low < (middle := 0.5 * (low + high)) < high:
        outcome = ig.simulate(*barely_parting(middle), rtol=rtol)  # parting velocity down to 1e-9 m/s
        assert len(outcome.contacts) in (2, 3)
        assert all(contact.approach_velocity > 0 for contact in outcome.contacts)
        assert outcome.object_velocity == pytest.approx(0.6210 if len(outcome.contacts) == 2 else 0.6183, abs=1e-3)
        low, high = (middle, high) if len(outcome.contacts) == 3 else (low, middle)
    assert low == pytest.approx(0.5 * (13.86003 + 13.86004), rel=1e-6)


SEEDS = range(1000, 1060)


def runs(seeds=SEEDS, trace=True, **options):
    """Random scenes, their motions and what comes of them."""
    for seed in seeds:
        chain, motion, duration = random_case(seed)
        yield chain, motion, ig.simulate(chain, motion, duration, trace=trace, **options)


def test_the_object_is_never_pulled():
    for _, _, outcome in runs():
        assert outcome.trace.contact_force.min() >= 0.0
        assert np.diff(outcome.trace.object_velocity).min() > -1e-13


def test_the_contact_force_is_that_of_eq_5_with_a_fresh_approach_velocity():
    repeated = 0
    for chain, _, outcome in runs():
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
        # a penetration is a difference of positions, known to 1e-16 m: the force to that over the root of it
        assert trace.contact_force == pytest.approx(expected, abs=1e-9 * outcome.peak_force, rel=1e-9)
    assert repeated >= 5


def test_the_coupling_force_is_that_of_eq_17_or_of_the_imposed_motion():
    for chain, motion, outcome in runs():
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


def test_the_trace_does_not_change_the_outcome_and_ends_with_it():
    for seed, (*_, traced), (*_, plain) in zip(SEEDS, runs(), runs(trace=False), strict=True):
        assert traced._replace(trace=None) == plain
        trace, duration = traced.trace, random_case(seed)[2]
        assert (trace.time[0], trace.time[-1]) == (0.0, duration)
        assert np.diff(trace.time).min() >= 0.0
        for name in ("flange_velocity", "tool_velocity", "object_velocity"):
            assert getattr(trace, name)[-1] == pytest.approx(getattr(plain, name), rel=1e-14, abs=1e-15)
        assert trace.contact_force.max() <= plain.peak_force * (1 + 1e-12)
        for contact in plain.contacts:
            assert {contact.start, contact.end or duration} <= set(trace.time)


def test_the_trace_is_a_motion_under_its_forces():
    for chain, _, outcome in runs(rtol=1e-10):
        trace = outcome.trace
        step = np.diff(trace.time)

        def integral(values, step=step):
            return np.cumsum(0.5 * (values[1:] + values[:-1]) * step)

        for body in ("flange", "tool", "object"):
            position, velocity = getattr(trace, f"{body}_position"), getattr(trace, f"{body}_velocity")
            assert position[1:] - position[0] == pytest.approx(integral(velocity), abs=2e-4 * np.abs(position).max())
        impulse = chain.object.mass * trace.object_velocity
        assert impulse[1:] == pytest.approx(integral(trace.contact_force), abs=2e-4 * impulse[-1])
        if isinstance(chain.coupling, ig.Rigid):
            continue  # the tool's motion is imposed
        on_tool = chain.tool.mass * trace.tool_velocity
        net = integral(trace.coupling_force - trace.contact_force)
        assert on_tool[1:] == pytest.approx(net, abs=5e-4 * (np.abs(on_tool).max() + impulse[-1]))


def test_a_long_trace_is_complete():
    time = ig.simulate(*random_case(0)[:2], 6.0, trace=True).trace.time
    assert len(time) > 6000
    assert time[-1] == 6.0
    assert np.diff(time).max() < 1.001e-3


def test_momentum_given_is_momentum_received():
    for chain, _, outcome in runs(range(1000, 2000), trace=False):
        assert outcome.momentum_error < 1e-9
        received = chain.object.mass * outcome.object_velocity
        assert sum(contact.impulse for contact in outcome.contacts) == pytest.approx(received, rel=1e-12)
        if outcome.contacts:
            assert outcome.contacts[-1].object_velocity == pytest.approx(outcome.object_velocity, rel=1e-12)
            assert outcome.peak_force == max(contact.peak_force for contact in outcome.contacts)


@pytest.mark.parametrize(("mass", "length", "time"), [(2, 1, 1), (1, 4, 1), (1, 1, 0.5), (0.25, 8, 4)])
def test_a_change_of_units_changes_only_the_numbers(mass, length, time):
    # by powers of two: what is left is the rounding of delta0, a power of 0.4
    speed, acceleration, force = length / time, length / time**2, mass * length / time**2
    for seed in SEEDS:
        chain, motion, duration = random_case(seed)
        brake, coupling, contact = motion.brake, chain.coupling, chain.contact
        if brake:
            brake = ig.Brake(brake.threshold * force, brake.delay * time, brake.deceleration * acceleration)
        if isinstance(coupling, ig.SpringDamper):
            coupling = ig.SpringDamper(coupling.stiffness * force / length, coupling.damping_ratio)
        other = ig.Scene(
            ig.Tool(chain.tool.mass * mass),
            ig.Object(chain.object.mass * mass, chain.object.distance * length),
            ig.Contact(contact.stiffness * force / length**1.5, contact.restitution),
            coupling,
        )
        other_motion = ig.Trapezoid(motion.speed * speed, motion.acceleration * acceleration, brake)
        a, b = ig.simulate(chain, motion, duration), ig.simulate(other, other_motion, duration * time)
        assert len(a.contacts) == len(b.contacts)
        assert b.object_velocity == pytest.approx(a.object_velocity * speed, rel=1e-12)
        assert b.tool_velocity == pytest.approx(a.tool_velocity * speed, rel=1e-12, abs=1e-13 * speed)
        assert b.peak_force == pytest.approx(a.peak_force * force, rel=1e-12)
        assert b.coupling_impulse == pytest.approx(a.coupling_impulse * force * time, rel=1e-11)
        if a.detection_time is not None:
            assert b.detection_time == pytest.approx(a.detection_time * time, rel=1e-12)


@pytest.mark.parametrize("coupling", [ig.Rigid(), ig.SpringDamper(150.0), ig.SpringDamper(20.0, 0.0)], ids=str)
@pytest.mark.parametrize("restitution", [0.02, 0.5, 1.0])
def test_extreme_scenes_stay_finite_and_keep_their_momentum(coupling, restitution):
    for stiffness, object_mass in product(10.0 ** np.arange(2, 11), 0.125 * 10.0 ** np.arange(-3, 4)):
        outcome = ig.simulate(scene(stiffness, restitution, coupling, m_p=object_mass), MOTION, 1.0)
        assert outcome.momentum_error < 1e-9
        assert outcome.contacts
        assert outcome.object_velocity == pytest.approx(outcome.contacts[-1].object_velocity, rel=1e-12)
        for contact in outcome.contacts:
            assert all(map(math.isfinite, contact._replace(end=0.0)))
            assert min(contact.approach_velocity, contact.peak_force, contact.impulse) > 0
        assert all(map(math.isfinite, (outcome.tool_velocity, outcome.flange_velocity, outcome.coupling_impulse)))


def test_a_run_that_cannot_finish_says_why(monkeypatch):
    monkeypatch.setattr(simulation, "MAX_STEPS", 10)
    with pytest.raises(RuntimeError, match=r"stopped at t = 0\.\d+ s: more integration steps than allowed"):
        ig.simulate(*random_case(0))


@pytest.mark.parametrize(
    ("chain", "rigid", "steps"),
    [  # a flight alone has 1e9 half periods; only those within reach of the object are looked at
        *((scene(coupling=ig.SpringDamper(1e18, ratio)), scene(), 1000) for ratio in (0.0, 0.01, 1.0, 3.0)),
        # a robot that rings at 5 MHz, for ever
        (scene(coupling=STIFF, robot=ig.Robot(1.0, 1e15, 1e-3)), scene(coupling=STIFF), 100_000),
    ],
)
def test_what_swings_too_fast_to_follow_is_passed_over_and_ends_as_if_it_were_rigid(chain, rigid, steps):
    outcome = ig.simulate(chain, MOTION)
    assert outcome.object_velocity == pytest.approx(ig.simulate(rigid, MOTION).object_velocity, rel=1e-8)
    assert outcome.steps < steps


def test_what_is_recorded_does_not_depend_on_the_room_for_it(monkeypatch):
    motion = ig.Trapezoid(1.2, 8.0, ig.Brake())
    cases = scene(1e6, 1.0, ig.SpringDamper(150.0, 1.0), m_p=1.0), scene(coupling=ig.Bistable())
    bounces, snap = at_once = [ig.simulate(one, motion, trace=True) for one in cases]
    assert len(bounces.contacts) > 1
    assert snap.snap_through
    for name in ("_CONTACT_ROWS", "_SNAP_ROWS", "_TRACE_ROWS"):
        monkeypatch.setattr(simulation, name, 1)
    for one, before in zip(cases, at_once, strict=True):
        after = ig.simulate(one, motion, trace=True)
        assert after._replace(trace=None) == before._replace(trace=None)
        for name in ("time", "object_velocity", "contact_force", "flange_position"):
            assert np.array_equal(getattr(after.trace, name), getattr(before.trace, name))
