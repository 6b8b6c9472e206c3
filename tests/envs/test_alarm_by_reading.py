"""`alarm="reading"`: noisy readings raise the alarm, falsely too; nothing but the touch ends an episode.

Without errors, alarms and readings are those of the independent solver: `test_reference_task.py`.
"""

import gymnasium as gym
import numpy as np
import pytest
from episodes import ALARM, FORCE, ID, SINCE, Always, at_rest, newtons, play, random_actions
from scipy import stats

from agents.baselines import BlindProfile
from agents.baselines.detector import DETECTOR, DetectorProfile
from agents.evaluate.scenario_batch import ScenarioBatch
from impact_gym.task import Task

READING = {"alarm": "reading"}


@pytest.mark.parametrize(("threshold", "sigma"), [(1.0, 0.5), (2.0, 1.0), (2.0, 2.0), (4.0, 5.0)])
def test_false_alarm_comes_as_often_as_a_normal_number_exceeds_the_threshold_and_ends_after_its_time(threshold, sigma):
    rows, ticks, last, again = 1500, 40, 9, 0  # of 16 ms: `last` is fewer than an alarm lasts
    seen = at_rest(ticks, rows, force_noise=sigma, alarm_threshold=threshold, **READING)
    share, first = stats.norm.sf(threshold / sigma), seen[:last, :, ALARM].mean(axis=1)
    expected = 1.0 - (1.0 - share) ** np.arange(1, last + 1)
    assert (np.abs(first - expected) < 4.0 * np.sqrt(expected * (1.0 - expected) / rows)).all()
    on, readings, since = seen[:, :, ALARM] > 0.5, newtons(seen[:, :, FORCE]), 0.15 * seen[:, :, SINCE]
    raised, over = np.full(rows, np.inf), np.zeros(rows, bool)
    for tick in range(ticks):
        ends = 0.016 * (tick - raised) > 0.15 - 1e-9
        raised[ends], over = np.inf, over | ends
        begins = np.isinf(raised) & (readings[tick] > threshold)
        raised[begins], again = tick, again + np.sum(begins & over)
        assert np.array_equal(on[tick], np.isfinite(raised))
        assert since[tick, on[tick]] == pytest.approx(0.016 * (tick - raised[on[tick]]), abs=1e-6)
    assert again > 100


def test_alarm_that_is_false_ends_nothing():
    """Who goes on whatever comes meets what it would have met without a sensor."""
    quiet, noisy = (
        ScenarioBatch(4, 100, Task(force_noise=noise, **READING)).play(Always(0.7, 20.0)) for noise in (0.0, 5.0)
    )
    assert quiet.object_velocity == pytest.approx(noisy.object_velocity, rel=1e-7, abs=1e-9)
    assert quiet.approach_time == pytest.approx(noisy.approach_time, rel=1e-7, abs=1e-9)


@pytest.mark.parametrize("deflection", [False, True])
def test_past_readings_are_those_that_were_shown_then(deflection):
    env = gym.make(ID, past_readings=3, deflection_sensor=deflection, force_noise=2.0, **READING)
    read = [FORCE, 8] if deflection else [FORCE]
    first = 8 + deflection
    assert env.observation_space.shape == (first + 3 * len(read),)
    differ = 0
    for seed in range(10):
        seen = play(env, random_actions(seed), seed).observations[:-1]  # the last step is a short one
        for before in (1, 2, 3):
            for place, sensor in enumerate(read):
                column = first + (before - 1) * len(read) + place
                assert np.array_equal(seen[before:, column], seen[:-before, sensor])
                differ += not np.array_equal(seen[:, column], seen[:, sensor])
    assert differ == 10 * 3 * len(read)


def detector(*numbers, **environment):
    """A profile with these numbers of the detector."""
    own = dict(zip((each.name for each in DETECTOR), numbers, strict=True))
    rule = DetectorProfile([own.get(each.name, each.start) for each in DetectorProfile.PARAMETERS])
    return rule.for_task(Task(**{**DetectorProfile.NEEDS, **environment}))


