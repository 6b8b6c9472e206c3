"""Bad input is refused before anything is stepped, by an error that names what was wrong and what is allowed."""

import math
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, Always, assert_identical, begin, play

import impact_gym as ig
from agents.baselines import PaperTrapezoid, encode
from impact_gym.envs.single import ImpactApproachEnv
from impact_gym.sb3 import ImpactVecEnv

ZERO = np.zeros(2, np.float32)
MAKERS = {"single": gym.make, "vector": gym.make_vec, "stable": lambda _, **options: ImpactVecEnv(2, **options)}
EVERY = pytest.mark.parametrize("make", MAKERS.values(), ids=list(MAKERS))
HUGE = 10**400  # no float holds it
SPRING, BISTABLE = {"type": "SpringDamper"}, {"type": "Bistable"}
ROBOT = {"type": "Robot", "mass": 5.0, "stiffness": 1e5, "damping": 50.0}


ARGUMENT_CASES = [
    ({"scenaro": "train"}, TypeError, "'scenaro'.*scenario.*time_weight"),
    ({"ranges": None}, TypeError, "'ranges'.*scenario"),
    ({"scenario": "tests"}, ValueError, "hard.*test.*train.*'tests'"),
    ({"scenario": None}, TypeError, "scenario.*None"),
    ({"scenario": 3}, TypeError, "scenario.*3"),
    ({"scenario": {"mass": 1.0}}, ValueError, "'mass'.*object_mass"),
    ({"scenario": {"distance": (0.3, 0.2)}}, ValueError, "distance.*0.3.*0.2"),
    ({"scenario": {"distance": 0.0}}, ValueError, "distance.*above 0"),
    ({"scenario": {"distance": "near"}}, TypeError, "distance.*number.*'near'"),
    ({"scenario": {"restitution": (0.5, 1.1)}}, ValueError, "restitution.*at most 1.*1.1"),
    ({"scenario": {"object_mass": (1.0, 2.0, 3.0)}}, ValueError, "object_mass.*pair"),
    ({"scenario": {"contact_stiffness": math.nan}}, ValueError, "contact_stiffness.*finite.*nan"),
    ({"coupling": "Rigid"}, TypeError, "coupling.*Rigid.*SpringDamper"),
    ({"coupling": {"stiffness": 50.0}}, TypeError, "coupling.*type.*SpringDamper"),
    ({"coupling": SPRING | {"stifness": 50.0}}, TypeError, "stifness.*stiffness"),
    ({"coupling": SPRING | {"stiffness": -1.0}}, ValueError, "stiffness.*above 0.*-1"),
    ({"tool_mass": "0.1"}, TypeError, "tool_mass.*number"),
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
    ({"coupling": SPRING | {"stiffness": (60.0, 40.0)}}, ValueError, "coupling.stiffness.*inverted.*N/m"),
    ({"coupling": SPRING | {"stiffness": (0.0, 40.0)}}, ValueError, r"coupling.stiffness\[0\].*above 0"),
    ({"coupling": SPRING | {"stifness": (40.0, 60.0)}}, TypeError, "stifness.*stiffness"),
    ({"coupling": BISTABLE | {"front_stop": (0.02, 0.07)}}, ValueError, "front_stop.*below the stroke.*0.07"),
    ({"coupling": BISTABLE | {"height": (0.02, 0.068)}}, ValueError, "front_stop.*below the stroke"),
    ({"coupling": BISTABLE | {"rear_stop": (-0.02, 0.01)}}, ValueError, "rear_stop.*below 0"),
    ({"robot": ROBOT | {"mass": (5, "6")}}, TypeError, r"robot.mass\[1\].*kg"),
    ({"robot": ROBOT | {"damping": (-1, 50)}}, ValueError, "damping.*at least 0"),
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
    ({"coupling": SPRING}, TypeError, "coupling.*needs.*stiffness"),
    ({"force_bias": -0.1}, ValueError, "force_bias.*at least 0.*N"),
    ({"force_bias": math.nan}, ValueError, "force_bias.*finite"),
    ({"deflection_sensor": 1}, TypeError, "deflection_sensor.*True or False"),
    ({"deflection_sensor": True, "coupling": ig.Rigid()}, ValueError, "deflection_sensor.*Rigid"),
    ({"privileged": "yes"}, TypeError, "privileged.*True or False"),
    ({"privileged": 1}, TypeError, "privileged.*True or False"),
    ({"coupling": BISTABLE | {"height": 0.1}}, ValueError, "height.*free_length"),
    ({"robot": ROBOT | {"damping": -1.0}}, ValueError, "damping.*at least 0"),
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
    """A wrong type or name is a ValueError too."""
    with pytest.raises(ValueError, match=message) as raised:
        make(ID, **bad)
    assert isinstance(raised.value, error)


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
    ({"render_mode": "rgb_array"}, ValueError, "render_mode.*None"),
])  # fmt: skip
def test_a_bad_argument_of_the_batch_is_named(bad, error, message):
    with pytest.raises(error, match=message):
        gym.make_vec(ID, **bad)


