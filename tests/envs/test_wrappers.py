"""Gymnasium's vector wrappers on the native batch: what they do to it is what they do to Gymnasium's own loop."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, SLOTS, action_table, assert_identical
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.wrappers import vector as vector_wrappers


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
    vector_wrappers.RecordEpisodeStatistics,
], ids=["rewards", "observations", "ten times", "five", "rescaled", "clipped", "list", "statistics"])  # fmt: skip
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
        result, expected = one.step(row), other.step(row)
        for returned in (result, expected):
            if "episode" in returned[4]:
                del returned[4]["episode"]["t"]  # s, of the clock on the wall
        assert_identical(result, expected)
        changed |= not data_equivalence(result, bare.step(row), exact=True)
        ended += result[2].sum()
    assert ended > SLOTS
    assert changed == (wrap is not vector_wrappers.ClipAction)  # these actions are inside the box