def test_detector_sees_a_small_rise_as_soon_as_pages_rule_does():
    rule, rng = detector(0.5, 0.0, 5.0, 0.0, 0.0, 0.0, force_noise=1.0), np.random.default_rng(0)
    before, rows = 200, 1000
    seen, state, first = np.zeros((rows, len(rule.spec)), np.float32), None, np.full(rows, np.inf)
    for step in range(before + 60):  # from then on 1 N more, one standard deviation
        seen[:, rule.spec.index("force")] = rule.spec.encode("force", 20.0 + rng.normal(size=rows) + (step >= before))
        seen[:, rule.spec.index("time")] = rule.spec.encode("time", np.full(rows, 1e-3 * step))
        _, state = rule.predict(seen, state, np.zeros(rows, bool))
        first = np.where(np.isfinite(state[0]), np.minimum(first, step), first)
    assert 0.65 < (first >= before).mean() < 0.9  # one false alarm in 930 readings, exp(-200/930)
    assert (first[first >= before] - before + 1).mean() == pytest.approx(10.4, rel=0.1)
    # D. C. Montgomery, Introduction to Statistical Quality Control, table 9.3: k = 1/2, h = 5


def test_detector_takes_a_kick_of_the_tool_for_a_touch_and_its_own_swing_for_none():
    rule, steps = detector(0.0, 0.0, 1.0, 0.0, 1000.0, 0.8), np.arange(20)
    swing = (0.01 + 0.02 * steps) * 0.8**steps  # a critically damped tool, left to itself
    for kick, touched in ((0.0, False), (-0.005, True)):  # m
        state, seen = None, np.zeros((1, len(rule.spec)), np.float32)
        for step in range(2, 20):
            for name, back in (("deflection", 0), ("deflection_1", 1), ("deflection_2", 2)):
                value = swing[step - back] + kick * (step - back >= 10)
                seen[:, rule.spec.index(name)] = rule.spec.encode(name, np.array([value]))
            _, state = rule.predict(seen, state, np.zeros(1, bool))
        assert np.isfinite(state[0]).all() == touched


def test_detector_is_right_where_the_alarm_is_and_goes_on_after_what_was_no_touch():
    """It takes for a touch what exceeds the mean so far by a threshold, N, in a single reading."""

    def played(threshold, **environment):
        environment |= {"alarm": "reading", "deflection_sensor": True, "past_readings": 2}
        trusting = BlindProfile([parameter.start for parameter in BlindProfile.PARAMETERS])
        judging = detector(threshold - 0.01, 0.0, 0.01, 0.0, 0.0, 0.0) if threshold else trusting
        stage = ScenarioBatch.of("validation", 200, Task(**environment))
        return stage.play(judging.for_task(Task(**{**DetectorProfile.NEEDS, **environment})))

    trusting, judging, deaf = (
        played(threshold, alarm_threshold=3.0).object_velocity for threshold in (None, 3.0, 20.0)
    )
    assert np.mean(trusting == judging) > 0.98  # what came below 3 N is in the mean
    assert (deaf > 1.1 * trusting).mean() > 0.3
    missed = [played(threshold, force_noise=3.0).missed.sum() for threshold in (None, 1.0, 8.0, 20.0)]
    assert min(missed[:2]) > 100  # within the noise
    assert missed[2:] == [0, 0]


def test_memory_of_a_detector_ends_with_the_episode():
    rule = detector(0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    quiet, hit = (np.zeros((2, len(rule.spec)), np.float32) for _ in range(2))
    for place in range(2):
        hit[place, rule.spec.index("force")] = 1.0  # 1 kN
    _, state = rule.predict(quiet)
    _, state = rule.predict(hit, state)
    assert np.isfinite(state[0]).all()
    _, state = rule.predict(quiet, state, np.array([True, False]))
    assert np.isfinite(state[0]).tolist() == [False, True]
    assert np.isfinite(rule.predict(quiet, state)[1][0]).tolist() == [False, True]
