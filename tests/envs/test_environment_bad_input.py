"""Bad input is refused before anything is stepped, by an error that names what was wrong and what is allowed."""

import math
import re

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import impact_gym as ig
from agents.baselines import encode
from impact_gym.envs.single import ImpactApproachEnv
from impact_gym.sb3 import ImpactVecEnv

ID = "ImpactApproach-v0"
ZERO = np.zeros(2, np.float32)
EVERY = pytest.mark.parametrize(
    "make",
    [gym.make, gym.make_vec, lambda _, **options: ImpactVecEnv(2, **options)],
    ids=["single", "vector", "stable"],
)
HUGE = 10**400  # no float holds it


ARGUMENT_CASES = [
    ({"scenaro": "train"}, TypeError, "'scenaro'.*scenario.*time_weight"),
    ({"ranges": None}, TypeError, "'ranges'.*scenario"),
    ({"scenario": "tests"}, ValueError, "hard.*test.*train.*'tests'"),
    ({"scenario": None}, TypeError, "scenario.*None"),
    ({"scenario": {"mass": 1.0}}, ValueError, "'mass'.*object_mass"),
    ({"scenario": {"distance": (0.3, 0.2)}}, ValueError, "distance.*0.3.*0.2"),
    ({"scenario": {"distance": 0.0}}, ValueError, "distance.*above 0"),
    ({"scenario": {"distance": "near"}}, TypeError, "distance.*number.*'near'"),
    ({"scenario": {"restitution": (0.5, 1.1)}}, ValueError, "restitution.*at most 1.*1.1"),
    ({"scenario": {"object_mass": (1.0, 2.0, 3.0)}}, ValueError, "object_mass.*pair"),
    ({"scenario": {"contact_stiffness": math.nan}}, ValueError, "contact_stiffness.*finite.*nan"),
    ({"coupling": "Rigid"}, TypeError, "coupling.*Rigid.*SpringDamper"),
    ({"coupling": {"stiffness": 50.0}}, TypeError, "coupling.*type.*SpringDamper"),
    ({"coupling": {"type": "SpringDamper"}}, TypeError, "stiffness"),
    ({"coupling": {"type": "SpringDamper", "stifness": 50.0}}, TypeError, "stifness.*stiffness"),
    ({"coupling": {"type": "SpringDamper", "stiffness": -1.0}}, ValueError, "stiffness.*above 0.*-1"),
    ({"tool_mass": 0.0}, ValueError, "tool_mass.*above 0.*kg"),
    ({"time_weight": -1.0}, ValueError, "time_weight.*above 0"),
    ({"time_weight": (8.0, 0.5)}, ValueError, "time_weight.*8.*0.5"),
    ({"time_weight": HUGE}, ValueError, "time_weight.*finite"),
    ({"force_weight": -0.1}, ValueError, "force_weight.*at least 0"),
    ({"force_weight": True}, TypeError, "force_weight.*number"),
    ({"alarm_threshold": 0.0}, ValueError, "alarm_threshold.*at least.*N"),
    ({"alarm_threshold": math.nan}, ValueError, "alarm_threshold.*finite"),
    ({"dissipation": "flores"}, ValueError, "dissipation.*hu-guo.*exact.*flores"),
    ({"reaction_delay": -0.001}, ValueError, "reaction_delay.*at least 0.*at most"),
    ({"reaction_delay": (0.02, 0.01)}, ValueError, "reaction_delay.*inverted"),
    ({"reaction_delay": (0.01, 0.02, 0.03)}, ValueError, "reaction_delay.*pair"),
    ({"reaction_delay": (-0.01, 0.02)}, ValueError, "reaction_delay.*at least 0"),
    ({"reaction_delay": np.array([[0.01, 0.02]])}, (TypeError, ValueError), "reaction_delay.*number"),
    ({"force_noise": -0.1}, ValueError, "force_noise.*at least 0.*N"),
    ({"force_noise": "loud"}, TypeError, "force_noise.*number"),
    ({"force_noise": (0.2, 0.1)}, ValueError, "force_noise.*inverted.*0.2.*0.1 N"),
    ({"force_noise": (0.1, 0.2, 0.3)}, ValueError, "force_noise.*pair.*N"),
    ({"tool_mass": (0.0, 0.1)}, ValueError, r"tool_mass\[0\].*above 0.*kg"),
    ({"tool_mass": (1e-9, 1e9)}, ValueError, "tool_mass.*factor"),
    ({"alarm_threshold": (0.0, 1.0)}, ValueError, r"alarm_threshold\[0\].*at least.*N"),
    ({"range_noise": (-0.01, 0.01)}, ValueError, r"range_noise\[0\].*at least 0.*m"),
    (
        {"coupling": {"type": "SpringDamper", "stiffness": (60.0, 40.0)}},
        ValueError,
        "coupling.stiffness.*inverted.*N/m",
    ),
    ({"coupling": {"type": "SpringDamper", "stiffness": (0.0, 40.0)}}, ValueError, "SpringDamper.stiffness.*above 0"),
    ({"coupling": {"type": "SpringDamper", "stifness": (40.0, 60.0)}}, TypeError, "stifness.*stiffness"),
    ({"coupling": {"type": "Bistable", "front_stop": (0.02, 0.07)}}, ValueError, "front_stop.*below the stroke.*0.07"),
    ({"coupling": {"type": "Bistable", "height": (0.02, 0.068)}}, ValueError, "front_stop.*below the stroke"),
    ({"coupling": {"type": "Bistable", "rear_stop": (-0.02, 0.01)}}, ValueError, "rear_stop.*below 0"),
    (
        {"robot": {"type": "Robot", "mass": (5, "6"), "stiffness": 1e5, "damping": 50}},
        TypeError,
        r"robot.mass\[1\].*kg",
    ),
    ({"robot": {"type": "Robot", "mass": 5, "stiffness": 1e5, "damping": (-1, 50)}}, ValueError, "damping.*at least 0"),
    ({"velocity_range": 1.0}, ValueError, "velocity_range.*pair.*m/s"),
    ({"velocity_range": (1.0, 1.0)}, ValueError, "velocity_range.*low below high"),
    ({"velocity_range": (-1.0, 0.0)}, ValueError, "velocity_range.*above 0"),
    ({"velocity_range": (-1e4, 1.0)}, ValueError, "velocity_range.*-1000"),
    ({"velocity_range": (0.0, 1e4)}, ValueError, r"velocity_range\[1\].*at most 1000 m/s"),
    ({"acceleration_range": (0.0, 8.0)}, ValueError, r"acceleration_range\[0\].*above 0.*m/s\^2"),
    ({"acceleration_range": (8.0, 1.0)}, ValueError, "acceleration_range.*inverted"),
    ({"force_bias": 1e300}, ValueError, "force_bias.*at most"),
    ({"range_noise": 1e300}, ValueError, "range_noise.*at most"),
    ({"scenario": {"object_mass": (1e-200, 1e200)}}, ValueError, "object_mass.*factor"),
    ({"robot": {"type": "Robot", "mass": 3.0}}, TypeError, "robot.*needs.*stiffness.*damping"),
    ({"coupling": {"type": "SpringDamper"}}, ValueError, "coupling.*needs.*stiffness"),
    ({"force_bias": -0.1}, ValueError, "force_bias.*at least 0.*N"),
    ({"force_bias": math.nan}, ValueError, "force_bias.*finite"),
    ({"deflection_sensor": 1}, TypeError, "deflection_sensor.*True or False"),
    ({"deflection_sensor": True, "coupling": ig.Rigid()}, ValueError, "deflection_sensor.*Rigid"),
    ({"privileged": "yes"}, TypeError, "privileged.*True or False"),
    ({"coupling": {"type": "Bistable", "height": 0.1}}, ValueError, "height.*free_length"),
    ({"robot": {"type": "Robot", "mass": 5.0, "stiffness": 1e5, "damping": -1.0}}, ValueError, "damping.*at least 0"),
    ({"robot": {"type": "Robot", "weight": 5.0}}, TypeError, "weight.*mass"),
    ({"robot": "Viper"}, TypeError, "robot.*Robot.*Viper"),
    ({"control_period": 0.0}, ValueError, "control_period.*at least"),
    ({"control_period": 0.2}, ValueError, "control_period.*at most"),
    ({"range_noise": -0.01}, ValueError, "range_noise.*at least 0"),
    ({"range_noise": math.inf}, ValueError, "range_noise.*finite"),
    ({"rtol": 0.0}, ValueError, "rtol.*at least"),
]


