"""One task behind every front end: what a row meets is, to the bit, what the single environment of its task gives."""

import warnings
from inspect import signature
from itertools import product

import gymnasium as gym
import numpy as np
import pytest
import stable_baselines3.common.env_checker as sb3_checker
from episodes import ID, IDS, Given, action_table, assert_identical, begin, history
from front_ends import FRONT_ENDS, OBJECTIVES, TWINS, Singles, trails
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused
from stable_baselines3.common.vec_env import DummyVecEnv
from tasks import CHANNEL, EVERYTHING_DRAWN, OBSERVED, OWN, STORM, WITH_OPERATOR, rows_of_tasks

import impact_gym as ig
from impact_gym.envs.batch import ROWS_PER_THREAD
from impact_gym.envs.single import ImpactApproachEnv
from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task import Task
from impact_gym.task.episodes import RECORD_IDS
from impact_gym.task.task import arguments

HARD = {"scenario": "hard", "time_weight": (0.5, 8.0), "reaction_delay": 0.03}
NOISY = {"range_noise": 0.01, "force_noise": 0.2, "force_bias": 0.1, "deflection_sensor": True, "privileged": True}
TELEOP, UNSURE = "ImpactTeleop-v0", {"uplink": CHANNEL, "privileged": True, "force_noise": (0.1, 1.0)}
MORE = ("coupling", "range_noise", "range_bias", "reference_velocity")
MODES = ["NextStep", "SameStep", "Disabled"]
FIXED = st.sampled_from([
    None, {"episode_index": 2}, {"scenario": {"distance": 0.1}},
    {"record": {"restitution": 0.5, "noise_seed": 7.0}, "scenario": {"object_mass": 0.3}},
])  # fmt: skip


def test_every_argument_of_a_task_is_in_the_strategy():
    assert {*arguments()} == {*OWN, *OBSERVED, *WITH_OPERATOR, *MORE}


def changed(trail, reward):
    """What rows meet, with other rewards, made from what a step returned; infos without the scalar one."""

    def step(met):
        rest = {name: value for name, value in met[-1].items() if name != "original_reward"}
        return [met[0], reward(met), *met[2:-1], rest]

    return [[step(met) if isinstance(met, list) else met for met in row] for row in trail]


def assert_alike(trail, expected, name):
    for row, (met, single) in enumerate(zip(trail, expected, strict=True)):
        for entry, other in zip(met, single, strict=True):
            assert_identical((name, row, entry), (name, row, other))


def assert_taken_apart(trail, task):
    """Vector rewards are the scalar ones by their weights, and those of an episode sum to what its final info says."""
    vectors, scalars, forced = [], [], [task.force_weight] * (task.force_weight > 0.0)
    for _, reward, terminated, truncated, info in (met for met in trail if isinstance(met, list)):
        vectors.append(reward)
        scalars.append(info["original_reward"])
        if terminated or truncated:
            assert np.array(vectors) @ [info["time_weight"], 1.0, *forced] == pytest.approx(scalars, abs=1e-9)
            assert info["missed"] == (terminated and info["contact_count"] == 0)
            kept = task.missed_cost if info["missed"] else info["object_velocity"]
            costs = info.get("done_time", info["approach_time"]), kept, *[info["peak_force"]] * len(forced)
            if not terminated:  # no V_p of the future, nothing but the time
                spent = min(info["approach_time"], len(vectors) * task.control_period)
                costs = info.get("done_time", spent), *[0.0] * (len(costs) - 1)
            assert -np.sum(vectors, axis=0) == pytest.approx(costs, abs=1e-9)
            vectors, scalars = [], []


@settings(STORM, max_examples=25)
@given(rows_of_tasks(), st.integers(0, 1000), FIXED, st.sampled_from([*TWINS, "state"]))
def test_front_ends_play_in_each_row_what_the_single_environment_of_its_task_plays(rows, seed, options, twin):
    """Whatever the task, what is fixed for the first episode, and whether a copy goes on in the middle of one."""
    actions = action_table(seed, 160, len(rows), lean=(-0.6, 0.6), task=rows[0])
    expected = trails(Singles(rows), actions, seed, options)
    assert_alike(trails(Singles(rows), actions, seed, options, twin), expected, "single")
    for name, make in FRONT_ENDS.items():
        single = changed(expected, lambda met: np.float32(met[1])) if name == "stable-baselines3" else expected
        assert_alike(trails(make(rows), actions, seed, options, twin), single, name)
    few, actions = rows[:1] * 2, actions[:90, :2]
    vectors = trails(OBJECTIVES["single"](few), actions, seed, options)
    scalars = trails(Singles(few), actions, seed, options)
    assert_alike(changed(vectors, lambda met: met[-1]["original_reward"]), scalars, "single objectives")
    assert_taken_apart(vectors[0], Task(**few[0]))
    for name, make in OBJECTIVES.items():
        assert_alike(trails(make(few), actions, seed, options, twin if twin != "state" else "copy"), vectors, name)


