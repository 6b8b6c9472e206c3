"""Gymnasium's wrappers on the single environment and on the native batch: what they give, not that they run."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, SLOTS, Given, action_table, assert_identical, history
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.wrappers import vector as vector_wrappers

OPTIONS = {"scenario": "hard", "time_weight": (0.5, 8.0), "force_weight": 0.002, "reaction_delay": 0.03}


ACTIONS = action_table(0)[:, 0]


def play(env, actions=ACTIONS, seed=3):
    return history(env, Given(actions), seed)


def plain(actions=ACTIONS, seed=3, **options):
    return play(gym.make(ID, **options), actions, seed)


def test_a_time_limit_cuts_without_changing_anything_else():
    whole = plain()
    cut = play(gym.wrappers.TimeLimit(gym.make(ID), 10))
    assert_identical(cut[:10], whole[:10])
    assert_identical(cut[10][:3], whole[10][:3])
    assert [step[3] for step in cut[1:]] == [False] * 9 + [True]
    assert len(whole) > 20
    assert_identical(play(gym.wrappers.TimeLimit(gym.make(ID), 200)), whole)


@pytest.mark.parametrize("options", [{}, OPTIONS], ids=str)
def test_recorded_statistics_are_the_sum_and_the_count_and_leave_the_final_info(options):
    env = gym.wrappers.RecordEpisodeStatistics(gym.make(ID, **options))
    for seed in range(5):
        actions = action_table(seed)[:, 0]
        _, *steps = play(env, actions, seed)
        info = dict(steps[-1][4])
        episode = info.pop("episode")
        assert episode["r"] == pytest.approx(sum(step[1] for step in steps), rel=1e-12)
        assert episode["r"] == pytest.approx(sum(info["reward_terms"].values()), rel=1e-12)
        assert episode["l"] == len(steps)
        assert_identical(info, plain(actions, seed, **options)[-1][4])


def test_actions_rescaled_to_metres_and_seconds_clipped_or_made_shorter_mean_the_same():
    low, high = np.array([-0.5, 1.0], np.float32), np.array([1.5, 20.0], np.float32)
    physical = gym.wrappers.RescaleAction(gym.make(ID), low, high)
    encoded = np.tile(np.float32([0.5, -5 / 19]), (160, 1))
    expected = plain(encoded)
    assert physical.action_space == Box(low, high)
    assert_identical(play(physical, np.tile(np.float32([1.0, 8.0]), (160, 1))), expected)
    one = gym.wrappers.TransformAction(gym.make(ID), lambda v: np.append(v, np.float32(-5 / 19)), Box(-1, 1, (1,)))
    assert_identical(play(one, encoded[:, :1]), expected)
    beyond = 3 * ACTIONS
    assert_identical(play(gym.wrappers.ClipAction(gym.make(ID)), beyond), plain(np.clip(beyond, -1, 1)))


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_vector_statistics_are_sums_and_counts_and_leave_the_final_info(mode):
    envs = vector_wrappers.RecordEpisodeStatistics(gym.make_vec(ID, num_envs=SLOTS, autoreset_mode=mode, **OPTIONS))
    bare = gym.make_vec(ID, num_envs=SLOTS, autoreset_mode=mode, **OPTIONS)
    envs.reset(seed=5), bare.reset(seed=5)
    returns, lengths, ended = np.zeros(SLOTS), np.zeros(SLOTS, int), 0
    fresh = np.zeros(SLOTS, bool)  # slots whose step only begins an episode
    for row in action_table(1):
        *_, terminated, _, infos = envs.step(row)
        *_, rewards, _, _, plain_infos = bare.step(row)
        returns, lengths = returns + rewards, lengths + ~fresh
        if terminated.any():
            assert infos["episode"]["r"][terminated] == pytest.approx(returns[terminated], rel=1e-12)
            assert np.array_equal(infos["episode"]["l"][terminated], lengths[terminated])
            final = infos["final_info"] if mode == "SameStep" else infos
            terms = sum(value for name, value in final["reward_terms"].items() if name[0] != "_")
            assert terms[terminated] == pytest.approx(returns[terminated], rel=1e-12)
            ended += terminated.sum()
            del infos["episode"], infos["_episode"]
        assert_identical(infos, plain_infos)
        returns[terminated], lengths[terminated] = 0.0, 0
        fresh = terminated if mode == "NextStep" else fresh
    assert envs.episode_count == ended > 2 * SLOTS


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("wrap", [
    vector_wrappers.NormalizeReward,
    vector_wrappers.NormalizeObservation,
    partial(vector_wrappers.TransformReward, func=lambda reward: 10.0 * reward),
    partial(vector_wrappers.TransformObservation, func=lambda seen: seen[:, :5],
            single_observation_space=Box(-1.0, 1.0, (5,))),
    partial(vector_wrappers.RescaleAction, min_action=np.full(2, -0.5, np.float32),
            max_action=np.full(2, 1.5, np.float32)),
    vector_wrappers.ClipAction,
    vector_wrappers.DictInfoToList,
], ids=["rewards", "observations", "ten times", "five", "rescaled", "clipped", "list"])  # fmt: skip
def test_a_vector_wrapper_does_to_the_native_batch_what_it_does_to_gymnasiums_loop(wrap, mode):
    native = gym.make_vec(ID, num_envs=SLOTS, autoreset_mode=mode)
    loop = gym.make_vec(ID, SLOTS, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode})
    refusing = (vector_wrappers.NormalizeObservation, vector_wrappers.TransformObservation)
    if mode == "SameStep" and getattr(wrap, "func", wrap) in refusing:
        with pytest.raises(ValueError, match="NEXT_STEP"):  # Gymnasium's own: final_obs would be left as it is
            wrap(native)
        return
    one, other, bare = wrap(native), wrap(loop), gym.make_vec(ID, num_envs=SLOTS, autoreset_mode=mode)
    assert one.observation_space == other.observation_space
    assert one.action_space == other.action_space
    assert_identical(one.reset(seed=8), other.reset(seed=8))
    bare.reset(seed=8)
    ended, changed = 0, False
    for row in action_table(2):
        result = one.step(row)
        assert_identical(result, other.step(row))
        changed |= not data_equivalence(result, bare.step(row), exact=True)
        ended += result[2].sum()
    assert ended > SLOTS
    assert changed == (wrap is not vector_wrappers.ClipAction)  # these actions are inside the box
