"""What the controller sees: readings of a delay ago, the clock, the estimate, and sensors that err.

Delayed forces are compared with `simulate` cut off then, deflections with the trace.
"""

import math

import episodes
import gymnasium as gym
import numpy as np
import pytest
from episodes import ALARM, FORCE, ID, PEAK, SINCE, Always, action_table, metres, newtons, play, seconds
from scipy import stats

import impact_gym as ig
from agents.baselines import PaperTrapezoid

DELAYS = [0.0, 0.005, 0.016, 0.040]
STILL, RANGE = Always(0.0, 20.0), 8  # where the estimate stands, as the documentation says


def paper(env, seed=None, **scenario):
    """Play the paper's rule; returns the observations as float64 and the final info."""
    observations, _, info = play(env, PaperTrapezoid(), seed, scenario=scenario)
    return observations.astype(float), info


def truth(scenario, delay):
    """Return a function of the duration that runs the paper's rule, and when the force passes 1 N."""
    struck, motion = episodes.scene(scenario), ig.Trapezoid(1.0, 8.0, ig.Brake(delay=delay))
    detection_time = ig.simulate(struck, motion).detection_time
    return lambda time: ig.simulate(struck, motion, duration=time, trace=True), detection_time


def clock(detection, delay, period):
    """Times of the observations: every period, but for the alarm, and the end 0.15 s after it."""
    alarm = detection + delay
    before = np.arange(math.ceil(alarm / period)) * period
    after = np.arange(math.ceil(0.15 / period)) * period + alarm
    return before, np.append(after, alarm + 0.15)


@pytest.mark.parametrize("period", [0.008, 0.011, 0.016])
@pytest.mark.parametrize("delay", DELAYS)
def test_forces_seen_are_those_of_one_reaction_delay_ago(delay, period):
    """A reading is compared with the last force, and the largest, of a run that is cut off one delay earlier."""
    env = gym.make(ID, reaction_delay=delay, control_period=period)
    met = 0
    for seed in range(12):
        stiffness = [1e3, 1e3, 1e4, 1e6][seed % 4]  # the softest last long enough to be met in the middle
        observations, info = paper(env, seed, contact_stiffness=stiffness, object_mass=0.3 * (1 + seed))
        run, detection = truth(info["scenario"], delay)
        before, after = clock(detection, delay, period)
        then = np.concatenate([before, after]) - delay
        assert len(observations) == len(then)
        for time, observation in zip(then, observations, strict=True):
            force = peak = 0.0
            if time > info["approach_time"]:
                outcome = run(time)
                force, peak = outcome.trace.contact_force[-1], outcome.peak_force
            met += 0.0 < force < peak
            assert newtons(observation[[FORCE, PEAK]]) == pytest.approx([force, peak], rel=2e-6, abs=2e-6)
        rung = observations[len(before)]
        assert rung[ALARM] == 1.0
        assert newtons(rung[[FORCE, PEAK]]) == pytest.approx([1.0, 1.0], rel=0, abs=2e-6)
        assert newtons(observations[-1, PEAK]) == pytest.approx(info["peak_force"], rel=2e-6)
    assert met > 10


@pytest.mark.parametrize("period", [0.004, 0.011, 0.016, 0.05, 0.15])
@pytest.mark.parametrize("delay", DELAYS)
def test_clock_skips_once_when_the_alarm_comes_and_ends_a_fixed_time_after_it(delay, period):
    env = gym.make(ID, reaction_delay=delay, control_period=period)
    for seed in range(20):
        observations, info = paper(env, seed)
        before, after = clock(truth(info["scenario"], delay)[1], delay, period)
        assert not observations[: len(before), SINCE].any()
        assert 0.15 * observations[len(before) :, SINCE] == pytest.approx(after - after[0], rel=0, abs=4e-7)
        assert seconds(observations) == pytest.approx(np.concatenate([before, after]), rel=0, abs=2e-7)
        assert observations[:, ALARM].tolist() == [0.0] * len(before) + [1.0] * len(after)


def test_step_before_the_last_is_short_at_the_alarm_only_whatever_the_policy_does():
    env = gym.make(ID)
    for seed in range(30):
        observations = play(env, episodes.random_actions(seed), seed).observations
        steps = np.diff(seconds(observations))
        assert np.all(steps < 0.016 + 2e-7)
        short = np.flatnonzero(steps[:-1] < 0.016 - 2e-7)
        rung = np.flatnonzero(observations[:, ALARM])
        assert short.tolist() == ([rung[0] - 1] if len(rung) else [])


def test_approach_without_a_distance_estimate_looks_the_same_whatever_stands_ahead():
    envs = gym.make_vec(ID, num_envs=300, scenario="hard", autoreset_mode="SameStep")
    rng = np.random.default_rng(0)
    observations, _ = envs.reset(seed=0)
    history, approach, done = [observations], np.full(300, np.nan), np.zeros(300, bool)
    while not done.all():
        action = (0.4 * rng.uniform(-1.0, 1.0, 2) + [0.4, 0.0]).astype(np.float32)
        observations, _, terminated, _, infos = envs.step(np.tile(action, (300, 1)))
        first = terminated & ~done
        if first.any():
            approach[first] = infos["final_info"]["approach_time"][first]
        done |= terminated
        history.append(observations)
    history = np.array(history)
    last = int(np.argmax(approach))
    differ = 0
    for row in range(300):
        for tick in range(len(history)):
            if tick * 0.016 - 0.016 >= approach[row]:
                differ += not np.array_equal(history[tick, row], history[tick, last])
                break
            assert np.array_equal(history[tick, row], history[tick, last])
    assert differ > 100