@cases([
    ({"render_mode": "ansi"}, ValueError, "render_mode.*None.*'human'.*rgb_array.*'ansi'"),
    ({"max_episode_steps": 3}, TypeError, "max_episode_steps.*TimeLimit"),  # not taken and then forgotten
])  # fmt: skip
def test_a_bad_argument_of_the_single_environment_by_itself_is_named(bad, error, message):
    with pytest.raises(error, match=message):
        ImpactApproachEnv(**bad)


def test_a_number_of_environments_may_come_from_numpy():
    assert gym.make_vec(ID, num_envs=np.int64(3)).num_envs == 3


@pytest.mark.parametrize("make", [gym.make, partial(gym.make_vec, num_envs=2)], ids=["single", "one slot of a batch"])
@cases([
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
])  # fmt: skip
def test_a_bad_action_is_refused_and_nothing_moves(make, bad, error, message):
    env, twin = make(ID), make(ID)
    assert np.array_equal(env.reset(seed=3)[0], twin.reset(seed=3)[0])
    in_one_slot = make is not gym.make and bad is not None
    with pytest.raises(error, match=message) as raised:
        env.step(np.stack([np.zeros_like(bad), bad]) if in_one_slot else bad)
    assert "shape" not in message or str(env.action_space.shape) in str(raised.value)
    good = np.broadcast_to(encode(1.0, 8.0), env.action_space.shape)
    assert_identical(env.step(good), twin.step(good))


def test_actions_outside_the_box_act_as_its_edge():
    for outside, edge in (([3.0, -1.7], [1.0, -1.0]), ([-1e30, 1e30], [-1.0, 1.0]), ([1.0000001, 2], [1.0, 1.0])):
        env, twin = gym.make(ID), gym.make(ID)
        env.reset(seed=3), twin.reset(seed=3)
        for _ in range(25):
            assert_identical(env.step(np.float32(outside)), twin.step(np.float32(edge)))


def step(env, controller):
    """Step any front end: whether all has ended, and the info."""
    slots = (env.num_envs,) if isinstance(env, ImpactVecEnv) else env.action_space.shape[:-1]
    result = env.step(controller.predict(np.zeros((*slots, 8)))[0])
    return np.all(result[2]), result[-1]


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
    assert np.array_equal(begin(env, seed=7), begin(twin, seed=7))
    with pytest.raises(error, match=message):
        begin(env, options=bad)
    infos = []
    for each in (env, twin):
        begin(each, options={})
        ended = False
        while not ended:
            ended, info = step(each, Always(1.0, 8.0))
        infos.append(str(info))
    assert "object_mass" in infos[0]
    assert infos[0] == infos[1]


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


@pytest.mark.parametrize("make", [*MAKERS.values(), lambda _: ImpactApproachEnv()], ids=[*MAKERS, "by itself"])
def test_a_step_before_the_first_reset_is_refused(make):
    with pytest.raises((RuntimeError, gym.error.ResetNeeded), match="reset"):
        step(make(ID), Always(1.0, 8.0))


def test_a_step_after_the_end_is_refused_instead_of_rewarded_again():
    """`gym.make` lets such a step through to the environment; the batch without autoreset refuses it as well."""
    env = gym.make(ID)
    play(env, PaperTrapezoid())
    with pytest.raises((RuntimeError, gym.error.ResetNeeded), match="reset"):
        env.step(ZERO)
    env.reset()
    assert env.step(ZERO)[2] is False