def cases(table):
    """Parametrise over rows of (what, error, message), named by what."""
    return pytest.mark.parametrize(("bad", "error", "message"), table, ids=[str(row[0])[:60] for row in table])


@EVERY
@cases(ARGUMENT_CASES)
def test_a_bad_argument_is_named_by_every_front_end(make, bad, error, message):
    with pytest.raises(error, match=message):
        make(ID, **bad)


@cases([
    ({"num_envs": 0}, ValueError, "num_envs.*at least 1.*0"),
    ({"num_envs": 2.5}, (TypeError, ValueError), "num_envs.*whole.*2.5"),
    ({"threads": 0}, ValueError, "threads.*at least 1"),
    ({"threads": -1}, ValueError, "threads.*at least 1"),
    ({"threads": "two"}, TypeError, "threads.*whole number"),
    ({"max_episode_steps": 0}, ValueError, "max_episode_steps.*at least 1"),
    ({"max_episode_steps": 2.5}, TypeError, "max_episode_steps.*whole"),
    ({"autoreset_mode": "never"}, ValueError, "(?i)autoreset_?mode"),
    ({"autoreset_mod": "NextStep"}, TypeError, "'autoreset_mod'.*autoreset_mode"),
    ({"render_mode": "human"}, ValueError, "render_mode.*None"),
])  # fmt: skip
def test_a_bad_argument_of_the_batch_is_named(bad, error, message):
    with pytest.raises(error, match=message):
        gym.make_vec(ID, **bad)


