"""What the controller sees of what it must not, sensors that err, and the range sensor.

That all observations are those of the independent solver, whatever is done: `test_reference_task.py`.
"""

import gymnasium as gym
import numpy as np
import pytest
from episodes import (
    FORCE,
    ID,
    PEAK,
    ROBOT,
    Always,
    action_table,
    assert_identical,
    at_rest,
    encode,
    newtons,
    play,
)
from refusals import refused
from scipy import stats
from steered import ARM, OWN
from tasks import RANGE_SENSOR

import impact_gym as ig
from agents.baselines import PaperTrapezoid
from impact_gym.envs.batch import Batch
from impact_gym.task import Task
from impact_gym.task.range_sensor import RangeSensor


def test_approach_without_a_distance_estimate_looks_the_same_whatever_stands_ahead():
    envs = gym.make_vec(ID, num_envs=300, scenario="hard")
    rng, history, touched = np.random.default_rng(0), [envs.reset(seed=0)[0]], np.full(300, np.nan)
    while np.isnan(touched).any():
        action = (0.4 * rng.uniform(-1.0, 1.0, 2) + [0.4, 0.0]).astype(np.float32)
        observations, _, ended, _, infos = envs.step(np.tile(action, (300, 1)))
        touched = np.where(ended & np.isnan(touched), infos.get("approach_time", np.nan), touched)
        history.append(observations)
    differ, ticks, alike = 0, len(history), np.array(history)[:, np.argmax(touched)]
    for row, seen in enumerate(np.array(history).transpose(1, 0, 2)):
        first = min(int(np.ceil(touched[row] / 0.016 + 1.0)), ticks - 1)  # that may tell, a delay after the touch
        assert np.array_equal(seen[:first], alike[:first])
        differ += not np.array_equal(seen[first], alike[first])
    assert differ > 100


def test_noise_and_bias_are_normal_and_leave_the_motion_alone():
    assert not at_rest(5, 2000)[..., FORCE].any()
    # readings never fall below zero: half of a normal distribution is seen, the other half as zeros
    noise = newtons(at_rest(30, 2000, force_noise=0.3)[..., FORCE])
    assert np.mean(noise == 0.0) == pytest.approx(0.5, abs=0.01)
    assert stats.kstest(noise[noise > 0.0][::7], stats.halfnorm(scale=0.3).cdf).pvalue > 1e-3
    for lag in (1, 2, 3):  # fresh at each reading, to 5 standard deviations of what independent signs come to
        signs = np.sign(noise - 1e-9)
        assert abs(np.mean(signs[lag:] * signs[:-lag])) < 5.0 / np.sqrt(signs[lag:].size)
    bias = newtons(at_rest(6, 2000, force_bias=0.3)[..., FORCE])
    assert np.ptp(bias, axis=0) == pytest.approx(0.0, abs=1e-6)  # stays for the episode
    assert stats.kstest(bias[3][bias[3] > 0.0], stats.halfnorm(scale=0.3).cdf).pvalue > 1e-3

    plain, noisy = gym.make(ID), gym.make(ID, force_noise=0.5, force_bias=0.5)
    for seed in range(20):
        (clean, _, truth), (seen, _, info) = (play(env, PaperTrapezoid(), seed) for env in (plain, noisy))
        for key in ("object_velocity", "approach_time", "peak_force", "scenario"):
            assert info[key] == truth[key]
        assert np.array_equal(np.delete(seen, [FORCE, PEAK], axis=1), np.delete(clean, [FORCE, PEAK], axis=1))
        error = newtons(seen[:, FORCE]) - newtons(clean[:, FORCE])
        assert np.abs(error).max() > 0.0
        assert (np.diff(seen[:, PEAK]) >= 0.0).all()
        assert (seen[:, PEAK] >= seen[:, FORCE] - 1e-7).all()


