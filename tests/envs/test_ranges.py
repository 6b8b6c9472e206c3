"""Numbers of a set-up given as ranges: what is drawn, and that nothing else changes."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from drawn_setups import MECHANISM, ROBOT, SENSED, SETUPS, SPRING, TOOL
from episodes import ID, Given, action_table, assert_identical, begin, play, scene
from scipy.optimize import brentq
from scipy.stats import kstest

import impact_gym as ig
from agents.baselines.profile import ConstantDeceleration
from impact_gym.envs.render_history import History
from impact_gym.quantities import QUANTITIES
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task import ObservationSpec, Task

EVERY = pytest.mark.parametrize("options", SETUPS.values(), ids=list(SETUPS))


def leaning(rows, ticks, seed=0):
    return action_table(seed, ticks, rows, lean=(0.0, 0.6))


def episode(env, seed=None, actions_seed=0, **options):
    return play(env, Given(leaning(1, 200, actions_seed)[:, 0]), seed, **options)


def test_each_number_is_drawn_evenly_from_its_range_and_apart_from_all_others():
    options = {"coupling": MECHANISM, "robot": ROBOT, **TOOL, **SENSED, "time_weight": (0.5, 8.0)}
    envs = gym.make_vec(ID, num_envs=3000, **options)
    envs.reset(seed=5)
    task = Task(**options)
    drawn = {name: envs.unwrapped.batch.info()["record"][name] for name in task.drawn}
    assert len(drawn) == 1 + 4 + 7 + 3
    shares = []
    for name, values in drawn.items():
        low, high = task.drawn[name]
        bend = np.log if QUANTITIES[name].by_ratio(low) else np.asarray
        shares.append((bend(values) - bend(low)) / (bend(high) - bend(low)))
        assert kstest(shares[-1], "uniform").pvalue > 1e-4, name
    correlation = np.corrcoef(shares) - np.eye(len(shares))
    assert np.abs(correlation).max() < 5 / math.sqrt(3000)


@EVERY
def test_an_episode_is_that_of_an_environment_with_the_numbers_it_drew_and_can_be_played_again(options):
    env, drawn = gym.make(ID, **options), Task(**options).drawn
    for seed in range(6):
        *seen, info = first = episode(env, seed)
        assert_identical(episode(env, record=info["record"]), first)
        numbers = {name: info["record"][name] for name in drawn}
        assert all(low <= numbers[name] <= high for name, (low, high) in drawn.items())
        fixed = dict(options)
        for name, number in numbers.items():
            top, _, inner = name.partition(".")
            fixed[top] = {**fixed[top], inner: number} if inner else number
        rest = {name: value for name, value in info["record"].items() if name not in numbers}
        *alone, told = episode(gym.make(ID, **fixed), record=rest)
        assert_identical(seen, alone)
        assert_identical(info | {"record": rest}, told)
        task = Task(**options).at(info["record"])
        assert (task.drawn, task.coupling, task.robot) == ({}, Task(**fixed).coupling, Task(**fixed).robot)
        assert task.tool_mass == Task(**fixed).tool_mass


@pytest.mark.parametrize("options", [
    {}, {"range_noise": 0.01, "time_weight": (0.5, 8.0)},
    {"coupling": ig.Bistable(), "force_noise": 0.3, "reaction_delay": (0.0, 0.05), "max_episode_steps": 20},
    *SETUPS.values(),
], ids=["plain", "ranged", "noisy and cut", *SETUPS])  # fmt: skip
def test_a_batch_goes_on_from_a_state_with_what_it_had_drawn(options):
    one, other = (ImpactVecEnv(32, **options) for _ in range(2))
    begin(one, seed=1), begin(other, seed=2)
    one.set_scenario({"distance": (0.1, 0.2)})
    actions, ended = leaning(32, 90, seed=3), 0
    for action in actions[:40]:
        one.step(action)
    state = one.get_state()
    for from_state in ((other,), (one, other)):  # the state itself must not have moved on
        for each in from_state:
            each.set_state(state)
        for action in actions[40:]:
            result = one.step(action)
            assert_identical(result, other.step(action))
            ended += result[2].sum()
    assert ended > 32


def test_pictures_show_what_the_episode_drew():
    env = gym.make(ID, coupling=SPRING, alarm_threshold=(0.2, 5.0), record_trace=True, **TOOL)
    info = episode(env, seed=1).info
    history = History(env.unwrapped.trace(), info, env.unwrapped._batch.task, ended=True)
    assert history.threshold == info["record"]["alarm_threshold"]
    assert history.task.coupling.stiffness == info["record"]["coupling.stiffness"]
    reduced = 1.0 / (1.0 / info["record"]["tool_mass"] + 1.0 / info["record"]["object_mass"])
    assert history.reduced_mass == pytest.approx(reduced, rel=1e-15)


def test_ranges_of_no_width_are_numbers():
    spring = {"type": "SpringDamper", "stiffness": [60.0, 60.0]}
    narrow = Task(tool_mass=(0.2, 0.2), coupling=spring, force_noise=(1, 1))
    assert narrow == Task(tool_mass=0.2, coupling=ig.SpringDamper(60.0), force_noise=1.0)


def records(envs):
    """What was drawn for the episodes of each row, one after the other."""
    told = [[] for _ in range(envs.num_envs)]
    envs.reset(seed=3)
    for action in leaning(envs.num_envs, 150, seed=4):
        infos = envs.step(action)[4]
        for row in np.flatnonzero(infos.get("_record", [])):
            told[row].append({name: column[row] for name, column in infos["record"].items() if name[0] != "_"})
    return told


def test_a_number_that_is_drawn_leaves_everything_else_as_it_is():
    drawn, plain = gym.make_vec(ID, num_envs=8, tool_mass=(0.1, 0.2)), gym.make_vec(ID, num_envs=8)
    both = list(zip(records(drawn), records(plain), strict=True))
    assert min(len(one) for one, _ in both) > 1
    for one, other in both:  # another tool ends its episodes at other times: compare as many as there are
        for with_mass, without in zip(one, other, strict=False):
            assert 0.1 <= with_mass.pop("tool_mass") < 0.2
            assert with_mass == without


def test_privileged_observation_shows_the_true_value_of_what_is_drawn_however_narrow_its_range():
    """The scale is the table's own: a range that is shrunk to a millionth makes no noise of the value."""
    for width in (1.0, 1e-6):
        options = {"coupling": SPRING | {"stiffness": (40.0, 40.0 + width)}, "tool_mass": (0.1, 0.1 + 0.3 * width)}
        env = gym.make(ID, **options, force_bias=(0.0, 0.5), privileged=True)
        spec = env.unwrapped.observation_spec
        assert set(spec.ids[spec.actor.stop :]) >= {"tool_mass", "force_bias", "coupling.stiffness"}
        for seed in range(5):
            observation = env.reset(seed=seed)[0]
            record = env.unwrapped.episode_info()["record"]
            for name in ("tool_mass", "force_bias", "coupling.stiffness", "object_mass", "restitution"):
                assert spec.decode(observation, name) == pytest.approx(record[name], rel=2e-6)
                assert observation[spec.index(name)] == pytest.approx(spec.encode(name, record[name]), abs=1e-6)
            assert env.observation_space.contains(observation)


