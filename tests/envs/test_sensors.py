"""Sensors that err: random delays, noisy and biased forces, the deflection sensor, and the privileged observation."""

import math

import gymnasium as gym
import numpy as np
import pytest
from scipy import stats

import impact_gym as ig
from agents.baselines import PaperTrapezoid
from impact_gym.envs import observation

ID = "ImpactApproach-v0"
TIME, ALARM, FORCE, PEAK = 2, 3, 5, 6
PAPER = PaperTrapezoid().predict(np.zeros(8, np.float32))[0]


def play(env, seed=None, options=None):
    """Play the paper's rule; returns the observations and the final info."""
    observation, _ = env.reset(seed=seed, options=options)
    observations, ended = [observation], False
    while not ended:
        action = PaperTrapezoid().predict(observation[:8])[0]
        observation, _, ended, _, info = env.step(action)
        observations.append(observation)
    return np.array(observations, float), info


def newtons(reading):
    return np.expm1(reading * math.log1p(1000.0))


def stand_still(envs, steps):
    """Force readings of a batch whose tools stay where nothing can be touched."""
    envs.reset(seed=5)
    still = np.tile(np.array([-0.5, 1.0], np.float32), (envs.num_envs, 1))  # 0 m/s
    return np.array([newtons(envs.step(still)[0][:, FORCE].astype(float)) for _ in range(steps)])


def test_a_range_of_delays_is_drawn_uniformly_and_moves_the_alarm():
    env = gym.make(ID, reaction_delay=(0.005, 0.045))
    delays = []
    for seed in range(60):
        observations, info = play(env, seed=seed)
        delay = info["record"]["reaction_delay"]
        delays.append(delay)
        fixed = gym.make(ID, reaction_delay=delay)
        again, fixed_info = play(fixed, seed=seed)
        assert np.array_equal(observations, again)
        assert fixed_info["object_velocity"] == info["object_velocity"]
    assert stats.kstest(delays, stats.uniform(0.005, 0.04).cdf).pvalue > 1e-3
    assert np.corrcoef(delays, [float(seed) for seed in range(60)])[0, 1] ** 2 < 0.2


def test_noise_and_bias_are_normal_and_leave_the_motion_alone():
    quiet = gym.make_vec(ID, num_envs=2000)
    assert not stand_still(quiet, 5).any()
    # readings never fall below zero: half of a normal distribution is seen, the other half as zeros
    noise = stand_still(gym.make_vec(ID, num_envs=2000, force_noise=0.3), 30)
    assert np.mean(noise == 0.0) == pytest.approx(0.5, abs=0.01)
    assert stats.kstest(noise[noise > 0.0][::7], stats.halfnorm(scale=0.3).cdf).pvalue > 1e-3
    assert abs(np.corrcoef(noise[10], noise[11])[0, 1]) < 0.1  # fresh at each reading
    bias = stand_still(gym.make_vec(ID, num_envs=2000, force_bias=0.3), 6)
    assert np.ptp(bias, axis=0) == pytest.approx(0.0, abs=1e-6)  # stays for the episode
    assert stats.kstest(bias[3][bias[3] > 0.0], stats.halfnorm(scale=0.3).cdf).pvalue > 1e-3

    plain, noisy = gym.make(ID), gym.make(ID, force_noise=0.5, force_bias=0.5)
    for seed in range(20):
        clean, truth = play(plain, seed=seed)
        seen, info = play(noisy, seed=seed)
        for key in ("object_velocity", "approach_time", "peak_force", "scenario"):
            assert info[key] == truth[key]
        assert np.array_equal(np.delete(seen, [FORCE, PEAK], axis=1), np.delete(clean, [FORCE, PEAK], axis=1))
        error = newtons(seen[:, FORCE]) - newtons(clean[:, FORCE])
        assert np.abs(error).max() > 0.0
        assert (np.diff(seen[:, PEAK]) >= 0.0).all()
        assert (seen[:, PEAK] >= seen[:, FORCE] - 1e-7).all()


def test_the_alarm_does_not_feel_the_noise():
    envs = gym.make_vec(ID, num_envs=200, force_noise=50.0)
    envs.reset(seed=1)
    still = np.tile(np.array([-0.5, 1.0], np.float32), (200, 1))
    for _ in range(40):
        observations = envs.step(still)[0]
        assert not observations[:, ALARM].any()


@pytest.mark.parametrize("coupling", [ig.SpringDamper(50.0), ig.Bistable()], ids=["spring", "bistable"])
@pytest.mark.parametrize("delay", [0.0, 0.016, 0.04])
def test_the_deflection_is_that_of_one_reaction_delay_ago(coupling, delay):
    env = gym.make(ID, coupling=coupling, deflection_sensor=True, reaction_delay=delay, record_trace=True)
    assert env.observation_space.shape == (9,)
    observations, _ = play(env, seed=3)
    trace = env.unwrapped.trace()
    times = 0.5 * (observations[:, TIME] + 1.0) * 1.5 - delay
    deflection = np.interp(times, trace.time, trace.tool_position - trace.flange_position)
    expected = np.clip(deflection / 0.05, -1.0, 1.0)
    assert observations[:, 8] == pytest.approx(np.where(times < 0.0, 0.0, expected), abs=2e-5)
    assert np.abs(observations[:, 8]).max() > 0.02


