"""The environment plays the physics of `simulate`, and of a slow solver of the whole task; its books balance."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from impact_gym.kernels import decode
from scipy import stats

import impact_gym as ig
from agents.baselines import ConstantSpeed, PaperTrapezoid, encode
from experiments.reference import task as slow
from impact_gym.envs.scenario import FIELDS
from impact_gym.envs.task import ACCELERATION_RANGE, COMMAND_RESOLUTION, VELOCITY_RANGE

INFO_KEYS = {
    "object_velocity", "approach_time", "peak_force", "contact_count", "missed", "time_weight", "reward_terms",
    "scenario", "record", "status",
}  # fmt: skip
STAND_STILL = encode(0.0, 20.0)
ENDS = [-0.25, -0.5, 0.0], [0.75, 1.5, 1.5]  # of flange position, flange velocity and time, as documented


class Always:
    """Plays one action for ever."""

    def __init__(self, action):
        self.action = action

    def predict(self, observation):
        return self.action, None


class Again:
    """Plays actions once more to the slow solver; remembers what it saw."""

    def __init__(self, actions):
        self.actions, self.seen = iter(actions), []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.seen.append(observation[0])
        return np.array([next(self.actions)]), state


class Random:
    """Plays whatever; remembers it."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.actions = []

    def predict(self, observation):
        self.actions.append(self.rng.uniform(-1.0, 1.0, 2).astype(np.float32))
        return self.actions[-1], None


def play(env, controller, seed=None, scenario=None):
    """Play one episode; returns observations, rewards and the final info."""
    observation, _ = env.reset(seed=seed, options={"scenario": scenario} if scenario else None)
    observations, rewards = [observation], []
    while True:
        observation, reward, terminated, truncated, info = env.step(controller.predict(observation)[0])
        observations.append(observation)
        rewards.append(reward)
        if terminated or truncated:
            return np.array(observations), np.array(rewards), info
        assert info == {}


def play_batch(envs, controller, seed=None):
    """Play until every first episode has ended; returns observations (t, n, k), which rows were alive, final infos."""
    observation, _ = envs.reset(seed=seed)
    observations, alive = [observation], [np.ones(envs.num_envs, bool)]
    finals = {}
    while alive[-1].any():
        observation, _, terminated, truncated, infos = envs.step(
            np.broadcast_to(controller.predict(observation)[0], (envs.num_envs, 2))
        )
        observations.append(observation)
        for row in np.flatnonzero((terminated | truncated) & alive[-1]):
            finals[int(row)] = {name: value[row] for name, value in infos.items() if not isinstance(value, dict)}
            finals[int(row)]["scenario"] = {name: infos["scenario"][name][row] for name in FIELDS}
        alive.append(alive[-1] & ~(terminated | truncated))
    return np.array(observations), np.array(alive), [finals[row] for row in range(envs.num_envs)]


def physical(observations):
    """Flange position (m), flange velocity (m/s) and time (s), from the documented scaling."""
    low, high = map(np.array, ENDS)
    return low + 0.5 * (np.asarray(observations, float)[..., :3] + 1.0) * (high - low)


def scene(scenario, coupling):
    return ig.Scene(
        tool=ig.Tool(0.125),
        object=ig.Object(scenario["object_mass"], scenario["distance"]),
        contact=ig.Contact(scenario["contact_stiffness"], scenario["restitution"]),
        coupling=coupling,
    )


def assert_same_outcome(info, outcome, flight_error=1e-12):
    assert info["status"] == "ok"
    assert info["contact_count"] == len(outcome.contacts)
    assert info["object_velocity"] == pytest.approx(outcome.object_velocity, rel=0, abs=1e-9)
    assert info["approach_time"] == pytest.approx(outcome.contacts[0].start, rel=0, abs=flight_error)
    assert info["peak_force"] == pytest.approx(outcome.peak_force, rel=1e-8)


