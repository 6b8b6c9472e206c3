"""One task behind every front end, with any number of threads: each gives the bits of the single environment."""

import copy
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.util import find_spec
from itertools import product, repeat
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import solver_scenes
import stable_baselines3.common.env_checker as sb3_checker
from episode_runs import COMMANDED, ID, IDS, TELEOP, Given, action_table, assert_identical, begin, steps
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv
from hypothesis import given, settings
from hypothesis import strategies as st
from random_tasks import CHANNEL, LIMITS, OBSERVED, OWN, STORM, rows_of_tasks
from stable_baselines3.common.save_util import load_from_zip_file
from stable_baselines3.common.vec_env import DummyVecEnv

import impact_gym as ig
from experiments.studies import stock
from impact_gym.envs.batch import ROWS_PER_THREAD
from impact_gym.envs.objectives import MOImpactApproachVectorEnv
from impact_gym.envs.vector import ImpactApproachVectorEnv
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task.task import ARGUMENTS

MODES = ["NextStep", "SameStep", "Disabled"]
MODE = {"single": "NextStep", "objectives": "SameStep"} | {mode: mode for mode in MODES}
HARD = {"scenario": "hard", "time_weight": (0.5, 8.0), "reaction_delay": 0.03}
NOISY = {"range_noise": 0.01, "force_noise": 0.2, "force_bias": 0.1, "deflection_sensor": True, "privileged": True}
UNSURE = {"uplink": CHANNEL, "privileged": True, "force_noise": (0.1, 1.0)}
TWINS = st.sampled_from(["itself", "copy", "pickle", "state"])
FIXED = st.sampled_from([  # options of a reset
    None, {"scenario": {"distance": 0.1}},
    {"record": {"restitution": 0.5, "noise_seed": 7.0}, "scenario": {"object_mass": 0.3}},
])  # fmt: skip


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
        assert not vectors[[task.force_weight == 0.0 for task in envs.batch.tasks], 2:].any()
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
        other.set_state(state)
        other.step(actions)  # must not change the state
        other.set_state(state)
        return other
    other = pickle.loads(pickle.dumps(envs)) if twin == "pickle" else copy.deepcopy(envs)
    envs.step(actions)
    return other


def test_every_argument_of_a_task_is_in_the_strategy():
    several = {"coupling", "range_noise", "range_bias", "range_sensor", "operator", "uplink", "downlink"}
    assert {*ARGUMENTS} == {*OWN, *OBSERVED, *LIMITS, *several, "reference_velocity"}


@pytest.mark.parametrize("front", [*MODE, "stable-baselines3"])
@settings(STORM, max_examples=14)
@given(rows_of_tasks(), st.booleans(), st.integers(0, 1000), FIXED, TWINS)
def test_front_end_returns_the_bits_of_a_loop_of_singles(front, rows, equal, seed, fixed, twin):
    """For any tasks and options of the first reset; a copy may replace the front end in the middle of an episode."""
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


@pytest.mark.parametrize("options", [{"force_weight": 0.01}, {"time_weight": (0.5, 8.0), "missed_cost": 3.0}], ids=str)
def test_vector_rewards_are_time_v_p_or_miss_and_force(options):
    env = gym.make("mo-impact-approach-v0", **options).unwrapped
    assert env.reward_dim == 2 + ("force_weight" in options)
    assert env.reward_space == Box(-np.inf, 0.0, (env.reward_dim,), np.float64)
    for seed, velocity in product(range(8), (-1.0, 0.0, 1.0)):
        apart = [step[1] for step in steps(env, Given(repeat(np.float32([velocity, 1.0]))), seed)][1:]
        info, total = env.episode_info(), np.sum(apart, axis=0)
        ends = (0.0, env.task.missed_cost) if info["missed"] else (info["peak_force"], info["object_velocity"])
        expected = [info["approach_time"], *ends[::-1]][: env.reward_dim]
        assert -total == pytest.approx(expected, rel=1e-12)
        assert not np.array(apart)[:-1, 1:].any()
        assert (total >= env.reference_point - 1e-12).all()


@pytest.mark.parametrize(("id", "options"), [
    *product(IDS, ({}, HARD)), (f"impact_gym:{ID}", NOISY), *product([TELEOP], ({}, UNSURE)),
], ids=str)  # fmt: skip
def test_checkers_of_gymnasium_and_sb3_find_nothing(id, options):
    ig.envs.register()  # a second time, which does nothing
    check_env(gym.make(id, **options).unwrapped, skip_render_check=True)  # in tests, each warning is an error
    sb3_checker.check_env(gym.make(id, **options))


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


