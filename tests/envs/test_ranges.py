"""Numbers of a set-up given as ranges: what is drawn, and that nothing else changes."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from episodes import assert_identical
from scipy.optimize import brentq
from scipy.stats import kstest

import impact_gym as ig
from agents.baselines.profile import ConstantDeceleration
from impact_gym.envs.observation import entries
from impact_gym.envs.render_history import History
from impact_gym.envs.setting import NUMBERS, SETTING_PLACES
from impact_gym.envs.task import Task
from impact_gym.lowering import COUPLING_NUMBERS, ROBOT_NUMBERS
from impact_gym.sb3 import ImpactVecEnv

ID = "ImpactApproach-v0"
SPRING = {"type": "SpringDamper", "stiffness": (40.0, 600.0), "damping_ratio": (0.2, 1.5)}
MECHANISM = {
    "type": "Bistable", "stiffness": (40.0, 80.0), "free_length": (0.07, 0.08), "height": (0.02, 0.03),
    "front_stop": (0.001, 0.02), "rear_stop": (-0.03, -0.01), "stop_stiffness": (1e4, 1e5),
    "stop_damping_ratio": (0.5, 1.0),
}  # fmt: skip
ROBOT = {"type": "Robot", "mass": (3.0, 6.0), "stiffness": (5e4, 2e5), "damping": (0.0, 60.0)}
TABLE = ig.RobotTable([0.05, 0.15, 0.25, 0.35], [5.0, 5.3, 5.5, 5.2], [1.5e5, 1.6e5, 1.4e5, 1.5e5], [50, 55, 60, 50])
SENSED = {
    "alarm_threshold": (0.2, 5.0),
    "range_noise": (0.0, 0.02),
    "force_noise": (0.0, 2.0),
    "force_bias": (0.1, 0.5),
}
SETUPS = {
    "sensors": SENSED,
    "rigid": {"coupling": ig.Rigid(), "tool_mass": (0.05, 0.4)},
    "spring": {"coupling": SPRING, "tool_mass": (0.05, 0.4), **SENSED},
    "mechanism": {"coupling": MECHANISM, "tool_mass": (0.05, 0.4)},
    "one mass": {"coupling": ig.Rigid(), "robot": ROBOT, "tool_mass": (0.05, 0.4)},
    "spring on a robot": {"coupling": SPRING, "robot": ROBOT, "tool_mass": (0.05, 0.4)},
    "mechanism on a robot": {"coupling": MECHANISM, "robot": ROBOT},
    "spring on a table": {"coupling": SPRING, "robot": TABLE, "tool_mass": (0.05, 0.4)},
}
EVERY = pytest.mark.parametrize("options", SETUPS.values(), ids=list(SETUPS))


def finals(envs, actions):
    """Final infos of a vector environment's rows by row, one episode after the other."""
    told = [[] for _ in range(envs.num_envs)]
    for action in actions:
        infos = envs.step(action)[4]
        for row in np.flatnonzero(infos.get("_record", [])):
            told[row].append({name: column[row] for name, column in infos["record"].items() if name[0] != "_"})
    return told


def leaning(rows, ticks, seed=0):
    rng = np.random.default_rng(seed)
    return np.clip(rng.uniform(-1.0, 1.0, (ticks, rows, 2)) + rng.uniform(0.0, 0.6, (rows, 1)), -1, 1).astype(
        np.float32
    )