@pytest.mark.parametrize(
    "coupling",
    [ig.SpringDamper(50.0, 1.0), ig.SpringDamper(150.0, 0.2), ig.Rigid(), ig.Bistable()],
    ids=lambda coupling: repr(coupling)[:30],
)
@pytest.mark.parametrize(("period", "delay"), [
    (0.016, 0.016), (0.004, 0.016), (0.008, 0.016), (0.011, 0.016), (0.016, 0.0), (0.016, 0.005), (0.016, 0.040),
    (0.011, 0.040),
])  # fmt: skip
def test_the_papers_rule_played_in_the_environment_equals_simulate(coupling, period, delay):
    # a bistable tool's flight has no closed form, and near the alignment it multiplies errors
    rtol, flight_error = (1e-11, 1e-11) if isinstance(coupling, ig.Bistable) else (1e-8, 1e-12)
    envs = gym.make_vec(
        "ImpactApproach-v0", num_envs=200, coupling=coupling, control_period=period, reaction_delay=delay, rtol=rtol
    )
    motion = ig.Trapezoid(1.0, 8.0, ig.Brake(delay=delay))
    for info in play_batch(envs, PaperTrapezoid(), seed=31)[2]:
        outcome = ig.simulate(scene(info["scenario"], coupling), motion, duration=3.0, rtol=rtol)
        assert_same_outcome(info, outcome, flight_error)


@pytest.mark.parametrize("options", [{"alarm_threshold": 5.0}, {"alarm_threshold": 0.2}, {"dissipation": "exact"}])
def test_the_threshold_and_the_dissipation_are_those_of_simulate(options):
    threshold, law = options.get("alarm_threshold", 1.0), options.get("dissipation", "hu-guo")
    motion = ig.Trapezoid(1.0, 8.0, ig.Brake(threshold=threshold, delay=0.016))
    for info in play_batch(gym.make_vec("ImpactApproach-v0", num_envs=100, **options), PaperTrapezoid(), seed=32)[2]:
        one = scene(info["scenario"], ig.SpringDamper(50.0, 1.0))
        one = replace(one, contact=replace(one.contact, dissipation=law))
        assert_same_outcome(info, ig.simulate(one, motion, duration=3.0))


@pytest.mark.parametrize(
    ("speed", "acceleration", "deceleration"), [(0.14, 1.0, 1.0), (0.4, 20.0, 3.0), (1.1, 3.7, 7.9), (1.5, 20.0, 20.0)]
)
def test_a_constant_speed_that_stops_within_the_episode_equals_simulate(speed, acceleration, deceleration):
    assert speed / deceleration < 0.15
    envs = gym.make_vec("ImpactApproach-v0", num_envs=100, scenario={"distance": (0.05, 0.14)})
    motion = ig.Trapezoid(speed, acceleration, ig.Brake(deceleration=deceleration))
    finals = play_batch(envs, ConstantSpeed(speed, acceleration, deceleration), seed=7)[2]
    assert sum(info["peak_force"] > 1.0 for info in finals) > 50
    for info in finals:
        if info["peak_force"] > 1.0:  # the alarm ended it; otherwise `simulate` pushes on for ever
            spring = ig.SpringDamper(50.0, 1.0)
            assert_same_outcome(info, ig.simulate(scene(info["scenario"], spring), motion, duration=3.0))


def test_the_hard_scenarios_equal_simulate_too():
    envs = gym.make_vec("ImpactApproach-v0", num_envs=200, scenario="hard")
    motion = ig.Trapezoid(1.0, 8.0, ig.Brake())
    for info in play_batch(envs, PaperTrapezoid(), seed=5)[2]:
        assert_same_outcome(info, ig.simulate(scene(info["scenario"], ig.SpringDamper(50.0)), motion, duration=3.0))


