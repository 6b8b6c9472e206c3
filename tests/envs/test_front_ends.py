"""One task behind every front end: each row gives, to the bit, what the single environment of its task gives."""

import copy
import pickle
import warnings
from functools import partial
from inspect import signature
from itertools import product, repeat

import gymnasium as gym
import numpy as np
import pytest
import stable_baselines3.common.env_checker as sb3_checker
from episode_runs import COMMANDED, ID, IDS, TELEOP, Given, action_table, assert_identical, begin, steps
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from hypothesis import given, settings
from hypothesis import strategies as st
from random_tasks import CHANNEL, FIXED, OBSERVED, OWN, STORM, rows_of_tasks
from refusal import refused
from stable_baselines3.common.vec_env import DummyVecEnv

import impact_gym as ig
from impact_gym.envs.batch import ROWS_PER_THREAD
from impact_gym.envs.objectives import MOImpactApproachVectorEnv
from impact_gym.envs.single import ImpactApproachEnv
from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task.task import ARGUMENTS

MODES = ["NextStep", "SameStep", "Disabled"]
MODE = {"single": "NextStep", "objectives": "SameStep"} | {mode: mode for mode in MODES}
FRONT_ENDS = [*MODE, "stable-baselines3"]
MO_ID = "mo-impact-approach-v0"
HARD = {"scenario": "hard", "time_weight": (0.5, 8.0), "reaction_delay": 0.03}
NOISY = {"range_noise": 0.01, "force_noise": 0.2, "force_bias": 0.1, "deflection_sensor": True, "privileged": True}
UNSURE = {"uplink": CHANNEL, "privileged": True, "force_noise": (0.1, 1.0)}
MORE = {
    "coupling", "range_noise", "range_bias", "range_sensor", "reference_velocity", "operator", "uplink", "downlink",
}  # fmt: skip


def loop_of(front, rows):
    """A loop over single environments, each made from its JSON, of Gymnasium or stable-baselines3."""
    specs = [gym.make(ID, disable_env_checker=True, **options).spec.to_json() for options in rows]
    singles = [partial(gym.make, EnvSpec.from_json(spec)) for spec in specs]
    return SyncVectorEnv(singles, autoreset_mode=MODE[front]) if front in MODE else DummyVecEnv(singles)


def made(front, rows):
    if front == "single":
        return loop_of(front, rows)
    if front == "stable-baselines3":
        return ImpactVecEnv(len(rows), per_slot=rows, threads=1)
    kind = MOImpactApproachVectorEnv if front == "objectives" else ImpactApproachVectorEnv
    return kind(len(rows), autoreset_mode=MODE[front], per_slot=rows, threads=1)


def stepped(front, envs, actions):
    """What a step returns, with its scalar reward; without autoreset also what the reset of ended episodes returns."""
    weight = envs.batch.info()["time_weight"] if isinstance(envs, MOImpactApproachVectorEnv) else None
    returned = envs.step(actions)
    if weight is not None:  # the sum of its vector rewards, weighted
        seen, vectors, *flags, infos = returned
        reward = infos.pop("original_reward")
        assert infos.pop("_original_reward").all()
        weights = [weight, np.ones_like(weight), [task.force_weight for task in envs.batch.tasks]]
        assert np.sum(vectors.T * weights[: envs.reward_dim], axis=0) == pytest.approx(reward, abs=1e-9)
        returned = seen, reward, *flags, infos
    if front == "Disabled" and (ended := returned[2] | returned[3]).any():
        returned += envs.reset(options={"reset_mask": ended})
    return returned


def assert_has(infos, expected):
    """The columns have the values of a loop in all rows that have one; other rows may hold any number."""
    for name, column in expected.items():
        if isinstance(column, dict):
            assert_has(infos[name], column)
        elif not name.startswith("_"):
            rows = expected[f"_{name}"]
            assert name not in COMMANDED or (infos[f"_{name}"] == rows).all()
            assert infos[f"_{name}"][rows].all()
            assert_identical((name, infos[name][rows].tolist()), (name, column[rows].tolist()))


