"""Vector rewards: they are the parts of the scalar reward, within bounds, and pass MO-Gymnasium's checks."""

from itertools import repeat

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import Given, action_table, assert_identical, begin, steps
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st
from random_tasks import FIXED, STORM, rows_of_tasks

from impact_gym.envs.objectives import MOImpactApproachVectorEnv
from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.task import Task

ID = "mo-impact-approach-v0"


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@settings(STORM, max_examples=25)
@given(rows_of_tasks(count=2), st.integers(0, 1000), FIXED)
def test_weighted_sum_of_vector_rewards_is_the_scalar_reward_and_all_else_is_identical(mode, rows, seed, fixed):
    rows = rows[:1] * 2
    task, kinds = Task(**rows[0]), (MOImpactApproachVectorEnv, ImpactApproachVectorEnv)
    envs, scalar = (kind(2, autoreset_mode=mode, per_slot=rows, threads=1) for kind in kinds)
    alone = gym.make(ID, disable_env_checker=True, **rows[0])
    for each in (envs, scalar, alone):
        begin(each, seed, fixed)
    kept, going, forced = ([], []), True, [task.force_weight] * (task.force_weight > 0.0)
    begins = np.array([False, False])
    for actions in action_table(seed, 160, 2, lean=(-0.6, 0.6), task=rows[0]):
        seen, vectors, *flags, infos = envs.step(actions)
        expected, scalars, *others, of_scalar = scalar.step(actions)
        assert_identical((infos.pop("original_reward"), infos.pop("_original_reward").all()), (scalars, np.True_))
        assert_identical((seen, flags, infos), (expected, others, of_scalar))
        if going:  # the first episode of the first row
            _, vector, terminated, truncated, info = alone.step(actions[0])
            assert_identical((vector, info["original_reward"]), (vectors[0], float(scalars[0])))
            going = not (terminated or truncated)
        for row in np.flatnonzero(~begins):
            kept[row].append([*vectors[row], scalars[row]])
        ended = flags[0] | flags[1]
        begins = ended & (mode == "NextStep")  # the next step is a reset without a reward
        for row in np.flatnonzero(ended):
            names = ("missed", "object_velocity", "approach_time", "done_time", "peak_force", "time_weight")
            final, apart = infos.get("final_info", infos), np.array(kept[row])
            kept[row].clear()
            if not flags[0][row]:  # the time limit cuts the episode: only the time counts
                assert not apart[:, 1:-1].any()
                continue
            info = {name: final[name][row] for name in names if name in final}
            assert apart[:, :-1] @ [info["time_weight"], 1.0, *forced] == pytest.approx(apart[:, -1], abs=1e-9)
            velocity = task.missed_cost if info["missed"] else info["object_velocity"]
            costs = info.get("done_time", info["approach_time"]), velocity, *[info["peak_force"]] * len(forced)
            assert -np.sum(apart[:, :-1], axis=0) == pytest.approx(costs, abs=1e-9)


@pytest.mark.parametrize(
    "options", [{}, {"force_weight": 0.01}, {"time_weight": (0.5, 8.0), "missed_cost": 3.0}], ids=str
)
def test_returns_are_at_least_the_reference_point_at_any_speed(options):
    env = gym.make(ID, disable_env_checker=True, **options)
    bare, rng = env.unwrapped, np.random.default_rng(2)
    assert bare.reward_dim == 2 + ("force_weight" in options)
    assert bare.reward_space == Box(-np.inf, 0.0, (bare.reward_dim,), np.float64)
    for seed in range(30):
        action = np.array([rng.choice([-1.0, 0.0, 1.0]), 1.0], np.float32)
        _, *rewards = (returned[1] for returned in steps(env, Given(repeat(action)), seed))
        assert all(map(bare.reward_space.contains, rewards))
        assert np.all(np.sum(rewards, axis=0) >= bare.reference_point - 1e-12)


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


@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version")
def test_mo_gymnasium_makes_the_environments_and_weighs_their_rewards_to_the_scalar_one():
    mo_gym = pytest.importorskip("mo_gymnasium")
    for name in (name for name in gym.registry if name.startswith("mo-impact-")):
        scalar = gym.wrappers.TransformReward(mo_gym.make(name), lambda rewards: float(rewards @ [2.0, 1.0]))
        check_env(scalar, skip_render_check=True)
        linear = mo_gym.wrappers.LinearReward(mo_gym.make(name), weight=np.array([2.0, 1.0]))
        linear.reset(seed=0)
        _, reward, _, _, info = linear.step(linear.action_space.sample())
        assert reward == pytest.approx(info["original_reward"])