def test_a_render_mode_that_there_is_not_is_refused():
    with pytest.raises(ValueError, match=r"render_mode.*None.*'human'"):
        ImpactApproachEnv(render_mode="ansi")


def test_a_number_of_environments_may_come_from_numpy():
    assert gym.make_vec(ID, num_envs=np.int64(3)).num_envs == 3


def test_a_limit_on_steps_is_kept_or_refused_by_the_single_environment_itself():
    """Not through `gym.make`, whose TimeLimit sees to it; it must not be taken and then forgotten."""
    try:
        env = ImpactApproachEnv(max_episode_steps=3)
    except TypeError:
        return
    env.reset(seed=0)
    assert [env.step(ZERO)[3] for _ in range(3)] == [False, False, True]


ACTIONS = [
    (np.array([np.nan, 0.0], np.float32), ValueError, "finite.*nan"),
    (np.array([0.0, -np.inf]), ValueError, "finite.*inf"),
    (np.zeros(3, np.float32), ValueError, "shape.*2.*3"),
    (np.zeros((2, 2, 1), np.float32), ValueError, "shape"),
    (np.zeros((), np.float32), ValueError, "shape"),
    (np.array([True, False]), TypeError, "action.*numbers.*bool"),
    (np.array(["0", "1"]), TypeError, "action.*numbers.*U1"),
    (np.array([0.0, 0.5], object), TypeError, "action.*numbers.*object"),
    (np.array([0.0, 0.5j]), TypeError, "action.*numbers.*complex"),
    (None, TypeError, "action.*numbers"),
]


@cases(ACTIONS)
def test_a_bad_action_is_refused_and_nothing_moves(bad, error, message):
    env, twin = gym.make(ID), gym.make(ID)
    assert np.array_equal(env.reset(seed=3)[0], twin.reset(seed=3)[0])
    with pytest.raises(error, match=message):
        env.step(bad)
    expected = twin.step(encode(1.0, 8.0))
    assert all(np.array_equal(one, other) for one, other in zip(env.step(encode(1.0, 8.0)), expected, strict=True))