@pytest.mark.storm
@pytest.mark.parametrize(("period", "delay"), [(0.016, 0.016), (0.011, 0.0), (0.016, 0.040)])
@pytest.mark.parametrize("seed", range(12))
def test_random_actions_give_what_a_slow_independent_solver_of_the_whole_task_gives(seed, period, delay):
    env = gym.make("ImpactApproach-v0", control_period=period, reaction_delay=delay)
    controller = Random(seed)
    observations, _, info = play(env, controller, seed=seed)
    again = Again(controller.actions)
    options = {"control_period": period, "reaction_delay": delay}
    outcome = slow.play(again, info["scenario"], options=options, time_weight=2.0)
    assert all(observation in env.observation_space for observation in observations)
    assert len(again.seen) == len(controller.actions)
    assert observations[:-1] == pytest.approx(np.array(again.seen), rel=0, abs=1.3e-7)  # bits of a float32
    assert info["approach_time"] == pytest.approx(outcome.approach_time, rel=0, abs=1e-9)
    assert info["contact_count"] == outcome.contact_count
    assert info["object_velocity"] == pytest.approx(outcome.object_velocity, rel=0, abs=1e-8)


@pytest.mark.parametrize("options", [
    {}, {"time_weight": (0.5, 8.0), "force_weight": 0.003}, {"coupling": ig.Rigid(), "control_period": 0.011},
    {"scenario": "hard", "reaction_delay": 0.04},
], ids=str)  # fmt: skip
def test_the_return_is_minus_the_weighed_time_velocity_and_force(options):
    env = gym.make("ImpactApproach-v0", **options)
    weights = set()
    for seed in range(40):
        _, rewards, info = play(env, Random(seed), seed=seed)
        terms = info["reward_terms"]
        weight = info["time_weight"]
        weights.add(weight)
        assert set(info) == INFO_KEYS
        assert set(terms) == {"time", "velocity", "force", "missed"}
        assert set(info["scenario"]) == set(FIELDS)
        assert info["object_velocity"] >= 0.0
        assert info["missed"] == (info["contact_count"] == 0)
        velocity = 2.0 if info["missed"] else info["object_velocity"]
        force = 0.0 if info["missed"] else options.get("force_weight", 0.0) * info["peak_force"]
        cost = weight * info["approach_time"] + velocity + force
        assert rewards.sum() == pytest.approx(-cost, rel=0, abs=1e-12 * max(1.0, cost))
        assert sum(terms.values()) == pytest.approx(-cost, rel=0, abs=1e-12 * max(1.0, cost))
        assert terms["time"] == pytest.approx(-weight * info["approach_time"], rel=1e-12)
        assert np.all(rewards[:-1] <= 0.0)
    assert len(weights) == 40 if "time_weight" in options else weights == {2.0}


@pytest.mark.parametrize("action", [STAND_STILL, encode(-0.5, 1.0)], ids=["stand still", "go back"])
@pytest.mark.parametrize(("period", "steps"), [(0.016, 75), (0.008, 150), (0.011, 110)])
def test_an_object_never_reached_is_missed_at_twelve_tenths_of_a_second(action, period, steps):
    env = gym.make("ImpactApproach-v0", control_period=period)
    observations, rewards, info = play(env, Always(action), seed=1)
    assert info["missed"] is True
    assert (info["approach_time"], info["contact_count"], info["peak_force"]) == (1.2, 0, 0.0)
    assert len(rewards) == steps
    assert physical(observations)[-1, 2] == pytest.approx(1.2, rel=0, abs=1e-7)
    assert rewards.sum() == pytest.approx(-(2.0 * 1.2 + 2.0), rel=0, abs=1e-12)
    assert info["reward_terms"]["missed"] == -2.0


def test_a_touch_too_soft_for_the_alarm_is_a_contact_that_runs_to_the_end():
    env = gym.make("ImpactApproach-v0")
    crawl = Always(encode(0.05, 1.0))
    soft = {"object_mass": 0.1, "contact_stiffness": 1e3, "restitution": 0.5, "distance": 0.02}
    observations, rewards, info = play(env, crawl, seed=0, scenario=soft)
    assert info["scenario"] == soft
    assert not observations[:, 3].any()
    assert 0.0 < info["peak_force"] < 1.0
    assert info["missed"] is False
    assert info["contact_count"] >= 1
    assert len(rewards) == 75
    assert info["approach_time"] < 0.6
    assert rewards.sum() == pytest.approx(-(2.0 * info["approach_time"] + info["object_velocity"]), rel=0, abs=1e-12)
    outcome = slow.play(Again([crawl.action] * 75), soft, options={}, time_weight=2.0)
    assert info["contact_count"] == outcome.contact_count
    assert info["object_velocity"] == pytest.approx(outcome.object_velocity, rel=0, abs=1e-8)


