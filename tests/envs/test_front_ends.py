"""One task behind every front end: each is compared, bit for bit, with Gymnasium's or stable-baselines3's own loop
over single environments.
"""

import warnings
from itertools import product

import gymnasium as gym
import numpy as np
import pytest
import stable_baselines3.common.env_checker as sb3_checker
from drawn_setups import EVERYTHING, SETUPS
from episodes import ID, IDS, ROBOT, Given, action_table, assert_identical, begin, history
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import DummyVecEnv

import impact_gym as ig
from impact_gym.envs import batch
from impact_gym.sb3 import ImpactVecEnv

HARD = {"scenario": "hard", "time_weight": (0.5, 8.0), "reaction_delay": 0.03}
OPTION_SETS = [
    {},
    {"range_noise": 0.01, "time_weight": (0.5, 8.0)},
    {"coupling": {"type": "Rigid"}, "reaction_delay": 0.0, "control_period": 0.011},
    {"scenario": "hard", "reaction_delay": 0.04, "force_weight": 0.01, "tool_mass": 0.3},
    {"coupling": {"type": "Bistable"}, "reaction_delay": (0.0, 0.04), "deflection_sensor": True, "privileged": True},
    {"robot": ROBOT, "force_noise": 0.2, "force_bias": 0.1},
]
EACH_OPTION = [
    {"time_weight": (0.5, 8.0)}, {"force_weight": 0.01}, {"reaction_delay": (0.0, 0.05)}, {"control_period": 0.004},
    {"range_noise": 0.01}, {"force_noise": 0.5}, {"force_bias": 0.5}, {"deflection_sensor": True},
    {"privileged": True}, {"robot": ROBOT}, {"record_trace": True}, {"rtol": 1e-6}, {"tool_mass": 0.5},
    {"scenario": {"object_mass": 1.0}},
]  # fmt: skip
MODES = ["NextStep", "SameStep", "Disabled"]
SLOTS = 7


@pytest.fixture
def cut_small(monkeypatch):
    """Small batches are cut for threads too."""
    monkeypatch.setattr(batch, "ROWS_PER_THREAD", 2)


def actions(seed, ticks=230, slots=SLOTS):
    """Some slots end without a touch."""
    return action_table(seed, ticks, slots, lean=(-0.6, 0.6))


def sync_vec(slots=SLOTS, mode="NextStep", **options):
    """Gymnasium's own loop over single environments."""
    return gym.make_vec(ID, slots, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options)


def reset_ended(envs, reference, dones):
    """Reset the slots of both that have ended."""
    both = [each.reset(options={"reset_mask": dones.copy()}) for each in (envs, reference)]
    assert_identical(*both)


@pytest.mark.parametrize(("id", "options"), [
    *product(IDS, ({}, HARD)),
    *((f"impact_gym:{ID}", options) for options in (*OPTION_SETS, *EACH_OPTION)),
], ids=str)  # fmt: skip
def test_the_checkers_of_gymnasium_and_stable_baselines3_find_nothing(id, options):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(gym.make(id, **options).unwrapped)
        sb3_checker.check_env(gym.make(id, **options))
    assert [str(warning.message) for warning in caught] == []


@pytest.mark.parametrize(("id", "options"), [
    *product(IDS, [EVERYTHING]),
    *product([ID], [*OPTION_SETS, {"coupling": ig.SpringDamper(80.0, 0.5)}, {"coupling": ig.Rigid()}]),
], ids=str)  # fmt: skip
def test_an_environment_is_made_again_from_its_json(id, options):
    rows = action_table(3)
    for limit in ({}, {"max_episode_steps": 12}):
        env = gym.make(id, **limit, **options)
        told = history(env, Given(rows[:, 0]), seed=3)
        again = gym.make(EnvSpec.from_json(env.spec.to_json()))
        assert_identical(history(again, Given(rows[:, 0]), seed=3), told)
        assert told[-1][3] == bool(limit)
    for mode in ("SameStep", "Disabled"):
        envs = gym.make_vec(id, num_envs=4, autoreset_mode=mode, **options)
        again = gym.make_vec(EnvSpec.from_json(envs.spec.to_json()))
        assert again.num_envs == 4
        assert again.metadata["autoreset_mode"] is AutoresetMode(mode)
        assert_identical(again.reset(seed=3), envs.reset(seed=3))
        for row in rows[:12]:
            assert_identical(again.step(row), envs.step(row))


