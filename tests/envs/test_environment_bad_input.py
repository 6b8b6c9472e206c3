"""Calls at a wrong time are refused, and actions beyond the box act as its edge.

All other bad input: tests/test_refusals.py.
"""

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, Always, assert_identical, play

from agents.baselines import PaperTrapezoid
from impact_gym.envs.single import ImpactApproachEnv
from impact_gym.sb3 import ImpactVecEnv

ZERO = np.zeros(2, np.float32)
MAKERS = {"single": gym.make, "vector": gym.make_vec, "stable": lambda _, **options: ImpactVecEnv(2, **options)}


def test_batch_takes_its_size_from_numpy():
    assert gym.make_vec(ID, num_envs=np.int64(3)).num_envs == 3


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


@pytest.mark.parametrize("make", [*MAKERS.values(), lambda _: ImpactApproachEnv()], ids=[*MAKERS, "by itself"])
def test_step_before_the_first_reset_is_refused(make):
    with pytest.raises((RuntimeError, gym.error.ResetNeeded), match="reset"):
        step(make(ID), Always(1.0, 8.0))


def test_step_after_the_end_is_refused_instead_of_rewarded_again():
    """`gym.make` lets such a step through to the environment; the batch without autoreset refuses it as well."""
    env = gym.make(ID)
    play(env, PaperTrapezoid())
    with pytest.raises((RuntimeError, gym.error.ResetNeeded), match="reset"):
        env.step(ZERO)
    env.reset()
    assert env.step(ZERO)[2] is False


def test_trace_that_is_not_kept_or_too_long_is_refused():
    env = gym.make(ID, horizon=40.0, control_period=0.15)
    with pytest.raises(RuntimeError, match="record_trace"):
        env.unwrapped.trace()
    env = gym.make(ID, horizon=40.0, control_period=0.15, record_trace=True)
    play(env, Always(0.0, 20.0))
    with pytest.raises(RuntimeError, match="trace points"):  # longer than a trace can be
        env.unwrapped.trace()