@pytest.mark.parametrize(("period", "delay"), [(0.016, 0.016), (0.011, 0.04), (0.004, 0.0), (0.15, 0.016)])
def test_an_episode_ends_a_fixed_time_after_the_alarm(period, delay):
    env = gym.make("ImpactApproach-v0", control_period=period, reaction_delay=delay)
    for seed in range(20):
        observations, _, info = play(env, PaperTrapezoid(), seed=seed)
        motion = ig.Trapezoid(1.0, 8.0, ig.Brake(delay=delay))
        alarm = ig.simulate(scene(info["scenario"], ig.SpringDamper(50.0)), motion).detection_time + delay
        rung = np.flatnonzero(observations[:, 3])
        time = physical(observations)[:, 2]
        assert time[rung[0]] == pytest.approx(alarm, rel=0, abs=2e-7)
        assert time[-1] == pytest.approx(alarm + 0.15, rel=0, abs=2e-7)
        assert list(rung) == list(range(rung[0], len(observations)))
        assert 0.15 * observations[rung, 4] == pytest.approx(time[rung] - alarm, rel=0, abs=4e-7)
        assert not observations[: rung[0], 4].any()


def test_what_the_flange_does_to_the_object_after_the_end_still_counts():
    """Pressed on at full speed, the object gains more while the flange brakes: ending early gains nothing."""
    env = gym.make("ImpactApproach-v0", record_trace=True)
    heavy = {"object_mass": 2.5, "contact_stiffness": 1e5, "restitution": 0.5, "distance": 0.2}
    press_on = Always(encode(1.5, 20.0))
    observations, rewards, info = play(env, press_on, scenario=heavy)
    outcome = slow.play(Again([press_on.action] * len(rewards)), heavy, options={}, time_weight=2.0)
    assert info["object_velocity"] == pytest.approx(outcome.object_velocity, rel=0, abs=1e-8)
    trace = env.unwrapped.trace()
    velocity_at_end = np.interp(physical(observations)[-1, 2], trace.time, trace.object_velocity)
    assert outcome.object_velocity > velocity_at_end + 0.1


def test_the_first_uniform_numbers_of_the_generator_are_the_scenario():
    """As documented: eleven uniform numbers an episode, whatever the options, so that episodes can be jumped to."""
    low, high = np.array([(0.1, 2.5), (1e3, 1e6), (0.1, 1.0), (0.15, 0.35), (0.5, 8.0)]).T
    for options in ({}, {"range_noise": 0.01, "force_noise": 0.1, "force_bias": 0.1, "reaction_delay": (0.0, 0.05)}):
        env = gym.make("ImpactApproach-v0", time_weight=(0.5, 8.0), **options)
        generator = gym.utils.seeding.np_random(12)[0]
        for episode in range(3):
            _, _, info = play(env, PaperTrapezoid(), seed=None if episode else 12)
            uniform = generator.random(11)[:5]
            expected = np.where([1, 1, 0, 0, 1], low * (high / low) ** uniform, low + (high - low) * uniform)
            drawn = [*(info["scenario"][name] for name in FIELDS), info["time_weight"]]
            assert drawn == pytest.approx(expected, rel=1e-13)


def test_scenarios_fill_their_ranges_as_documented():
    envs = gym.make_vec("ImpactApproach-v0", num_envs=5000, time_weight=(0.5, 8.0))
    finals = play_batch(envs, PaperTrapezoid(), seed=2024)[2]
    ranges = {"object_mass": (0.1, 2.5), "contact_stiffness": (1e3, 1e6), "restitution": (0.1, 1.0)}
    ranges |= {"distance": (0.15, 0.35), "time_weight": (0.5, 8.0)}
    drawn = {name: np.array([info["scenario"][name] for info in finals]) for name in FIELDS}
    drawn["time_weight"] = np.array([info["time_weight"] for info in finals])
    for name, (low, high) in ranges.items():
        law = stats.uniform(low, high - low) if name in ("restitution", "distance") else stats.loguniform(low, high)
        assert low <= drawn[name].min() <= drawn[name].max() <= high
        assert stats.kstest(drawn[name], law.cdf).pvalue > 1e-3, name
    correlation = stats.spearmanr(np.array(list(drawn.values())).T).statistic
    assert np.abs(correlation - np.eye(5)).max() < 4.5 / math.sqrt(5000)