@cases(ACTIONS)
def test_a_bad_action_in_one_slot_moves_no_slot(bad, error, message):
    envs, twin = gym.make_vec(ID, num_envs=2), gym.make_vec(ID, num_envs=2)
    envs.reset(seed=3), twin.reset(seed=3)
    rows = None if bad is None else np.stack([np.zeros_like(bad), bad])
    with pytest.raises(error, match=message):
        envs.step(rows)
    good = np.stack([encode(1.0, 8.0)] * 2)
    assert all(np.array_equal(one, other) for one, other in zip(envs.step(good), twin.step(good), strict=True))


def test_the_shape_asked_for_is_that_of_the_action_space():
    env = gym.make(ID)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=re.escape(f"{env.action_space.shape}")):
        env.step(np.zeros(3, np.float32))


def test_actions_outside_the_box_act_as_its_edge():
    for outside, edge in (([3.0, -1.7], [1.0, -1.0]), ([-1e30, 1e30], [-1.0, 1.0]), ([1.0000001, 2], [1.0, 1.0])):
        env, twin = gym.make(ID), gym.make(ID)
        env.reset(seed=3), twin.reset(seed=3)
        for _ in range(25):
            one, other = env.step(np.float32(outside)), twin.step(np.float32(edge))
            assert np.array_equal(one[0], other[0])
            assert one[1:] == other[1:]


def reset(env, seed=None, options=None):
    """Reset any front end."""
    if isinstance(env, ImpactVecEnv):
        if options is not None:
            env.set_options(options)
        if seed is not None:
            env.seed(seed)
        return env.reset()
    return env.reset(seed=seed, options=options)[0]


def batched(env, action):
    """The action in the shape that a front end takes."""
    if isinstance(env, ImpactVecEnv):
        return np.stack([action] * env.num_envs)
    return np.broadcast_to(action, env.action_space.shape)


@EVERY
@cases([
    ({"scenari": {}}, ValueError, "'scenari'.*'scenario'"),
    ({"record": {"noise": 1.0}}, ValueError, "'noise'.*noise_seed"),
    ({"record": {"reaction_delay": -1.0}}, ValueError, "reaction_delay.*at least 0"),
    ({"record": [1.0]}, TypeError, "record.*mapping"),
    ({"scenario": {"time_weight": 1.0}}, ValueError, "'time_weight'.*object_mass"),
    ({"record": {"noise_seed": -1.0}}, ValueError, "noise_seed.*at least 0"),
    ({"record": {"noise_seed": 2.0**54}}, ValueError, "noise_seed.*at most"),
    ({"record": {"noise_seed": 0.5}}, ValueError, "noise_seed.*whole"),
    ({"episode_index": -1}, ValueError, "episode_index.*at least 0"),
    ({"episode_index": 1.5}, TypeError, "episode_index.*whole"),
    ({"scenario": {"masss": 1.0}}, ValueError, "'masss'.*object_mass"),
    ({"scenario": {"object_mass": -1.0}}, ValueError, "object_mass.*above 0.*kg"),
    ({"scenario": {"object_mass": (0.1, 0.2)}}, (TypeError, ValueError), "object_mass.*number"),
    ({"scenario": {"object_mass": "0.1"}}, TypeError, "object_mass.*number"),
    ({"scenario": {"restitution": 1.5}}, ValueError, "restitution.*at most 1"),
    ({"scenario": {"distance": math.nan}}, ValueError, "distance.*finite"),
    ({"scenario": {"distance": HUGE}}, ValueError, "distance.*finite"),
    ({"scenario": 0.3}, TypeError, "scenario.*mapping"),
])  # fmt: skip
def test_bad_options_of_a_reset_are_named_and_draw_nothing(make, bad, error, message):
    env, twin = make(ID), make(ID)
    assert np.array_equal(reset(env, seed=7), reset(twin, seed=7))
    with pytest.raises(error, match=message):
        reset(env, options=bad)
    scenarios = []
    for each in (env, twin):
        reset(each, options={})
        ended = False
        while not ended:
            result = each.step(batched(each, encode(1.0, 8.0)))
            ended = np.any(result[2])
        scenarios.append(str(result[-1]))
    assert "object_mass" in scenarios[0]
    assert scenarios[0] == scenarios[1]


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
@pytest.mark.parametrize("options", [3, "scenario", [("scenario", {})]], ids=repr)
def test_options_that_are_no_mapping_are_refused(make, options):
    with pytest.raises((TypeError, ValueError), match=r"options.*mapping"):
        make(ID).reset(options=options)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"seed": [1]}, "seed.*2"),
    ({"seed": 1.5}, "(?i)seed.*1.5"),
    ({"seed": -1}, "(?i)seed.*-1"),
    ({"options": {"reset_mask": np.zeros(2, bool)}}, "reset_mask.*2 booleans"),
    ({"options": {"reset_mask": np.ones(3, bool)}}, "reset_mask.*2 booleans"),
    ({"options": {"reset_mask": np.ones(2, int)}}, "reset_mask.*2 booleans"),
], ids=str)  # fmt: skip
def test_a_bad_seed_or_mask_of_the_batch_is_named(arguments, message):
    with pytest.raises((TypeError, ValueError, gym.error.Error), match=message):
        gym.make_vec(ID, num_envs=2).reset(**arguments)