@settings(STORM, max_examples=40)
@given(rows_of_tasks(count=1), st.integers(0, 1000))
def test_episode_is_that_of_the_numbers_it_drew_and_can_be_played_again(rows, seed):
    (options,) = rows
    actions = action_table(seed, 200, 1, lean=(0.3, 0.6), task=options)[:, 0]
    env = gym.make(ID, **options)
    first = history(env, Given(actions), seed)
    info = env.unwrapped.episode_info()
    for elsewhere in (env, gym.make(ID, **options | {"scenario": "hard"})):
        assert_identical(history(elsewhere, Given(actions), record=info["record"])[1:], first[1:])
    task = Task(**options).at(info["record"])
    assert task.drawn == {}
    fixed = options | {name: getattr(task, name) for name in {path.partition(".")[0] for path in Task(**options).drawn}}
    assert Task(**fixed) == task
    if not (options["privileged"] and Task(**options).drawn):  # else a critic sees what is drawn
        alone, rest = gym.make(ID, **fixed), {name: info["record"][name] for name in RECORD_IDS}
        again = history(alone, Given(actions), record=rest)
        assert_identical([step[:4] for step in again[1:]], [step[:4] for step in first[1:]])
        assert_identical(alone.unwrapped.episode_info(), info | {"record": rest})


def test_threads_change_no_result():
    size, spring = 3 * ROWS_PER_THREAD, {"type": "SpringDamper", "stiffness": (40.0, 60.0), "damping_ratio": 1.0}
    options = {"coupling": spring, "force_noise": 0.1, "horizon": 0.4, "scenario": {"distance": 0.1}}
    actions, results = action_table(6, 28, size, lean=(0.3, 0.6)), []
    for threads in (1, 3):
        envs = ImpactApproachVectorEnv(size, threads=threads, **options)
        results.append([envs.reset(seed=1), *(envs.step(row) for row in actions)])
    assert_identical(*results)
    assert sum(result[2].sum() for result in results[0][1:]) > size // 2


@pytest.mark.parametrize(
    ("id", "options"),
    [*product(IDS, ({}, HARD)), (f"impact_gym:{ID}", NOISY), *product([TELEOP], ({}, UNSURE))],
    ids=str,
)
def test_checkers_of_gymnasium_and_stable_baselines3_find_nothing(id, options):
    for name in ("reset", "step"):
        own, theirs = (signature(getattr(kind, name)).parameters for kind in (ImpactApproachEnv, gym.Env))
        assert [(each.name, each.kind) for each in own.values()] == [(each.name, each.kind) for each in theirs.values()]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ig.envs.register()  # again, which does nothing
        check_env(gym.make(id, **options).unwrapped, skip_render_check=True)
        sb3_checker.check_env(gym.make(id, **options))
    assert [str(warning.message) for warning in caught] == []


@settings(STORM, max_examples=30)
@given(st.sampled_from(IDS), rows_of_tasks(count=1), st.sampled_from(MODES))
def test_environment_is_made_again_from_its_json(id, rows, mode):
    (options,) = rows
    actions = action_table(3, 200, task=gym.spec(id).kwargs | options)
    env = gym.make(id, **options)
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert_identical(*(history(each, Given(actions[:, 0]), seed=3) for each in (env, again)))
    envs = gym.make_vec(id, num_envs=4, autoreset_mode=mode, **options)
    again = gym.make_vec(EnvSpec.from_json(envs.spec.to_json()))
    assert again.num_envs == 4
    assert again.metadata["autoreset_mode"] is AutoresetMode(mode)
    assert_identical(again.reset(seed=3), envs.reset(seed=3))