def test_attributes_and_methods_of_slots_are_those_of_a_loop():
    rows = [{"tool_mass": 0.1}, {"tool_mass": (0.1, 0.2)}, {"time_weight": 3.0}]
    envs, loop = (make("NextStep", rows) for make in (made, loop_of))
    for each in (envs, loop):
        each.reset(seed=4)
        each.call("set_scenario", {"distance": (0.2, 0.21)})
        each.set_attr("level", [1, 2, 3])
        each.set_attr("note", "all")
    for action in action_table(4, 120, 3):
        for each in (envs, loop):
            each.step(action)
        for name in ("episode_info", "sensors", "episode_state"):
            assert_identical(envs.call(name), loop.call(name))
    for name in ("task", "render_mode", "observation_space", "action_space", "level", "note", "np_random_seed"):
        assert envs.get_attr(name) == loop.get_attr(name)
    states = [[generator.random() for generator in each.get_attr("np_random")] for each in (envs, loop)]
    assert states[0] == states[1]
    for each in (envs, loop):
        with pytest.raises(ValueError, match="3"):
            each.set_attr("level", [1, 2])
        with pytest.raises(AttributeError):
            each.get_attr("nothing")
    for call in (partial(envs.call, "reset"), partial(envs.set_attr, "task", 1)):
        with pytest.raises(ValueError, match="must name an attribute"):
            call()


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
    assert_identical(envs.reset()[0], loop.reset()[0])  # each slot goes on with its own generator


def test_returns_that_gymnasium_records_are_those_of_the_episodes():
    envs = gym.wrappers.vector.RecordEpisodeStatistics(gym.make_vec(ID, num_envs=4, autoreset_mode="SameStep"))
    infos = envs.reset(seed=0)[1]
    while "_episode" not in infos:
        infos = envs.step(envs.action_space.sample())[-1]
    terms, ended = infos["final_info"]["reward_terms"], infos["_episode"]
    total = sum(terms[name][ended] for name in ("time", "velocity", "force", "missed"))
    assert infos["episode"]["r"][ended] == pytest.approx(total, rel=1e-6)


def test_set_scenario_applies_from_the_next_episode_on():
    stable, masses = ImpactVecEnv(2), []
    for scenario in ({"object_mass": 3.0}, {"object_mass": (4.0, 5.0)}, {}):
        stable.reset()
        stable.env_method("set_scenario", scenario)
        masses.append(stable.envs.batch.info(1)["scenario"]["object_mass"])
    assert masses[0] < 2.5 < masses[1] == 3.0 < 4.0 <= masses[2] <= 5.0


def test_slots_without_a_horizon_share_the_longest():
    envs = made("NextStep", [{}, {"scenario": {"distance": (0.2, 0.72)}}, {"velocity_range": (-0.5, 1.5)}])
    assert [task.horizon for task in envs.batch.tasks] == [2.4] * 3


def worked(seed, threads):
    """The results of random steps in a batch, and of a scene; each seed has another environment and coupling."""
    name = (ID, "ImpactApproachBistable-v0", TELEOP)[seed % 3]
    envs = gym.make_vec(name, num_envs=2 * ROWS_PER_THREAD + 3, threads=threads, force_noise=0.1)
    rng, kept = np.random.default_rng(seed), [envs.reset(seed=seed)[0]]
    for _ in range(40):
        kept += envs.step(rng.uniform(-0.2, 1.0, envs.action_space.shape))[:4]
    chain = solver_scenes.scene(1e4 * (1 + seed), 0.4, [*solver_scenes.COUPLINGS.values()][seed % 3])
    outcome = ig.simulate(chain, solver_scenes.MOTION, duration=2.0, trace=True)
    return [*kept, outcome.object_velocity, outcome.peak_force, *outcome.trace]


def test_results_do_not_depend_on_threads():
    alone = [worked(seed, 1) for seed in range(6)]
    assert np.sum(alone[0][3:161:4]) > ROWS_PER_THREAD  # episodes that ended
    with ThreadPoolExecutor(6) as pool:
        together = list(pool.map(worked, [*range(6)] * 2, [2] * 6 + [3] * 6))
    assert_identical(together, alone * 2)


@pytest.mark.slow
@pytest.mark.skipif(find_spec("rl_zoo3") is None, reason="rl_zoo3 is not installed")
def test_rl_zoo3_trains_with_the_settings_of_the_study(tmp_path):
    # rl_zoo3 is not imported here: it replaces Gymnasium's TimeLimit by its own
    arguments = (f"-m rl_zoo3.train --algo td3 --env {ID} --gym-packages impact_gym -n 4200 --seed 3 --eval-freq -1 "
                 f"--num-threads 1 --device cpu -conf experiments/studies/stock/td3.yml -f {tmp_path}")  # fmt: skip
    subprocess.run([sys.executable, *arguments.split()], cwd=Path(__file__).parents[2], check=True, capture_output=True)
    used = load_from_zip_file(tmp_path / "td3" / f"{ID}_1" / f"{ID}.zip")[0]
    settings = next(iter(stock.trainings("td3", True, {}))).arguments["settings"]
    names = ("n_envs", "gamma", "batch_size", "learning_starts", "gradient_steps")
    assert [used[name] for name in names] == [settings[name] for name in names]
    assert used["_n_updates"] > 0