def test_options_fix_a_scenario_for_one_episode_only():
    env, free = gym.make("ImpactApproach-v0"), gym.make("ImpactApproach-v0")
    fixed = {"object_mass": 0.7, "distance": 0.21}
    drawn = play(free, PaperTrapezoid(), seed=4)[2]["scenario"]
    assert play(env, PaperTrapezoid(), seed=4, scenario=fixed)[2]["scenario"] == drawn | fixed
    later, _, info = play(env, PaperTrapezoid())
    expected, _, free_info = play(free, PaperTrapezoid())
    assert info == free_info
    assert np.array_equal(later, expected)


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_other_ranges_hold_from_the_next_episode_on(make):
    env = make("ImpactApproach-v0", scenario={"distance": 0.2})
    env.reset(seed=0)
    env.unwrapped.set_scenario({"distance": 0.3, "object_mass": (1.0, 1.1)})
    found = []
    batched = make is gym.make_vec
    action = encode(1.0, 8.0)
    while len(found) < 4:
        _, _, terminated, _, info = env.step(action[None] if batched else action)
        if np.all(terminated):
            found.append({name: float(np.squeeze(info["scenario"][name])) for name in FIELDS})
            if not batched:
                env.reset()
    assert [scenario["distance"] for scenario in found] == [0.2, 0.3, 0.3, 0.3]
    assert all(1.0 <= scenario["object_mass"] <= 1.1 for scenario in found[1:])


def test_the_named_sets_are_the_documented_ones():
    envs = {name: gym.make_vec("ImpactApproach-v0", num_envs=2000, scenario=name) for name in ("train", "test", "hard")}
    drawn = {}
    for name, batch in envs.items():
        finals = play_batch(batch, PaperTrapezoid(), seed=9)[2]
        drawn[name] = np.array([[info["scenario"][field] for field in FIELDS] for info in finals])
    low, high = [0.1, 1e3, 0.1, 0.15], [2.5, 1e6, 1.0, 0.35]
    assert np.array_equal(drawn["train"], drawn["test"])
    outside = (drawn["hard"] < low) | (drawn["hard"] > high)
    assert outside.all()


def test_float32_actions_command_the_papers_rule_exactly_and_every_round_number_to_rounding():
    def commanded(action):
        ranges = zip(action.astype(float), (VELOCITY_RANGE, ACCELERATION_RANGE), strict=True)
        return tuple(decode(share, *limits, COMMAND_RESOLUTION) for share, limits in ranges)

    assert encode(1.0, 8.0).dtype == np.float32
    assert commanded(encode(1.0, 8.0)) == (1.0, 8.0)
    assert commanded(encode(0.0, 8.0)) == (0.0, 8.0)
    for velocity in np.arange(-50, 151) / 100:
        for acceleration in (1.0, 8.0 + velocity, 20.0):
            found = commanded(encode(velocity, acceleration))
            assert found == pytest.approx((velocity, acceleration), rel=1e-15, abs=1e-300)


def test_an_action_means_the_same_as_float32_float64_or_list():
    histories = []
    for kind in (lambda action: action, lambda action: action.astype(float), lambda action: action.tolist()):
        env = gym.make("ImpactApproach-v0")
        env.reset(seed=8)
        controller = Random(3)
        history = []
        while not (history and history[-1][2]):
            history.append(env.step(kind(controller.predict(None)[0])))
        histories.append(history)
    for history in histories[1:]:
        assert len(history) == len(histories[0])
        for (observation, *rest), (expected, *expected_rest) in zip(history, histories[0], strict=True):
            assert np.array_equal(observation, expected)
            assert rest == expected_rest