def test_a_step_before_the_first_reset_is_refused_by_gymnasium():
    with pytest.raises(gym.error.ResetNeeded):
        gym.make(ID).step(ZERO)


@pytest.mark.parametrize("make", [ImpactApproachEnv, lambda: gym.make_vec(ID), lambda: ImpactVecEnv(1)])
def test_a_step_before_the_first_reset_is_refused_without_gymnasiums_wrapper_too(make):
    env = make()
    with pytest.raises((RuntimeError, gym.error.ResetNeeded), match="reset"):
        env.step(batched(env, ZERO))


def test_a_step_after_the_end_is_refused_instead_of_rewarded_again():
    """`gym.make` lets such a step through to the environment; the batch without autoreset refuses it as well."""
    env = gym.make(ID)
    env.reset(seed=0)
    while not env.step(encode(1.0, 8.0))[2]:
        pass
    with pytest.raises((RuntimeError, gym.error.ResetNeeded), match="reset"):
        env.step(ZERO)
    env.reset()
    assert env.step(ZERO)[2] is False


def powers(low, high):
    """Positive numbers of every magnitude between two."""
    return st.floats(math.log10(low), math.log10(high)).map(lambda power: float(10.0**power))


GARBAGE = st.one_of(
    st.sampled_from([math.nan, math.inf, -math.inf, -1.0, 0.0, -0.0, HUGE, -HUGE, 1e-320, True, None, "", "0.1", 1j]),
    st.tuples(st.floats(), st.floats()),
    st.lists(st.floats(), max_size=3),
    st.floats().map(np.float64),
    st.lists(st.floats(), max_size=2).map(np.array),
    st.just({}),
    st.just({"type": "Rigid", "stiffness": 1.0}),
)
SCENARIO = {
    "object_mass": powers(1e-6, 1e6),
    "contact_stiffness": powers(1e-2, 1e9),
    "restitution": powers(1e-4, 1.0),
    "distance": powers(1e-6, 1e3),
}
ARGUMENTS = {
    "scenario": st.fixed_dictionaries({}, optional={name: SCENARIO[name] | GARBAGE for name in SCENARIO}),
    "coupling": st.one_of(
        st.just({"type": "Rigid"}),
        st.fixed_dictionaries(
            {"type": st.just("SpringDamper"), "stiffness": powers(1e-3, 1e7), "damping_ratio": st.floats(0.0, 10.0)}
        ),
        st.just(ig.SpringDamper(150.0)),
        st.just({"type": "Bistable"}),
    ),
    "tool_mass": powers(1e-4, 1e3),
    "time_weight": powers(1e-3, 1e3),
    "force_weight": st.floats(0.0, 10.0),
    "reaction_delay": st.one_of(st.floats(0.0, 1.0), st.tuples(st.floats(1e-9, 0.05), st.floats(0.05, 1.0))),
    "control_period": powers(2e-3, 0.15),
    "range_noise": powers(1e-6, 10.0),
    "force_noise": st.floats(0.0, 100.0),
    "force_bias": st.floats(0.0, 100.0),
    "privileged": st.booleans(),
    "robot": st.one_of(
        st.none(),
        st.just(ig.Robot(5.225, 1.5e5, 53.75)),
        st.just({"type": "Robot", "mass": 1.0, "stiffness": 1e4, "damping": 10.0}),
    ),
    "rtol": powers(1e-12, 1e-2),
}
EPISODE = st.fixed_dictionaries({}, optional=ARGUMENTS)
NAMES = [*ARGUMENTS, *SCENARIO, "Rigid"]
FUZZ = settings(deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))


