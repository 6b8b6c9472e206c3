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
from impact_gym.envs.scenario import ScenarioRanges
from impact_gym.envs.single import ImpactApproachEnv
from impact_gym.sb3 import ImpactVecEnv

ID = "ImpactApproach-v0"
ZERO = np.zeros(2, np.float32)
BOTH = pytest.mark.parametrize("make", [gym.make, gym.make_vec, lambda _, **options: ImpactVecEnv(2, **options)])
HUGE = 10**400  # no float holds it


@BOTH
@pytest.mark.parametrize(("options", "error", "message"), [
    ({"scenaro": "train"}, TypeError, "'scenaro'.*scenario.*time_weight"),
    ({"ranges": None}, TypeError, "'ranges'.*scenario"),
    ({"scenario": "tests"}, ValueError, "'tests'|hard.*test.*train.*'tests'"),
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
    ({"reaction_delay": -0.001}, ValueError, "reaction_delay.*at least 0.*at most"),
    ({"reaction_delay": np.array([0.01, 0.02])}, (TypeError, ValueError), "reaction_delay.*number"),
    ({"control_period": 0.0}, ValueError, "control_period.*at least"),
    ({"control_period": 0.2}, ValueError, "control_period.*at most"),
    ({"range_noise": -0.01}, ValueError, "range_noise.*at least 0"),
    ({"range_noise": math.inf}, ValueError, "range_noise.*finite"),
    ({"rtol": 0.0}, ValueError, "rtol.*at least"),
    ({"render_mode": "human"}, ValueError, "render_mode.*None"),
], ids=lambda value: str(value)[:60] if isinstance(value, dict) else "")  # fmt: skip
def test_a_bad_argument_is_named_by_every_front_end(make, options, error, message):
    with pytest.raises(error, match=f"(?s){message}"):
        make(ID, **options)


@pytest.mark.parametrize(("options", "error", "message"), [
    ({"num_envs": 0}, ValueError, "num_envs.*at least 1.*0"),
    ({"num_envs": 2.5}, (TypeError, ValueError), "num_envs.*whole.*2.5"),
    ({"threads": 0}, ValueError, "threads.*at least 1"),
    ({"threads": -1}, ValueError, "threads.*at least 1"),
    ({"threads": "two"}, TypeError, "threads.*whole number"),
    ({"max_episode_steps": 0}, ValueError, "max_episode_steps.*at least 1"),
    ({"max_episode_steps": 2.5}, ValueError, "max_episode_steps.*whole"),
    ({"autoreset_mode": "never"}, ValueError, "(?i)autoreset_?mode"),
    ({"autoreset_mod": "NextStep"}, TypeError, "'autoreset_mod'.*autoreset_mode"),
], ids=str)  # fmt: skip
def test_a_bad_argument_of_the_batch_is_named(options, error, message):
    with pytest.raises(error, match=message):
        gym.make_vec(ID, **options)


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


@pytest.mark.parametrize(("action", "error", "message"), ACTIONS, ids=repr)
def test_a_bad_action_is_refused_and_nothing_moves(action, error, message):
    env, twin = gym.make(ID), gym.make(ID)
    assert np.array_equal(env.reset(seed=3)[0], twin.reset(seed=3)[0])
    with pytest.raises(error, match=message):
        env.step(action)
    expected = twin.step(encode(1.0, 8.0))
    assert all(np.array_equal(one, other) for one, other in zip(env.step(encode(1.0, 8.0)), expected, strict=True))


@pytest.mark.parametrize(("action", "error", "message"), ACTIONS, ids=repr)
def test_a_bad_action_in_one_slot_moves_no_slot(action, error, message):
    envs, twin = gym.make_vec(ID, num_envs=2), gym.make_vec(ID, num_envs=2)
    envs.reset(seed=3), twin.reset(seed=3)
    rows = None if action is None else np.stack([np.zeros_like(action), action])
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


@BOTH
@pytest.mark.parametrize(("options", "error", "message"), [
    ({"scenari": {}}, ValueError, "'scenari'.*'scenario'"),
    ({"scenario": {"masss": 1.0}}, ValueError, "'masss'.*object_mass"),
    ({"scenario": {"object_mass": -1.0}}, ValueError, "object_mass.*above 0.*kg"),
    ({"scenario": {"object_mass": (0.1, 0.2)}}, TypeError, "object_mass.*number"),
    ({"scenario": {"restitution": 1.5}}, ValueError, "restitution.*at most 1"),
    ({"scenario": {"distance": math.nan}}, ValueError, "distance.*finite"),
    ({"scenario": {"distance": HUGE}}, ValueError, "distance.*finite"),
    ({"scenario": 0.3}, TypeError, "scenario.*mapping"),
    (3, TypeError, "options.*mapping"),
], ids=lambda value: str(value)[:60] if isinstance(value, (dict, int)) else "")  # fmt: skip
def test_bad_options_of_a_reset_are_named_and_draw_nothing(make, options, error, message):
    env, twin = make(ID), make(ID)
    if isinstance(env, ImpactVecEnv):
        env.seed(7), twin.seed(7)
        env.reset(), twin.reset()
        with pytest.raises(error, match=message):
            env.set_options(options)
            env.reset()
        env.set_options({})
    else:
        env.reset(seed=7), twin.reset(seed=7)
        with pytest.raises(error, match=message):
            env.reset(seed=8, options=options)
    found = []
    for each in (env, twin):
        each.reset()
        ended = False
        while not ended:
            result = each.step(np.broadcast_to(encode(1.0, 8.0), each.action_space.shape if make is not BOTH else (2,)) if not isinstance(each, ImpactVecEnv) else np.stack([encode(1.0, 8.0)] * 2))
            ended = np.any(result[2])
        found.append(str(result[-1]))
    assert found[0] == found[1]