def test_rows_of_which_some_draw_a_number_all_show_a_critic_what_they_have():
    robot = ig.Robot(5.0, 1e5, 50.0)
    slots = [{}, {"tool_mass": 0.3, "robot": None}, {"tool_mass": 0.05, "robot": robot}]
    envs = gym.make_vec(ID, num_envs=3, tool_mass=(0.1, 0.2), robot=ROBOT, privileged=True, per_slot=slots)
    observations, spec = envs.reset(seed=1)[0], envs.unwrapped.observation_spec
    seen = {name: spec.decode(observations, name) for name in ("tool_mass", "robot.stiffness")}
    assert 0.1 <= seen["tool_mass"][0] < 0.2
    assert seen["tool_mass"][1:] == pytest.approx([0.3, 0.05], rel=2e-6)
    assert seen["robot.stiffness"][1] == pytest.approx(spec.scale("robot.stiffness").high)  # as stiff as can be shown
    assert seen["robot.stiffness"][2] == pytest.approx(1e5, rel=2e-6)


@pytest.mark.parametrize("alarm", ["force", "reading"])
def test_critic_sees_all_that_an_actor_sees_first_and_nothing_twice(alarm):
    options = {"coupling": SPRING, "force_bias": (0.0, 0.5), "alarm": alarm}
    actor, critic = (ObservationSpec(Task(**options, privileged=privileged)) for privileged in (False, True))
    assert critic.ids[critic.actor] == actor.ids
    assert critic.ids[critic.critic] == critic.ids
    assert len(set(critic.ids)) == len(critic)
    assert ("time_since_touch" in critic) is (alarm == "reading")