@pytest.mark.parametrize("sigma", [0.0, 0.01])
def test_estimate_is_one_number_an_episode_seen_from_the_flange(sigma):
    env = gym.make(ID, range_noise=sigma)
    errors = set()
    for seed in range(10):
        observations, info = paper(env, seed)
        estimate = 0.5 * observations[:, RANGE] + metres(observations)
        assert np.ptp(estimate) < 2e-7
        errors.add(round(estimate[0] - info["scenario"]["distance"], 6))
    assert len(errors) == 10 if sigma else errors == {0.0}


def test_position_and_velocity_follow_the_ramp_asked_for():
    seen = play(gym.make(ID), Always(0.6, 5.0), scenario={"distance": 5.0}).observations[1:40].astype(float)
    time = 0.016 * np.arange(1, 40)
    ramp = np.minimum(time, 0.12)
    assert metres(seen) == pytest.approx(2.5 * ramp**2 + 0.6 * (time - ramp), rel=0, abs=1e-7)
    assert -0.5 + (seen[:, episodes.VELOCITY] + 1.0) == pytest.approx(5.0 * ramp, rel=0, abs=1e-7)


def at_rest(steps, count=2000, **options):
    """Observations (steps, count, n) of a batch whose tools stay where nothing can be touched."""
    envs = gym.make_vec(ID, num_envs=count, **options)
    seen, _ = envs.reset(seed=5)
    return np.array([envs.step(STILL.predict(seen)[0])[0] for _ in range(steps)])


def assert_deflection(seen, trace, delay):
    """What entry 8 shows is the trace of one reaction delay ago."""
    times = seconds(seen) - delay
    deflection = np.interp(times, trace.time, trace.tool_position - trace.flange_position)
    expected = np.where(times < 0.0, 0.0, np.clip(deflection / 0.05, -1.0, 1.0))
    assert seen[:, 8] == pytest.approx(expected, abs=2e-5)


def test_noise_and_bias_are_normal_and_leave_the_motion_alone():
    assert not at_rest(5)[..., FORCE].any()
    # readings never fall below zero: half of a normal distribution is seen, the other half as zeros
    noise = newtons(at_rest(30, force_noise=0.3)[..., FORCE])
    assert np.mean(noise == 0.0) == pytest.approx(0.5, abs=0.01)
    assert stats.kstest(noise[noise > 0.0][::7], stats.halfnorm(scale=0.3).cdf).pvalue > 1e-3
    assert abs(np.corrcoef(noise[10], noise[11])[0, 1]) < 0.1  # fresh at each reading
    bias = newtons(at_rest(6, force_bias=0.3)[..., FORCE])
    assert np.ptp(bias, axis=0) == pytest.approx(0.0, abs=1e-6)  # stays for the episode
    assert stats.kstest(bias[3][bias[3] > 0.0], stats.halfnorm(scale=0.3).cdf).pvalue > 1e-3

    plain, noisy = gym.make(ID), gym.make(ID, force_noise=0.5, force_bias=0.5)
    for seed in range(20):
        clean, truth = paper(plain, seed)
        seen, info = paper(noisy, seed)
        for key in ("object_velocity", "approach_time", "peak_force", "scenario"):
            assert info[key] == truth[key]
        assert np.array_equal(np.delete(seen, [FORCE, PEAK], axis=1), np.delete(clean, [FORCE, PEAK], axis=1))
        error = newtons(seen[:, FORCE]) - newtons(clean[:, FORCE])
        assert np.abs(error).max() > 0.0
        assert (np.diff(seen[:, PEAK]) >= 0.0).all()
        assert (seen[:, PEAK] >= seen[:, FORCE] - 1e-7).all()


@pytest.mark.parametrize("coupling", [ig.SpringDamper(50.0), ig.Bistable()], ids=["spring", "bistable"])
@pytest.mark.parametrize("delay", [0.0, 0.016, 0.04])
def test_deflection_is_that_of_one_reaction_delay_ago(coupling, delay):
    env = gym.make(ID, coupling=coupling, deflection_sensor=True, reaction_delay=delay, record_trace=True)
    assert env.observation_space.shape == (9,)
    observations, _ = paper(env, 3)
    assert_deflection(observations, env.unwrapped.trace(), delay)
    assert np.abs(observations[:, 8]).max() > 0.02


@pytest.mark.parametrize(("delay", "period"), [(0.04, 0.016), (0.016, 0.07), (0.04, 0.07)])
def test_readings_keep_their_age_when_the_alarm_comes_at_the_end(delay, period):
    env = gym.make(ID, reaction_delay=delay, control_period=period, deflection_sensor=True, record_trace=True)
    scenario = {"distance": 0.3, "object_mass": 1.0, "contact_stiffness": 1e4, "restitution": 0.5}
    late = 0
    for speed in np.linspace(0.249, 0.262, 14):
        seen = play(env, Always(speed, 20.0), scenario=scenario).observations.astype(float)
        late += seconds(seen[-1]) > 1.2075  # beyond 1.2 s: an alarm was under way then
        assert_deflection(seen, env.unwrapped.trace(), delay)
    assert late > 3


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