def assert_alike(returned, expected, exact):
    """A step of a front end is identical to that of its loop; with other tasks in other rows up to unused numbers."""
    if isinstance(returned[-1], dict) and not exact:
        assert [name for name in COMMANDED if name in returned[4] and name not in expected[4]] == []
        for place in range(4, len(expected), 2):  # of infos
            assert_has(returned[place], expected[place])
        returned, expected = (each[:4] + each[5:6] for each in (returned, expected))
    elif isinstance(returned[-1], list):
        for info, ended in zip(expected[-1], expected[2], strict=True):
            if not ended:
                del info["TimeLimit.truncated"]  # a loop has it in every step
    assert_identical(returned, expected)


def twin_of(envs, twin, fresh, actions):
    """A copy of a front end. The original then takes a step, which must not affect the copy."""
    if twin == "state" and hasattr(envs, "get_state"):
        other, state = fresh(), envs.get_state()
        envs.step(actions)
        for _ in range(2):
            other.set_state(state)
            other.step(actions)
        other.set_state(state)
        return other
    other = pickle.loads(pickle.dumps(envs)) if twin == "pickle" else copy.deepcopy(envs)
    envs.step(actions)
    return other


def test_every_argument_of_a_task_is_in_the_strategy():
    assert {*ARGUMENTS} == {*OWN, *OBSERVED, *MORE}


@pytest.mark.parametrize("front", FRONT_ENDS)
@settings(STORM, max_examples=16)
@given(
    rows_of_tasks(), st.booleans(), st.integers(0, 1000), FIXED, st.sampled_from(["itself", "copy", "pickle", "state"])
)
def test_front_end_returns_the_bits_of_a_loop_of_singles(front, rows, equal, seed, fixed, twin):
    """For any tasks and options of the first reset; a copy may replace the front end in the middle of an episode.

    Spaces, masks of infos and types of arrays are compared, too.
    """
    rows = rows[:1] * 3 if equal else rows
    exact = front == "single" or equal
    envs, loop = made(front, rows), loop_of(front, rows)
    assert (envs.observation_space, envs.action_space) == (loop.observation_space, loop.action_space)
    options = [fixed, {}, fixed or {}] if front == "stable-baselines3" and fixed else fixed
    assert_identical(*(begin(each, seed, options) for each in (envs, loop)))
    kept = []
    replaced, actions = twin == "itself", action_table(seed, 125, 3, lean=(-0.6, 0.6), task=rows[0])
    for tick, row in enumerate(actions):
        returned = stepped(front, envs, row)
        kept.append((returned, copy.deepcopy(returned)))
        assert_alike(returned, stepped(front, loop, row), exact)
        if not replaced and tick >= (53 if returned[2].any() else 80):
            envs, replaced = twin_of(envs, twin, partial(made, front, rows), np.ones_like(row)), True
    assert_identical(*(begin(each) for each in (envs, loop)))  # seed and options were of the first reset
    assert_identical(*zip(*kept, strict=True))  # returned arrays are never written again
    if front in MODES:
        assert envs.np_random_seed == loop.np_random_seed
        for number, env in enumerate(loop.envs):
            assert env.unwrapped.sensors() == {name: column[number] for name, column in envs.sensors().items()}


@pytest.mark.parametrize("options", [
    {"force_weight": 0.01}, {"time_weight": (0.5, 8.0), "missed_cost": 3.0}, {"per_slot": [{"force_weight": 0.02}, {}]},
], ids=str)  # fmt: skip
def test_vector_rewards_are_the_unweighted_terms(options):
    envs = gym.make_vec(MO_ID, num_envs=2, autoreset_mode="Disabled", **options).unwrapped
    weights = np.resize([task.force_weight for task in envs.batch.tasks], 2)
    alone = None if "per_slot" in options else gym.make(MO_ID, **options).unwrapped
    assert envs.reward_dim == 2 + any(weights)
    assert envs.reward_space == Box(-np.inf, 0.0, (envs.reward_dim,), np.float64)
    for seed, velocity in product(range(8), (-1.0, 0.0, 1.0)):
        envs.reset(seed=seed)
        action, apart, ended = np.float32([velocity, 1.0]), [], np.array([False])
        while not ended.any():
            _, vectors, ended, *_ = envs.step(np.tile(action, (2, 1)))
            apart.append(vectors)
        row, apart = int(ended.argmax()), np.array(apart)
        info, total = envs.batch.info(row), apart.sum(axis=0)[row]
        terms, count = info["reward_terms"], envs.reward_dim
        expected = [terms["time"], terms["velocity"] + terms["missed"], terms["force"]][:count]
        assert total * [info["time_weight"], 1.0, weights[row]][:count] == pytest.approx(expected, rel=1e-9, abs=1e-12)
        assert not apart[:-1, row, 1:].any()
        assert not apart[:, weights == 0.0, 2:].any()
        assert (total >= envs.reference_point - 1e-12).all()
        if alone and row == 0:
            played = [step[1] for step in steps(alone, Given(repeat(action)), seed)][1:]
            assert_identical(played, [*apart[:, 0]])