@pytest.mark.parametrize(("record", "message"), [
    ({"tool_mass": 0.5}, "tool_mass.*at most 0.2 kg.*0.5"),
    ({"tool_mass": math.nan}, "tool_mass.*finite"),
    ({"coupling.stiffness": 50.0}, "no field 'coupling.stiffness'"),
    ({"alarm_threshold": 1.0}, "no field 'alarm_threshold'"),
], ids=str)  # fmt: skip
def test_a_record_fixes_what_is_drawn_within_its_range_and_nothing_else(record, message):
    env = gym.make(ID, tool_mass=(0.1, 0.2))
    with pytest.raises(ValueError, match=message):
        env.reset(seed=1, options={"record": record})


def test_slots_may_be_given_numbers_of_their_own():
    envs = gym.make_vec(ID, num_envs=3, coupling=SPRING)
    stiffness = [40.0, 50.0, 600.0]
    envs.reset(seed=1, options={"record": {"coupling.stiffness": stiffness}})
    assert envs.unwrapped.batch.info()["record"]["coupling.stiffness"].tolist() == stiffness


@pytest.mark.parametrize("stop_stiffness", [1e2, 1e5, 1e9])
def test_a_slider_rests_where_its_front_stop_bears_the_preload(stop_stiffness):
    rng = np.random.default_rng(8)
    for _ in range(200):
        height = rng.uniform(0.005, 0.06)
        mechanism = ig.Bistable(rng.uniform(20.0, 2000.0), rng.uniform(1.05, 2.0) * height, height, 1e-6, -1e-6)
        front = mechanism.stroke * rng.uniform(0.01, 0.99)
        mechanism = replace(mechanism, front_stop=front, stop_stiffness=stop_stiffness)

        def net(x, mechanism=mechanism):
            return mechanism.force(x) - mechanism.stop_stiffness * (x - mechanism.front_stop)

        exact = brentq(net, front, mechanism.stroke, xtol=1e-300, rtol=8.9e-16)
        assert mechanism.rest == pytest.approx(exact, rel=1e-14)


def test_a_slower_arm_maps_its_actions_to_its_own_ranges():
    options = {"velocity_range": (0.0, 1.0), "acceleration_range": (2.0, 8.0), "record_trace": True}
    env = gym.make(ID, **options)
    env.reset(seed=2, options={"scenario": {"distance": 0.35}})
    observation = env.step(np.array([1.0, 1.0], np.float32))[0]
    assert observation[1] == pytest.approx(2.0 * 8.0 * 0.016 - 1.0, abs=1e-6)  # of 0 to 1 m/s
    for action in ([-1.0, -1.0], [0.0, 0.0], [1.0, 1.0]):
        env.step(np.array(action, np.float32))
    trace = env.unwrapped.trace()
    ends = np.interp(0.016 * np.arange(1, 5), trace.time, trace.command_velocity)
    assert ends == pytest.approx(0.016 * np.array([8.0, 6.0, 11.0, 19.0]), rel=1e-9)


SCENARIO = {"object_mass": 0.5, "contact_stiffness": 3e4, "restitution": 0.4, "distance": 0.3}


def test_the_papers_rule_at_the_papers_limits_is_the_corner_of_the_action_space():
    class Corner:
        def predict(self, observation, state=None):
            return np.array([1.0 if observation[3] == 0.0 else -1.0, 1.0], np.float32), state

    env = gym.make(ID, velocity_range=(0.0, 1.0), acceleration_range=(1.0, 8.0))
    info = play(env, Corner(), scenario=SCENARIO).info
    outcome = ig.simulate(scene(SCENARIO), ig.Trapezoid(1.0, 8.0, ig.Brake(1.0, 0.016)), 3.0)
    assert info["object_velocity"] == pytest.approx(outcome.object_velocity, abs=1e-9)
    assert info["approach_time"] == pytest.approx(outcome.contacts[0].start, abs=1e-9)


def test_a_baseline_commands_what_it_means_on_an_arm_of_other_ranges():
    results = []
    for options in ({}, {"velocity_range": (-1.0, 2.0), "acceleration_range": (0.5, 20.0)}):
        rule = ConstantDeceleration([parameter.start for parameter in ConstantDeceleration.PARAMETERS])
        info = play(gym.make(ID, **options), rule.for_environment(options), scenario=SCENARIO).info
        results.append([info["object_velocity"], info["approach_time"], info["peak_force"]])
    assert results[0] == pytest.approx(results[1], rel=1e-4)  # actions and observations are of single precision