def sync_vec(slots, mode, **options):
    """Gymnasium's own loop over single environments."""
    return gym.make_vec(ID, slots, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("options", [NOISY, EVERYTHING_DRAWN["spring"]], ids=["noisy", "everything drawn"])
def test_batch_returns_what_gymnasiums_loop_over_single_environments_returns(options, mode):
    """Its spaces, its infos with their masks, and which arrays are of which type, too."""
    envs, loop = gym.make_vec(ID, num_envs=7, autoreset_mode=mode, **options), sync_vec(7, mode, **options)
    assert (envs.observation_space, envs.action_space) == (loop.observation_space, loop.action_space)
    assert_identical(envs.reset(seed=17), loop.reset(seed=17))
    ended = 0
    for row in action_table(1, 160, 7, lean=(-0.6, 0.6)):
        result = envs.step(row)
        assert_identical(result, loop.step(row))
        sensors = envs.unwrapped.sensors()
        for slot, env in enumerate(loop.unwrapped.envs):
            assert env.unwrapped.sensors() == {name: column[slot] for name, column in sensors.items()}
        ended += (dones := result[2] | result[3]).sum()
        if mode == "Disabled" and dones.any():
            assert_identical(*(each.reset(options={"reset_mask": dones.copy()}) for each in (envs, loop)))
    assert ended > 7


def test_batch_of_stable_baselines3_returns_what_its_own_loop_returns():
    """After `seed` the next reset uses it, and only that one; options hold for the slot and the reset they are for."""
    envs, loop = ImpactVecEnv(3, **NOISY), DummyVecEnv([lambda: gym.make(ID, **NOISY)] * 3)
    assert (envs.observation_space, envs.action_space) == (loop.observation_space, loop.action_space)
    for seed, distances in ((17, [0.17, 0.22, 0.31]), (None, []), (3, [])):
        for each in (envs, loop):
            each.set_options([{"scenario": {"distance": distance}} for distance in distances] or {})
        assert seed is None or envs.seed(seed) == loop.seed(seed)
        assert_identical(envs.reset(), loop.reset())
        assert envs.reset_infos == [{}] * 3
        assert envs.envs.batch.info()["scenario"]["distance"].tolist() == distances or not distances
        for row in action_table(6, 90, 3, lean=(0.3, 0.6)):
            (*seen, infos), (*expected, others) = envs.step(row), loop.step(row)
            assert_identical(seen, expected)
            for info, other, ended in zip(infos, others, seen[2], strict=True):
                assert_identical((info, bool(info)), ({name: other[name] for name in info}, bool(ended)))


def test_episode_that_ends_by_itself_on_the_last_step_allowed_is_flagged_as_by_gymnasium():
    stand_still = np.float32([[-0.5, 1.0]])
    envs, loop = gym.make_vec(ID, max_episode_steps=75), sync_vec(1, "NextStep", max_episode_steps=75)
    envs.reset(seed=0), loop.reset(seed=0)
    for _ in range(75):
        result, expected = envs.step(stand_still), loop.step(stand_still)
    assert result[2].all()
    assert_identical(result[:4], expected[:4])


def test_seeds_and_reset_mask_reach_exactly_the_slots_they_name():
    envs, loop = gym.make_vec(ID, num_envs=3, autoreset_mode="Disabled"), sync_vec(3, "Disabled")
    assert_identical(envs.reset(seed=[30, 8, 30])[0], loop.reset(seed=[30, 8, 30])[0])
    rows, mask = action_table(4, 14, 3), np.array([False, True, False])
    for seed, row in zip([None, [None, 30, None], 29, None], rows[10:], strict=True):
        for action in (*rows[:3], row):
            before = envs.step(action)[0]
            assert_identical(before, loop.step(action)[0])
        options = {"scenario": {"distance": 0.3}}
        after, _ = envs.reset(seed=seed, options={**options, "reset_mask": mask})
        assert_identical(after, loop.reset(seed=seed, options={**options, "reset_mask": mask.copy()})[0])
        assert np.array_equal(after[~mask], before[~mask])


def test_slot_that_was_never_reset_or_without_autoreset_has_ended_must_be_reset_first():
    envs = gym.make_vec(ID, num_envs=2, autoreset_mode="Disabled", max_episode_steps=2)
    action, first, second = np.zeros((2, 2), np.float32), np.array([True, False]), np.array([False, True])
    for remedy in ("reset", "reset_mask"):
        envs.reset(seed=0, options={"reset_mask": first})
        with pytest.raises(gym.error.ResetNeeded, match=remedy):
            envs.step(action)
        envs.reset(options={"reset_mask": second})
        assert not envs.step(action)[3].any()
        assert envs.step(action)[3].all()


def test_stable_baselines3_can_ask_the_batch():
    envs = ImpactVecEnv(3)
    assert envs.get_attr("render_mode") == [None] * 3
    assert envs.env_is_wrapped(gym.Wrapper) == [False] * 3
    refused(lambda: envs.env_method("set_scenario", "hard", indices=[0]), "set_scenario", "indices", "[0]")


@pytest.mark.parametrize("make", [gym.make, gym.make_vec, ImpactVecEnv])
def test_set_scenario_holds_from_the_next_episode_on(make):
    env = ImpactVecEnv(2, scenario={"distance": 0.2}) if make is ImpactVecEnv else make(ID, scenario={"distance": 0.2})
    other = {"distance": 0.3, "object_mass": (1.0, 1.1)}
    for expected in (0.2, 0.3, 0.3):
        begin(env, seed=0)
        if make is ImpactVecEnv:
            env.env_method("set_scenario", other)
            info = env.envs.batch.info(0)
        else:
            env.unwrapped.set_scenario(other)
            info = env.unwrapped.episode_info() if make is gym.make else env.unwrapped.batch.info(0)
        mass, distance = info["scenario"]["object_mass"], info["scenario"]["distance"]
        assert (distance, 1.0 <= mass <= 1.1) == (expected, expected == 0.3)