def test_results_do_not_depend_on_the_number_of_threads():
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
def test_checkers_of_gymnasium_and_sb3_find_nothing(id, options):
    for name in ("reset", "step"):
        own, theirs = (signature(getattr(kind, name)).parameters for kind in (ImpactApproachEnv, gym.Env))
        assert [(each.name, each.kind) for each in own.values()] == [(each.name, each.kind) for each in theirs.values()]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ig.envs.register()  # a second time, which does nothing
        check_env(gym.make(id, **options).unwrapped, skip_render_check=True)
        sb3_checker.check_env(gym.make(id, **options))
    assert [str(warning.message) for warning in caught] == []


@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version")
def test_mo_gymnasium_weighs_the_rewards_to_the_scalar_one():
    mo_gym = pytest.importorskip("mo_gymnasium")
    for name in (name for name in gym.registry if name.startswith("mo-impact-")):
        scalar = gym.wrappers.TransformReward(mo_gym.make(name), lambda rewards: float(rewards @ [2.0, 1.0]))
        check_env(scalar, skip_render_check=True)
        linear = mo_gym.wrappers.LinearReward(mo_gym.make(name), weight=np.array([2.0, 1.0]))
        linear.reset(seed=0)
        _, reward, _, _, info = linear.step(linear.action_space.sample())
        assert reward == pytest.approx(info["original_reward"])


def test_episode_that_ends_on_the_last_step_has_usual_flags():
    envs, loop = (make("NextStep", [{"max_episode_steps": 75}]) for make in (made, loop_of))
    envs.reset(seed=0), loop.reset(seed=0)
    for _ in range(75):
        result, expected = (each.step(np.float32([[-0.5, 1.0]])) for each in (envs, loop))
    assert result[2].all()
    assert_identical(result[:4], expected[:4])


def test_seeds_and_reset_mask_affect_only_their_slots():
    envs, loop = (make("Disabled", [{}] * 3) for make in (made, loop_of))
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
    envs = gym.make_vec(ID, num_envs=3, autoreset_mode="SameStep", **NOISY)
    envs = gym.make_vec(EnvSpec.from_json(envs.spec.to_json()))
    assert (envs.num_envs, envs.metadata["autoreset_mode"]) == (3, AutoresetMode.SAME_STEP)
    assert_identical(envs.reset(), envs.reset(seed=list(envs.np_random_seed)))


@pytest.mark.parametrize("make", [gym.make, gym.make_vec, ImpactVecEnv])
def test_set_scenario_applies_from_the_next_episode_on(make):
    env = ImpactVecEnv(2, scenario={"distance": 0.2}) if make is ImpactVecEnv else make(ID, scenario={"distance": 0.2})
    bare, other = getattr(env.unwrapped, "envs", env.unwrapped), {"distance": 0.3, "object_mass": (1.0, 1.1)}
    for expected in (0.2, 0.3, 0.3):
        begin(env, seed=0)
        env.unwrapped.set_scenario(other)
        scenario = (bare.episode_info() if make is gym.make else bare.batch.info(0))["scenario"]
        assert (scenario["distance"], 1.0 <= scenario["object_mass"] <= 1.1) == (expected, expected == 0.3)
    if make is ImpactVecEnv:
        env.env_method("set_scenario", {"distance": 0.4})
        env.reset()
        assert bare.batch.info(0)["scenario"]["distance"] == 0.4
        assert (env.get_attr("render_mode"), env.env_is_wrapped(gym.Wrapper)) == ([None] * 2, [False] * 2)
        refused(lambda: env.env_method("set_scenario", "hard", indices=[0]), "set_scenario", "indices", "[0]")
        assert env.env_method("sensors") == [{name: of[row] for name, of in bare.sensors().items()} for row in (0, 1)]
        with pytest.raises(IndexError, match="size 2"):
            env.get_attr("render_mode", 2)
