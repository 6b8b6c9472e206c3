"""Vector rewards: their bounds, and MO-Gymnasium's checks; that they are the scalar one: `test_front_ends.py`."""

import gymnasium as gym
import numpy as np
import pytest
from episodes import action_table
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import check_env

from impact_gym.envs import IDS, objectives, of_objectives
from impact_gym.task import Task

ID = of_objectives("ImpactApproach-v0")
OPTIONS = [{}, {"force_weight": 0.01}, {"time_weight": (0.5, 8.0), "missed_cost": 3.0}]


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_episodes_lie_between_reference_and_utopia_point(options):
    """Whatever is done, also where a tool goes as fast as it can or not at all."""
    env = gym.make(ID, disable_env_checker=True, **options)
    bare, rng = env.unwrapped, np.random.default_rng(2)
    assert bare.reward_dim == 2 + ("force_weight" in options)
    assert bare.reward_space == Box(-np.inf, 0.0, (bare.reward_dim,), np.float64)
    for seed in range(30):
        env.reset(seed=seed)
        total, ended, action = np.zeros(bare.reward_dim), False, [rng.choice([-1.0, 0.0, 1.0]), 1.0]
        while not ended:
            _, reward, ended, _, _ = env.step(np.array(action, np.float32))
            assert bare.reward_space.contains(reward)
            total += reward
        assert np.all(total >= bare.reference_point - 1e-12)
        assert np.all(total <= bare.utopia_point)


@pytest.mark.parametrize("weights", [[0.01, 0.01], [0.01, 0.0]])
def test_force_is_an_objective_of_the_slots_with_a_force_weight(weights):
    envs = gym.make_vec(ID, num_envs=2, per_slot=[{"force_weight": weight} for weight in weights])
    envs.reset(seed=1)
    forces = np.zeros(2)
    for row in action_table(4, 90, 2):
        _, rewards, *_, infos = envs.step(row)
        forces = np.minimum(forces, rewards[:, 2])
        assert rewards @ [2.0, 1.0, 0.01] == pytest.approx(infos["original_reward"], abs=1e-9)
    assert (forces < 0.0).tolist() == [weight > 0.0 for weight in weights]


def test_no_tool_is_sooner_than_a_rigid_one_at_the_limits():
    env, task = gym.make(of_objectives("ImpactApproachRigid-v0"), disable_env_checker=True), Task()
    for distance in (0.02, 0.15, 0.3):
        env.reset(seed=0, options={"scenario": {"distance": distance}})
        ended = False
        while not ended:
            _, _, ended, _, info = env.step(np.ones(2, np.float32))
        assert info["approach_time"] == pytest.approx(objectives.soonest(task, distance), abs=1e-9)
    assert -env.unwrapped.utopia_point[0] == pytest.approx(objectives.soonest(task, 0.15))


@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version")
def test_mo_gymnasium_makes_them_and_they_pass_gymnasiums_check_weighed_to_the_scalar_reward():
    mo_gym = pytest.importorskip("mo_gymnasium")
    for name in map(of_objectives, IDS):
        scalar = gym.wrappers.TransformReward(mo_gym.make(name), lambda rewards: float(rewards @ [2.0, 1.0]))
        check_env(scalar, skip_render_check=True)
        linear = mo_gym.wrappers.LinearReward(mo_gym.make(name), weight=np.array([2.0, 1.0]))
        linear.reset(seed=0)
        _, reward, _, _, info = linear.step(linear.action_space.sample())
        assert reward == pytest.approx(info["original_reward"])
