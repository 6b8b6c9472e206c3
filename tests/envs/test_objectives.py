"""Vector rewards: they are the scalar one taken apart, alike in all front ends, and pass MO-Gymnasium's checks."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from impact_gym.envs import IDS, of_objectives

OPTIONS = [{}, {"force_weight": 0.01}, {"time_weight": (0.5, 8.0), "missed_cost": 3.0}]
MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP]


def episodes(env, count, seed=0):
    """Of each episode with random actions: rewards (steps, objectives), scalar ones (steps,), the last info."""
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    for _ in range(count):
        vectors, scalars, ended = [], [], False
        while not ended:
            _, reward, terminated, truncated, info = env.step(rng.uniform(-0.2, 1.0, env.action_space.shape))
            assert env.unwrapped.reward_space.contains(reward)
            vectors.append(reward)
            scalars.append(info["original_reward"])
            ended = terminated or truncated
        yield np.array(vectors), np.array(scalars), info
        env.reset()


@pytest.mark.parametrize("name", IDS)
@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_vector_rewards_are_the_scalar_one_taken_apart(name, options):
    env = gym.make(of_objectives(name), disable_env_checker=True, **options)
    assert env.unwrapped.reward_dim == 2 + ("force_weight" in options)
    for vectors, scalars, info in episodes(env, 8):
        weights = [info["time_weight"], 1.0, *([options["force_weight"]] if "force_weight" in options else [])]
        assert vectors @ weights == pytest.approx(scalars, abs=1e-12)
        velocity = info["object_velocity"] if not info["missed"] else options.get("missed_cost", 2.0)
        charged = info.get("done_time", info["approach_time"])
        assert -vectors.sum(axis=0)[:2] == pytest.approx([charged, velocity], abs=1e-12)
        if "force_weight" in options and not info["missed"]:
            assert -vectors[-1, 2] == pytest.approx(info["peak_force"])


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.value)
def test_native_batch_has_the_vector_rewards_of_single_environments(mode):
    rng, slots = np.random.default_rng(1), 3
    batch = gym.make_vec("mo-impact-approach-v0", num_envs=slots, autoreset_mode=mode)
    singles = [gym.make("mo-impact-approach-v0", disable_env_checker=True) for _ in range(slots)]
    batch.reset(seed=5)
    for slot, single in enumerate(singles):
        single.reset(seed=5 + slot)
    fresh = [False] * slots
    for _ in range(120):
        actions = rng.uniform(-0.2, 1.0, (slots, 2)).astype(np.float32)
        _, rewards, terminated, _, infos = batch.step(actions)
        assert rewards.shape == (slots, 2)
        for slot, single in enumerate(singles):
            if fresh[slot] and mode is AutoresetMode.NEXT_STEP:
                single.reset()
                expected, scalar, fresh[slot] = np.zeros(2), 0.0, False
            else:
                if fresh[slot]:
                    single.reset()
                _, expected, *ended, info = single.step(actions[slot])
                scalar, fresh[slot] = info["original_reward"], any(ended)
            assert np.array_equal(rewards[slot], expected)
            assert infos["original_reward"][slot] == scalar
            assert terminated[slot] == fresh[slot]


def test_pickled_environment_goes_on_alike():
    env = gym.make("mo-impact-approach-v0", disable_env_checker=True)
    env.reset(seed=3)
    for _ in range(5):
        env.step(np.ones(2, np.float32))
    twin = pickle.loads(pickle.dumps(env))
    ended = False
    while not ended:
        (_, ours, ended, *_), (_, theirs, *_) = (each.step(np.ones(2, np.float32)) for each in (env, twin))
        assert np.array_equal(ours, theirs)


class WithoutWeights(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Info without the weights that LinearReward hands out again and again, which Gymnasium's check refuses."""

    def __init__(self, env):
        gym.utils.RecordConstructorArgs.__init__(self)
        super().__init__(env)

    def step(self, action):
        *rest, info = self.env.step(action)
        del info["reward_weights"]
        return *rest, info


@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version")  # it is LinearReward that is checked
def test_mo_gymnasium_makes_them_and_a_linear_reward_passes_gymnasiums_check():
    mo_gym = pytest.importorskip("mo_gymnasium")
    for name in map(of_objectives, IDS):
        linear = mo_gym.wrappers.LinearReward(mo_gym.make(name), weight=np.array([2.0, 1.0]))
        check_env(WithoutWeights(linear), skip_render_check=True)