def episode(env, actions, **reset):
    """Observations, rewards and the final info."""
    seen, ended = [env.reset(**reset)[0]], False
    while not ended:
        observation, reward, ended, _, info = env.step(actions[len(seen) // 2])
        seen += [observation, reward]
    return seen, info


def at_once(nested, prefix=""):
    """A mapping of mappings with dotted names."""
    flat = {}
    for name, value in nested.items():
        flat |= at_once(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return flat


def test_what_may_be_a_range_stands_in_the_order_of_the_kernels():
    assert list(NUMBERS) == list(SETTING_PLACES)
    named = [name.split(".")[1] for name in NUMBERS if "." in name]
    assert named == [*COUPLING_NUMBERS, *ROBOT_NUMBERS]


def test_each_number_is_drawn_evenly_from_its_range_and_apart_from_all_others():
    options = {"coupling": MECHANISM, "robot": ROBOT, "tool_mass": (0.05, 0.4), **SENSED, "time_weight": (0.5, 8.0)}
    envs = gym.make_vec(ID, num_envs=3000, **options)
    envs.reset(seed=5)
    task = Task(**options)
    drawn = {name: envs.unwrapped.batch.info()["record"][name] for name in task.drawn}
    assert len(drawn) == 1 + 4 + 7 + 3
    shares = []
    for name, values in drawn.items():
        low, high = task.drawn[name]
        bend = np.log if NUMBERS[name].logarithmic else np.asarray
        shares.append((bend(values) - bend(low)) / (bend(high) - bend(low)))
        assert kstest(shares[-1], "uniform").pvalue > 1e-4, name
    correlation = np.corrcoef(shares) - np.eye(len(shares))
    assert np.abs(correlation).max() < 5 / math.sqrt(3000)


@EVERY
def test_an_episode_is_that_of_an_environment_with_the_numbers_it_drew(options):
    env, actions = gym.make(ID, **options), leaning(1, 200)[:, 0]
    for seed in range(6):
        seen, info = episode(env, actions, seed=seed)
        drawn = Task(**options).drawn
        numbers = {name: info["record"][name] for name in drawn}
        assert all(low <= numbers[name] <= high for name, (low, high) in drawn.items())
        fixed = dict(options)
        for name, number in numbers.items():
            top, _, inner = name.partition(".")
            fixed[top] = {**fixed[top], inner: number} if inner else number
        rest = {name: value for name, value in info["record"].items() if name not in numbers}
        alone, told = episode(gym.make(ID, **fixed), actions, options={"record": rest})
        assert_identical(seen, alone)
        assert_identical(info | {"record": rest}, told)
        task = Task(**options).at(info["record"])
        assert (task.drawn, task.coupling, task.robot) == ({}, Task(**fixed).coupling, Task(**fixed).robot)
        assert task.tool_mass == Task(**fixed).tool_mass


@EVERY
def test_the_record_plays_an_episode_again(options):
    env, actions = gym.make(ID, **options), leaning(1, 200, seed=1)[:, 0]
    first = episode(env, actions, seed=3)
    env.reset(seed=9)
    assert_identical(first, episode(env, actions, options={"record": first[1]["record"]}))


@EVERY
def test_front_ends_draw_the_same(options):
    rows, actions = 5, leaning(5, 120, seed=2)
    vector = gym.make_vec(ID, num_envs=rows, autoreset_mode="SameStep", **options)
    stable = ImpactVecEnv(rows, **options)
    stable.seed(7)
    assert_identical(vector.reset(seed=7)[0], stable.reset())
    singles = [gym.make(ID, **options) for _ in range(rows)]
    for row, env in enumerate(singles):
        env.reset(seed=7 + row)
    for action in actions:
        seen, rewards, ended, _, infos = vector.step(action)
        stable_seen, _, stable_ended, stable_infos = stable.step(action)
        assert_identical([seen, ended], [stable_seen, stable_ended])
        for row, env in enumerate(singles):
            alone, reward, over, _, info = env.step(action[row])
            assert (reward, over) == (rewards[row], ended[row])
            if over:
                told = at_once({name: value for name, value in infos["final_info"].items() if name[0] != "_"})
                told = {name: column[row] for name, column in told.items() if "._" not in name}
                assert {name: value for name, value in at_once(info).items()} == told
                assert stable_infos[row]["record"] == info["record"]
                alone = env.reset()[0]
            assert_identical(alone, seen[row])


@EVERY
def test_a_batch_goes_on_from_a_state_with_what_it_had_drawn(options):
    actions = leaning(4, 60, seed=3)
    first, second = (gym.make_vec(ID, num_envs=4, **options).unwrapped for _ in range(2))
    first.reset(seed=1)
    second.reset(seed=2)
    for action in actions[:10]:
        first.step(action)
    second.set_state(first.get_state())
    for action in actions[10:]:
        assert_identical(first.step(action), second.step(action))


def test_pictures_show_what_the_episode_drew():
    options = {"coupling": SPRING, "tool_mass": (0.05, 0.4), "alarm_threshold": (0.2, 5.0), "record_trace": True}
    env = gym.make(ID, **options)
    _, info = episode(env, leaning(1, 200)[:, 0], seed=1)
    history = History(env.unwrapped.trace(), info, env.unwrapped._batch.task, ended=True)
    assert history.threshold == info["record"]["alarm_threshold"]
    assert history.task.coupling.stiffness == info["record"]["coupling.stiffness"]
    reduced = 1.0 / (1.0 / info["record"]["tool_mass"] + 1.0 / info["record"]["object_mass"])
    assert history.reduced_mass == pytest.approx(reduced, rel=1e-15)


def test_ranges_of_no_width_are_numbers():
    narrow = Task(
        tool_mass=(0.2, 0.2), coupling={"type": "SpringDamper", "stiffness": [60.0, 60.0]}, force_noise=(1, 1)
    )
    assert narrow.drawn == {}
    assert narrow.record() == Task(tool_mass=0.2, coupling=ig.SpringDamper(60.0), force_noise=1.0).record()


def test_a_number_that_is_drawn_leaves_everything_else_as_it_is():
    drawn, plain = gym.make_vec(ID, num_envs=8, tool_mass=(0.1, 0.2)), gym.make_vec(ID, num_envs=8)
    actions = leaning(8, 150, seed=4)
    drawn.reset(seed=3)
    plain.reset(seed=3)
    both = list(zip(finals(drawn, actions), finals(plain, actions), strict=True))
    assert min(len(one) for one, _ in both) > 1
    for one, other in both:  # another tool ends its episodes at other times: compare as many as there are
        for with_mass, without in zip(one, other, strict=False):
            assert 0.1 <= with_mass.pop("tool_mass") < 0.2
            assert with_mass == without


def test_a_fixed_number_is_not_in_the_record():
    _, info = episode(gym.make(ID, tool_mass=0.2), leaning(1, 200)[:, 0], seed=1)
    assert not {*info["record"]} & {*NUMBERS}


def test_the_privileged_observation_shows_what_is_drawn_from_end_to_end():
    options = {"coupling": SPRING, "tool_mass": (0.1, 0.4), "force_bias": (0.0, 0.5), "privileged": True}
    env = gym.make(ID, **options)
    names = [entry.name for entry in entries(Task(**options))]
    assert names[-9:-5] == ["tool_mass", "force_bias", "coupling.stiffness", "coupling.damping_ratio"]
    drawn = Task(**options).drawn
    for share in (0.0, 0.25, 1.0):
        logarithmic = {"tool_mass": 0.1 * 4.0**share, "coupling.stiffness": 40.0 * 15.0**share}
        record = logarithmic | {"force_bias": 0.5 * share, "coupling.damping_ratio": 0.2 + 1.3 * share}
        record = {name: min(max(value, drawn[name][0]), drawn[name][1]) for name, value in record.items()}
        observation = env.reset(seed=1, options={"record": record})[0]
        assert observation[-9:-5] == pytest.approx(2.0 * share - 1.0, abs=1e-6)
        assert env.observation_space.contains(observation)


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ({"tool_mass": 0.5}, "tool_mass.*at most 0.2 kg.*0.5"),
        ({"tool_mass": math.nan}, "tool_mass.*finite"),
        ({"coupling.stiffness": 50.0}, "no field 'coupling.stiffness'"),
        ({"alarm_threshold": 1.0}, "no field 'alarm_threshold'"),
    ],
    ids=str,
)
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


def test_the_papers_rule_at_the_papers_limits_is_the_corner_of_the_action_space():
    scenario = {"object_mass": 0.5, "contact_stiffness": 3e4, "restitution": 0.4, "distance": 0.3}
    env = gym.make(ID, velocity_range=(0.0, 1.0), acceleration_range=(1.0, 8.0))
    observation, ended = env.reset(seed=1, options={"scenario": scenario})[0], False
    while not ended:
        go = 1.0 if observation[3] == 0.0 else -1.0
        observation, _, ended, _, info = env.step(np.array([go, 1.0], np.float32))
    scene = ig.Scene(ig.Tool(0.125), ig.Object(0.5, 0.3), ig.Contact(3e4, 0.4), ig.SpringDamper(50.0, 1.0))
    outcome = ig.simulate(scene, ig.Trapezoid(1.0, 8.0, ig.Brake(1.0, 0.016)), 3.0)
    assert info["object_velocity"] == pytest.approx(outcome.object_velocity, abs=1e-9)
    assert info["approach_time"] == pytest.approx(outcome.contacts[0].start, abs=1e-9)


def test_a_baseline_commands_what_it_means_on_an_arm_of_other_ranges():
    scenario = {"object_mass": 0.5, "contact_stiffness": 3e4, "restitution": 0.4, "distance": 0.3}
    results = []
    for options in ({}, {"velocity_range": (-1.0, 2.0), "acceleration_range": (0.5, 20.0)}):
        rule = ConstantDeceleration([parameter.start for parameter in ConstantDeceleration.PARAMETERS])
        env, rule = gym.make(ID, **options), rule.for_environment(options)
        observation, ended = env.reset(seed=1, options={"scenario": scenario})[0], False
        while not ended:
            observation, _, ended, _, info = env.step(rule.predict(observation)[0])
        results.append([info["object_velocity"], info["approach_time"], info["peak_force"]])
    assert results[0] == pytest.approx(results[1], rel=1e-4)  # actions and observations are of single precision


def test_sensors_say_in_si_units_what_the_observation_says():
    options = {"range_noise": 0.01, "deflection_sensor": True, "force_bias": 0.1, "reaction_delay": 0.04}
    env, actions = gym.make(ID, **options), leaning(1, 200, seed=6)[:, 0]
    shown = {entry.sensor: place for place, entry in enumerate(entries(Task(**options)))}
    table = {entry.sensor: entry for entry in entries(Task(**options))}
    observation, ended, touched, tick = env.reset(seed=4)[0], False, 0.0, 0
    while not ended:
        sensors = env.unwrapped.sensors()
        known = {"time", "position", "velocity", "alarm", "time_since_alarm", "force", "force_peak"}
        assert {*sensors} == known | {"distance_estimate", "deflection"}
        for name, value in sensors.items():
            assert type(value) is float
            name = name.replace("force_peak", "peak")
            entry, of_force = table[name], name in {"force", "peak"}
            value, high = (math.log1p(one) if of_force else one for one in (value, entry.high))
            scaled = entry.scaled_low + (1.0 - entry.scaled_low) * (value - entry.low) / (high - entry.low)
            assert observation[shown[name]] == pytest.approx(min(max(scaled, entry.scaled_low), 1.0), abs=1e-6)
        touched = max(touched, sensors["force"])
        observation, _, ended, _, _ = env.step(actions[tick])
        tick += 1
    assert touched > 1.0


def test_sensors_of_a_batch_are_those_of_each_of_its_rows():
    options = {"range_noise": 0.01, "force_noise": (0.0, 1.0)}
    envs, singles = gym.make_vec(ID, num_envs=4, **options), [gym.make(ID, **options) for _ in range(4)]
    envs.reset(seed=1)
    for row, env in enumerate(singles):
        env.reset(seed=1 + row)
    for action in leaning(4, 12):
        envs.step(action)
        for row, env in enumerate(singles):
            env.step(action[row])
    together = envs.unwrapped.sensors()
    for row, env in enumerate(singles):
        assert env.unwrapped.sensors() == {name: column[row] for name, column in together.items()}