def test_importing_twice_registers_once():
    spec = gym.registry[ID]
    ig.envs.register()
    assert gym.registry[ID] is spec


@pytest.mark.usefixtures("cut_small")
@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("options", [*OPTION_SETS, *SETUPS.values()], ids=str)
def test_the_native_batch_equals_gymnasiums_loop_over_single_environments(options, mode, threads):
    envs = gym.make_vec(ID, num_envs=SLOTS, autoreset_mode=mode, threads=threads, **options)
    assert envs.metadata["autoreset_mode"] is AutoresetMode(mode)
    reference, ended = sync_vec(mode=mode, **options), 0
    assert_identical(envs.reset(seed=17), reference.reset(seed=17))
    for row in actions(1):
        result = envs.step(row)
        assert_identical(result, reference.step(row))
        dones = result[2] | result[3]
        ended += dones.sum()
        if mode == "Disabled" and dones.any():
            reset_ended(envs, reference, dones)
    assert ended > 2 * SLOTS


@pytest.mark.parametrize("mode", MODES)
def test_the_native_batch_truncates_as_the_time_limit_of_gymnasium_does(mode):
    envs = gym.make_vec(ID, num_envs=SLOTS, autoreset_mode=mode, max_episode_steps=40)
    reference = sync_vec(mode=mode, max_episode_steps=40)
    assert_identical(envs.reset(seed=5)[0], reference.reset(seed=5)[0])
    counts = np.zeros(2, int)
    for row in actions(2):
        result, expected = envs.step(row), reference.step(row)
        assert_identical(result[:3], expected[:3])
        dones = result[2] | result[3]
        assert_identical(dones, expected[2] | expected[3])
        counts += [result[2].sum(), result[3].sum()]
        if mode == "SameStep" and dones.any():
            for key in ("final_obs", "_final_obs"):
                assert_identical(result[4][key], expected[4][key])
        if mode == "Disabled" and dones.any():
            reset_ended(envs, reference, dones)
    assert counts.min() >= 3


def test_an_episode_that_ends_by_itself_on_the_last_step_allowed_is_flagged_as_by_gymnasium():
    stand_still = np.float32([[-0.5, 1.0]])
    envs, reference = gym.make_vec(ID, max_episode_steps=75), sync_vec(1, max_episode_steps=75)
    envs.reset(seed=0), reference.reset(seed=0)
    for _ in range(75):
        result, expected = envs.step(stand_still), reference.step(stand_still)
    assert result[2].all()
    assert_identical(result[:4], expected[:4])


@pytest.mark.parametrize("kind", ["single", "vector", "stable"])
def test_the_final_info_of_a_truncated_episode_has_its_entries_too(kind):
    """They are what the episode has come to so far: the cost of time alone, and no V_p of the future."""
    make = {"single": gym.make, "vector": gym.make_vec, "stable": lambda _, **options: ImpactVecEnv(1, **options)}[kind]
    env = make(ID, max_episode_steps=4)
    begin(env, seed=0)
    for row in actions(3, ticks=4, slots=1):
        *_, cut, info = env.step(row[0] if kind == "single" else row)
    assert np.all(cut)
    if kind == "single":
        info = env.unwrapped.episode_info()  # TimeLimit does not tell the environment
    elif kind == "stable":
        (info,) = info
        assert info["TimeLimit.truncated"] is True
    assert {"approach_time", "missed", "scenario"} <= set(info)
    assert [np.squeeze(info[name]) for name in ("contact_count", "object_velocity", "peak_force")] == [0, 0.0, 0.0]
    cost = sum(np.squeeze(term) for name, term in info["reward_terms"].items() if name[0] != "_")
    assert cost == pytest.approx(-2.0 * 4 * 0.016, rel=1e-12)


