"""The range sensor: without errors it reads the gap, late as asked; its errors are those that were asked for."""

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, Always, assert_identical, play
from refusals import refused
from scipy import stats

from impact_gym.envs.batch import Batch
from impact_gym.task import Task
from impact_gym.task.range_sensor import RangeSensor

GAP, ROWS = 0.3, 3000
DRAWN = {"noise": (0.0, 0.01), "share": (0.0, 0.1), "bias": (-0.01, 0.01), "dropout": (0.0, 0.5), "delay": (0.0, 0.1)}


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
    env = gym.make(ID, range_sensor={"delay": delay}, coupling=coupling, record_trace=True).unwrapped
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
    sensed, plain = gym.make(ID, range_sensor=DRAWN, force_noise=0.3), gym.make(ID, force_noise=0.3)
    for seed in range(40, 45):
        seen, without = (play(env, Always(0.7, 12.0), seed) for env in (sensed, plain))
        assert_identical(seen.observations[:, :8], without.observations)
        assert {name: seen.info["record"][name] for name in without.info["record"]} == without.info["record"]


def test_state_in_which_more_readings_were_delivered_than_taken_is_refused():
    batch = Batch(2, Task(range_sensor=DRAWN))
    batch.begin_seeded(0, {})
    state = batch.get_state()
    state["episodes"]["ranges_delivered"] += 1000
    refused(lambda: batch.set_state(state), "ranges_delivered", "below ranges_taken")


def test_record_and_mapping_are_the_same_sensor():
    assert Task(range_sensor=RangeSensor(share=0.1)) == Task(range_sensor={"share": 0.1})