def all_finite(value):
    if isinstance(value, dict):
        return all(map(all_finite, value.values()))
    return isinstance(value, str) or bool(np.isfinite(value).all())


@settings(FUZZ, max_examples=150)
@given(EPISODE, st.sampled_from(list(ARGUMENTS)), GARBAGE)
def test_garbage_in_an_argument_is_a_clear_error_or_an_argument_after_all(arguments, name, garbage):
    env, refusal = None, ""
    try:
        env = gym.make(ID, **{**arguments, name: garbage})
    except (TypeError, ValueError) as error:
        refusal = str(error)
    if env is None:
        assert any(name in refusal for name in NAMES), refusal
    else:
        assert np.isfinite(env.reset(seed=0)[0]).all()


@settings(FUZZ, max_examples=100)
@given(st.dictionaries(st.sampled_from([*SCENARIO, "mass", ""]), st.one_of(GARBAGE, *SCENARIO.values()), max_size=3))
def test_garbage_in_the_options_of_a_reset_is_a_clear_error_or_a_scenario_after_all(scenario):
    observation, refusal = None, ""
    try:
        observation, _ = gym.make(ID).reset(seed=0, options={"scenario": scenario})
    except (TypeError, ValueError) as error:
        refusal = str(error)
    if observation is None:
        assert any(name in refusal for name in SCENARIO), refusal
    else:
        assert np.isfinite(observation).all()
        assert set(scenario) <= set(SCENARIO)


@settings(FUZZ, max_examples=120)
@given(
    EPISODE.filter(lambda arguments: "scenario" not in arguments),
    st.fixed_dictionaries({}, optional=SCENARIO),
    st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)), min_size=1, max_size=8),
)
def test_whatever_is_accepted_is_played_to_a_finite_end(arguments, scenario, actions):
    env = gym.make(ID, **arguments)
    observation, _ = env.reset(seed=0, options={"scenario": scenario})
    ended, tick, total = False, 0, 0.0
    while not ended:
        assert observation in env.observation_space
        observation, reward, ended, _, info = env.step(np.array(actions[tick % len(actions)]))
        total += reward
        tick += 1
        assert tick < 1 + (1.2 + 0.15 + 1.0) / arguments.get("control_period", 0.016) + 2
    assert math.isfinite(total)
    assert all_finite(info)
    assert info["status"] == "ok" or info["reward_terms"]["missed"] == -2.0


@pytest.mark.parametrize("bad", [{"reaction_dely": 0.01}, {"tool_mass": "0.1"}, {"privileged": 1}, {"scenario": 3}])
def test_a_wrong_type_or_name_is_a_value_error_too(bad):
    with pytest.raises(ValueError, match=next(iter(bad))) as raised:
        gym.make(ID, **bad)
    assert isinstance(raised.value, TypeError)