def test_a_list_of_seeds_and_a_reset_mask_reach_exactly_the_slots_they_name():
    envs, reference = gym.make_vec(ID, num_envs=3, autoreset_mode="Disabled"), sync_vec(3, "Disabled")
    assert_identical(envs.reset(seed=[30, 8, 30])[0], reference.reset(seed=[30, 8, 30])[0])
    rows = actions(4, ticks=10, slots=3)
    for row in rows:
        assert_identical(envs.step(row), reference.step(row))
    mask = np.array([False, True, False])
    for seed in (None, [None, 30, None], 29, None):
        before = envs.step(rows[0])[0]
        assert_identical(before, reference.step(rows[0])[0])
        options = {"scenario": {"distance": 0.3}}
        after, _ = envs.reset(seed=seed, options={**options, "reset_mask": mask})
        assert_identical(after, reference.reset(seed=seed, options={**options, "reset_mask": mask.copy()})[0])
        assert np.array_equal(after[~mask], before[~mask])
    for row in actions(5, ticks=30, slots=3):
        result = envs.step(row)
        assert_identical(result, reference.step(row))
        if result[2].any():
            break


def test_a_slot_that_was_never_reset_or_without_autoreset_has_ended_must_be_reset_first():
    envs = gym.make_vec(ID, num_envs=2, autoreset_mode="Disabled", max_episode_steps=2)
    action, one, other = np.zeros((2, 2), np.float32), np.array([True, False]), np.array([False, True])
    for remedy in ("reset", "reset_mask"):
        envs.reset(seed=0, options={"reset_mask": one})
        with pytest.raises(gym.error.ResetNeeded, match=remedy):
            envs.step(action)
        envs.reset(options={"reset_mask": other})
        assert not envs.step(action)[3].any()
        assert envs.step(action)[3].all()


@pytest.mark.usefixtures("cut_small")
@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("options", [*OPTION_SETS, {"max_episode_steps": 29}, *SETUPS.values()], ids=str)
def test_the_stable_baselines3_batch_equals_its_own_loop_over_single_environments(options, threads):
    envs = ImpactVecEnv(SLOTS, threads=threads, **options)
    reference = DummyVecEnv([lambda: gym.make(ID, **options)] * SLOTS)
    assert envs.observation_space == reference.observation_space
    assert envs.action_space == reference.action_space
    truncated = ended = 0
    for seed in (17, None, 3):  # after `seed` the next reset uses it, and only that one
        if seed is not None:
            assert envs.seed(seed) == reference.seed(seed)
        assert_identical(envs.reset(), reference.reset())
        assert envs.reset_infos == [{}] * SLOTS
        for row in actions(6)[:90]:
            (observations, rewards, dones, infos), expected = envs.step(row), reference.step(row)
            assert_identical((observations, rewards, dones), expected[:3])
            for slot in range(SLOTS):
                if dones[slot]:
                    ended += 1
                    truncated += infos[slot]["TimeLimit.truncated"]
                    for key, value in expected[3][slot].items():
                        assert_identical(infos[slot][key], value)
                else:
                    assert infos[slot] == {}
    assert ended > 2 * SLOTS
    assert (truncated > 0) == ("max_episode_steps" in options)


def test_options_set_for_one_environment_of_stable_baselines3_do_not_leak_to_another():
    distances = [0.17, 0.22, 0.31]
    envs, reference = ImpactVecEnv(3), DummyVecEnv([lambda: gym.make(ID)] * 3)
    action = np.tile(np.float32([0.5, 0.0]), (3, 1))
    for each in (envs, reference):
        each.seed(1)
        each.set_options([{"scenario": {"distance": distance}} for distance in distances])
        each.reset()
        found = {}
        while len(found) < 3:
            for slot, info in enumerate(each.step(action)[3]):
                if "scenario" in info:
                    found.setdefault(slot, info["scenario"]["distance"])
        assert [found[slot] for slot in range(3)] == distances


def test_stable_baselines3_can_ask_and_change_the_batch():
    envs = ImpactVecEnv(3)
    assert envs.get_attr("render_mode") == [None] * 3
    assert envs.env_is_wrapped(gym.Wrapper) == [False] * 3
    with pytest.raises(ValueError, match="indices"):
        envs.env_method("set_scenario", "hard", indices=[0])
    envs.env_method("set_scenario", {"distance": 0.26})
    begin(envs, seed=0)
    found = set()
    while not found:
        found |= {info["scenario"]["distance"] for info in envs.step(np.full((3, 2), 0.5, np.float32))[3] if info}
    assert found == {0.26}