def test_the_privileged_observation_is_the_truth_behind_all_else():
    options = {"range_noise": 0.01, "deflection_sensor": True, "reaction_delay": (0.0, 0.05)}
    plain, privileged = gym.make(ID, **options), gym.make(ID, privileged=True, **options)
    assert privileged.observation_space.shape == (15,)
    for seed in range(30):
        actor, _ = play(plain, seed=seed)
        critic, info = play(privileged, seed=seed)
        assert np.array_equal(critic[:, :-5], actor)
        mass, stiffness, restitution, distance, delay = critic[:, -5:].T
        truth = info["scenario"]
        assert 10 ** (1.5 * (mass + 1.0) - 2.0) == pytest.approx(truth["object_mass"], rel=1e-5)
        assert 10 ** (2.5 * (stiffness + 1.0) + 3.0) == pytest.approx(truth["contact_stiffness"], rel=1e-5)
        assert restitution == pytest.approx(truth["restitution"], abs=1e-7)
        assert 0.1 * delay == pytest.approx(info["record"]["reaction_delay"], abs=1e-7)
        flange = -0.25 + 0.5 * (critic[:, 0] + 1.0)
        assert 0.5 * distance == pytest.approx(np.clip(truth["distance"] - flange, -0.5, 0.5), abs=1e-6)


def test_the_table_of_the_docstring_is_that_of_the_code():
    text = gym.make(ID).unwrapped.__class__.__doc__
    for argument in ("range_noise", "deflection_sensor", "privileged"):
        assert f"only with `{argument}`" in text
        assert f"| `{argument}`" in text  # among the arguments
    assert text.count("`reaction_delay`, `force_noise`, `force_bias`") == 2
    everything = gym.make(ID, range_noise=0.01, deflection_sensor=True, privileged=True)
    rows = [line for line in text.splitlines() if line.strip().startswith(("| 0 ", "| then"))]
    assert len(rows) == 2 + 7  # the first action, the first observation, and what arguments add
    assert everything.observation_space.shape == (8 + 7,)


@pytest.mark.parametrize(("delay", "period"), [(0.04, 0.016), (0.016, 0.07), (0.04, 0.07)])
def test_readings_keep_their_age_when_the_alarm_comes_at_the_end(delay, period):
    env = gym.make(ID, reaction_delay=delay, control_period=period, deflection_sensor=True, record_trace=True)
    scenario = {"distance": 0.3, "object_mass": 1.0, "contact_stiffness": 1e4, "restitution": 0.5}
    late = 0
    for speed in np.linspace(0.249, 0.262, 14):
        observation, _ = env.reset(seed=0, options={"scenario": scenario})
        seen, ended = [observation], False
        while not ended:
            observation, _, ended, _, _ = env.step(np.array([speed - 0.5, 1.0], np.float32))
            seen.append(observation)
        seen, trace = np.array(seen, float), env.unwrapped.trace()
        late += seen[-1, TIME] > 0.61  # beyond 1.2 s: an alarm was under way then
        times = 0.75 * (seen[:, TIME] + 1.0) - delay
        deflection = np.interp(times, trace.time, trace.tool_position - trace.flange_position)
        expected = np.where(times < 0.0, 0.0, np.clip(deflection / 0.05, -1.0, 1.0))
        assert seen[:, 8] == pytest.approx(expected, abs=2e-5)
    assert late > 3


def test_a_new_episode_knows_nothing_of_the_last():
    options = {"deflection_sensor": True, "force_noise": 0.2, "force_bias": 0.1, "reaction_delay": (0.0, 0.04)}
    used, fresh = gym.make(ID, **options), gym.make(ID, **options)
    for seed in range(4):
        play(used, seed=seed)
        assert np.array_equal(used.reset(seed=99)[0], fresh.reset(seed=99)[0])


def test_the_scales_of_what_arguments_add_are_the_documented_ones():
    rows = {entry.name: (entry.low, entry.high, entry.scaled_low) for entry in observation.OPTIONAL_ENTRIES}
    assert rows["distance estimate minus flange position"] == (-0.5, 0.5, -1.0)
    assert rows["tool minus flange from rest, as sensed a delay ago"] == (-0.05, 0.05, -1.0)
    assert rows["object mass"] == (0.01, 10.0, -1.0)
    assert rows["contact stiffness"] == (1e3, 1e8, -1.0)
    assert rows["restitution"] == (0.0, 1.0, 0.0)
    assert rows["reaction delay"] == (0.0, 0.1, 0.0)