def test_sensors_say_in_si_units_what_the_observation_says():
    options = {"range_noise": 0.01, "deflection_sensor": True, "force_bias": 0.1, "reaction_delay": 0.04}
    env, touched = gym.make(ID, **options), 0.0
    spec = env.unwrapped.observation_spec
    actions, observation, ended = iter(action_table(6, 200, 1)[:, 0]), env.reset(seed=4)[0], False
    while not ended:
        sensors = env.unwrapped.sensors()
        known = {"time", "position", "velocity", "alarm", "time_since_alarm", "force", "force_peak"}
        assert {*sensors} == known | {"distance_estimate", "deflection"}
        for name, value in sensors.items():
            assert type(value) is float
            assert observation[spec.index(name)] == pytest.approx(float(spec.encode(name, value)), abs=1e-6)
        touched = max(touched, sensors["force"])
        observation, _, ended, _, _ = env.step(next(actions))
    assert touched > 1.0


@pytest.mark.parametrize("options", [{}, {"alarm": "reading", "force_noise": 1.0}, {"operator": "Trapezoid"}], ids=str)
def test_episode_state_has_the_alarm_that_is_observed_and_the_end_of_the_last_step(options):
    steered = {**ARM, "operator": {"type": options["operator"]}} if "operator" in options else options
    batch = Batch(20, Task(**steered), threads=1)
    batch.begin_seeded(0, {})
    assert len(np.unique(batch.info()["scenario"]["distance"])) == 20
    action, alarms = OWN if steered is not options else encode(0.8, 10.0), 0
    while not batch.ended.all():
        skipped = batch.ended
        batch.step(np.tile(action, (20, 1)), skipped)
        sensors = batch.sensors()
        for row in np.flatnonzero(~skipped):
            state, now = batch.episode_state(row), sensors["time"][row]
            assert state.end == (now if batch.ended[row] else np.inf)
            assert sensors["alarm"][row] == (state.alarm <= now < state.alarm_over - 1e-9)
            if sensors["alarm"][row]:
                assert sensors["time_since_alarm"][row] == now - state.alarm
            if "alarm" not in options:
                assert state.alarm == state.detection + 0.016
            alarms += sensors["alarm"][row]
    assert alarms > 20


@pytest.mark.parametrize("coupling", [ig.Rigid(), ig.SpringDamper(50.0)], ids=str)
def test_bodies_are_where_the_trace_ends(coupling):
    batch = Batch(1, Task(coupling=coupling, robot=ROBOT), threads=1, trace_points=5000)
    batch.begin_seeded(3, {"distance": 0.05})
    for _ in range(12):
        batch.step(encode([0.7], [15.0]), batch.ended)
        trace, bodies = batch.trace(0), batch.bodies()
        names = ("time", "flange_position", "tool_position", "object_position")
        ends = [getattr(trace, name)[-1] for name in names]
        assert np.array(bodies[:4])[:, 0] == pytest.approx(ends, abs=1e-12)
        assert bodies.touched == (trace.contact_force.max() > 0.0)
        if coupling != ig.Rigid():
            assert bodies.deflection == pytest.approx(bodies.tool - bodies.flange, abs=1e-12)
            rate = trace.tool_velocity[-1] - trace.flange_velocity[-1]
            assert bodies.deflection_rate == pytest.approx(rate, abs=1e-12)


GAP, ROWS = 0.3, 3000


def readings(steps, **sensor):
    """Range and age (steps, ROWS) before a flange at rest, each step after the first."""
    batch = Batch(ROWS, Task(scenario={"distance": (GAP, GAP)}, velocity_range=(-0.5, 0.5), range_sensor=sensor))
    batch.begin_seeded(0, {})
    rest, none, seen = np.zeros((ROWS, 2)), np.zeros(ROWS, bool), []
    for _ in range(steps):
        batch.step(rest, none)
        seen.append([batch.sensors()[name] for name in ("range", "range_age")])
    return np.array(seen).transpose(1, 0, 2)


@pytest.mark.parametrize("coupling", [{"type": "Rigid"}, {"type": "SpringDamper", "stiffness": 50.0}])
@pytest.mark.parametrize("delay", [0.0, 0.016, 0.04])
def test_without_errors_the_gap_of_the_trace_is_read_a_delay_late(delay, coupling):
    env = gym.make(ID, range_sensor=RangeSensor(delay=delay), coupling=coupling, record_trace=True).unwrapped
    env.reset(seed=3)
    seen, action, ended = [], Always(0.8, 10.0).predict(np.zeros(10))[0], False
    while not ended:
        seen.append([env.sensors()[name] for name in ("time", "range", "range_age")])
        ended = env.step(action)[2]
    (time, gap, age), trace = np.array(seen).T, env.trace()
    late = -(-np.round(delay / 0.016, 9) // 1) * 0.016  # whole periods
    arrived = time >= late - 1e-9
    assert np.isinf(gap[~arrived]).all()
    assert np.isinf(age[~arrived]).all()
    before = arrived & (time < env.episode_info()["approach_time"])  # then steps are whole periods
    assert age[before] == pytest.approx(late, abs=1e-9)
    true = np.interp(time - age, trace.time, trace.object_position - trace.tool_position)
    assert gap[arrived] == pytest.approx(np.maximum(true[arrived], 0.0), abs=2e-6)
    assert before.sum() > 10


def test_mean_spread_and_dropouts_are_those_asked_for():
    noise, share, bias, dropout = 0.004, 0.02, 0.015, 0.3
    gap, age = readings(20, noise=noise, share=share, bias=bias, dropout=dropout)
    fresh = gap[age == 0.0]
    spread = noise + share * GAP
    assert stats.kstest(fresh[::7], stats.norm(GAP + bias, spread).cdf).pvalue > 1e-3
    assert abs(fresh.mean() - GAP - bias) < 5.0 * spread / np.sqrt(fresh.size)
    assert abs(np.mean(age > 0.0) - dropout) < 5.0 * np.sqrt(dropout * (1.0 - dropout) / age.size)
    for lag in (1, 2):  # neither errors nor losses follow from earlier ones
        signs, lost = np.where(age == 0.0, np.sign(gap - GAP - bias), 0.0), (age > 0.0) - dropout
        assert abs(np.mean(signs[lag:] * signs[:-lag])) < 5.0 / np.sqrt(signs.size)
        assert abs(np.mean(lost[lag:] * lost[:-lag])) < 5.0 * dropout / np.sqrt(lost.size)
    assert not np.any((age > 0.0)[:-1] & (age[1:] < age[:-1]) & (age[1:] > 0.0))  # a new reading is a fresh one


def test_bias_that_is_drawn_stays_for_the_episode_and_is_uniform():
    gap, _ = readings(5, bias=(-0.05, 0.05))
    assert np.ptp(gap, axis=0) == pytest.approx(0.0, abs=1e-12)
    assert stats.kstest(gap[0] - GAP, stats.uniform(-0.05, 0.1).cdf).pvalue > 1e-3
    assert readings(3, noise=1.0)[0].min() == 0.0  # nothing is read below 0


def test_sensor_leaves_motion_and_other_draws_alone():
    sensed, plain = gym.make(ID, range_sensor=RANGE_SENSOR, force_noise=0.3), gym.make(ID, force_noise=0.3)
    for seed in range(40, 45):
        seen, without = (play(env, Always(0.7, 12.0), seed) for env in (sensed, plain))
        assert_identical(seen.observations[:, :8], without.observations)
        assert {name: seen.info["record"][name] for name in without.info["record"]} == without.info["record"]


def test_state_in_which_more_readings_were_delivered_than_taken_is_refused():
    batch = Batch(2, Task(range_sensor=RANGE_SENSOR))
    batch.begin_seeded(0, {})
    state = batch.get_state()
    state["episodes"]["ranges_delivered"] += 1000
    refused(lambda: batch.set_state(state), "sha256 of a state must be")
