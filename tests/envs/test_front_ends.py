"""One task behind every front end: each is compared, bit for bit, with Gymnasium's or stable-baselines3's own loop
over single environments.
"""

import copy
import pickle
import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
import stable_baselines3.common.env_checker as sb3_checker
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import NormalizeReward, RecordEpisodeStatistics
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

import impact_gym as ig
from impact_gym.envs import IDS, batch
from impact_gym.sb3 import ImpactVecEnv

ID = "ImpactApproach-v0"
OPTION_SETS = [
    {},
    {"range_noise": 0.01, "time_weight": (0.5, 8.0)},
    {"coupling": {"type": "Rigid"}, "reaction_delay": 0.0, "control_period": 0.011},
    {"scenario": "hard", "reaction_delay": 0.04, "force_weight": 0.01, "tool_mass": 0.3},
    {"coupling": {"type": "Bistable"}, "reaction_delay": (0.0, 0.04), "deflection_sensor": True, "privileged": True},
    {
        "robot": {"type": "Robot", "mass": 5.225, "stiffness": 1.5e5, "damping": 53.75},
        "force_noise": 0.2,
        "force_bias": 0.1,
    },
]
MODES = ["NextStep", "SameStep", "Disabled"]
SLOTS, TICKS = 7, 230


@pytest.fixture
def cut_small(monkeypatch):
    """Small batches are cut for threads too."""
    monkeypatch.setattr(batch, "ROWS_PER_THREAD", 2)


def action_table(seed, slots=SLOTS, ticks=TICKS):
    """Random actions that lean forward, so that slots end at different times, some without a touch."""
    rng = np.random.default_rng(seed)
    lean = rng.uniform(-0.6, 0.6, (1, slots, 1))
    return np.clip(rng.uniform(-1.0, 1.0, (ticks, slots, 2)) + lean, -1.0, 1.0).astype(np.float32)


def sync_vec(slots=SLOTS, mode="NextStep", **options):
    """Gymnasium's own loop over single environments."""
    return gym.make_vec(ID, slots, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options)


def assert_identical(one, other):
    assert data_equivalence(one, other, exact=True), f"{one}\n{other}"


def assert_same_play(envs, reference, seed, actions, mode="NextStep"):
    """Step both with the same actions; returns how many episodes ended."""
    assert_identical(envs.reset(seed=seed), reference.reset(seed=seed))
    ended = 0
    for row in actions:
        result, expected = envs.step(row), reference.step(row)
        assert_identical(result, expected)
        dones = result[2] | result[3]
        ended += dones.sum()
        if mode == "Disabled" and dones.any():
            masks = {"reset_mask": dones.copy()}, {"reset_mask": dones.copy()}
            assert_identical(envs.reset(options=masks[0]), reference.reset(options=masks[1]))
    return ended


EACH_OPTION = [
    {"time_weight": (0.5, 8.0)},
    {"force_weight": 0.01},
    {"reaction_delay": (0.0, 0.05)},
    {"control_period": 0.004},
    {"range_noise": 0.01},
    {"force_noise": 0.5},
    {"force_bias": 0.5},
    {"deflection_sensor": True},
    {"privileged": True},
    {"robot": ig.Robot(5.225, 1.5e5, 53.75)},
    {"record_trace": True},
    {"rtol": 1e-6},
    {"tool_mass": 0.5},
    {"scenario": {"object_mass": 1.0}},
]


@pytest.mark.parametrize(
    ("id", "options"),
    [
        *((id, {}) for id in IDS),
        *((f"impact_gym:{ID}", options) for options in (*OPTION_SETS, *EACH_OPTION)),
    ],
    ids=str,
)
def test_the_checkers_of_gymnasium_and_stable_baselines3_find_nothing(id, options):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(gym.make(id, **options).unwrapped)
        sb3_checker.check_env(gym.make(id, **options))
    assert [str(warning.message) for warning in caught] == []


@pytest.mark.parametrize(
    "options", [*OPTION_SETS, {"coupling": ig.SpringDamper(80.0, 0.5)}, {"coupling": ig.Rigid()}], ids=str
)
def test_a_spec_survives_json(options):
    env = gym.make(ID, **options)
    spec = gym.envs.registration.EnvSpec.from_json(env.spec.to_json())
    again = gym.make(spec)
    again.action_space.seed(0)
    assert_identical(again.reset(seed=3), env.reset(seed=3))
    ended = False
    while not ended:
        action = again.action_space.sample()
        result = again.step(action)
        assert_identical(result, env.step(action))
        ended = result[2]
    envs = gym.make_vec(ID, num_envs=3, autoreset_mode="SameStep", **options)
    again = gym.make_vec(gym.envs.registration.EnvSpec.from_json(envs.spec.to_json()))
    assert again.num_envs == 3
    assert again.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert_identical(again.reset(seed=3), envs.reset(seed=3))


def test_importing_twice_registers_once():
    spec = gym.registry[ID]
    ig.envs.register()
    assert gym.registry[ID] is spec


@pytest.mark.usefixtures("cut_small")
@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("options", OPTION_SETS, ids=str)
def test_the_native_batch_equals_gymnasiums_loop_over_single_environments(options, mode, threads):
    envs = gym.make_vec(ID, num_envs=SLOTS, autoreset_mode=mode, threads=threads, **options)
    assert envs.metadata["autoreset_mode"] is AutoresetMode(mode)
    ended = assert_same_play(envs, sync_vec(mode=mode, **options), 17, action_table(1), mode)
    assert ended > 2 * SLOTS


@pytest.mark.parametrize("mode", MODES)
def test_the_native_batch_truncates_as_the_time_limit_of_gymnasium_does(mode):
    envs = gym.make_vec(ID, num_envs=SLOTS, autoreset_mode=mode, max_episode_steps=40)
    reference = sync_vec(mode=mode, max_episode_steps=40)
    assert_identical(envs.reset(seed=5)[0], reference.reset(seed=5)[0])
    counts = np.zeros(2, int)
    for row in action_table(2):
        result, expected = envs.step(row), reference.step(row)
        assert_identical(result[:3], expected[:3])
        dones = result[2] | result[3]
        assert_identical(dones, expected[2] | expected[3])
        counts += [result[2].sum(), result[3].sum()]
        if mode == "SameStep" and dones.any():
            for key in ("final_obs", "_final_obs"):
                assert_identical(result[4][key], expected[4][key])
        if mode == "Disabled" and dones.any():
            options = {"reset_mask": dones}, {"reset_mask": dones.copy()}
            assert_identical(envs.reset(options=options[0]), reference.reset(options=options[1]))
    assert counts.min() >= 3


def test_an_episode_that_ends_by_itself_on_the_last_step_allowed_is_flagged_as_by_gymnasium():
    stand_still = np.float32([[-0.5, 1.0]])
    envs, reference = gym.make_vec(ID, max_episode_steps=75), sync_vec(1, max_episode_steps=75)
    envs.reset(seed=0), reference.reset(seed=0)
    for _ in range(75):
        result, expected = envs.step(stand_still), reference.step(stand_still)
    assert result[2].all()
    assert_identical(result[:4], expected[:4])


@pytest.mark.parametrize("kind", ["vector", "stable", "single"])
def test_the_final_info_of_a_truncated_episode_has_its_entries_too(kind):
    """They are what the episode has come to so far: the cost of time alone, and no V_p of the future."""
    actions = action_table(3, slots=1, ticks=4)
    if kind == "vector":
        env = gym.make_vec(ID, num_envs=1, max_episode_steps=4, autoreset_mode="Disabled")
        env.reset(seed=0)
        *_, (_, _, _, truncated, infos) = [env.step(row) for row in actions]
        info = {name: value if isinstance(value, dict) else value[0] for name, value in infos.items()}
        info["reward_terms"] = {name: value[0] for name, value in infos["reward_terms"].items() if name[0] != "_"}
    elif kind == "stable":
        env = ImpactVecEnv(1, max_episode_steps=4)
        env.seed(0)
        env.reset()
        *_, (_, _, truncated, (info,)) = [env.step(row) for row in actions]
        assert info["TimeLimit.truncated"] is True
    else:
        env = gym.make(ID, max_episode_steps=4)
        env.reset(seed=0)
        *_, (_, _, _, truncated, _) = [env.step(row[0]) for row in actions]
        info = env.unwrapped.episode_info()  # TimeLimit does not tell the environment
    assert truncated
    names = ("object_velocity", "approach_time", "peak_force", "contact_count", "missed", "reward_terms", "scenario")
    assert set(names) <= set(info)
    assert (info["contact_count"], info["object_velocity"], info["peak_force"]) == (0, 0.0, 0.0)
    assert sum(info["reward_terms"].values()) == pytest.approx(-2.0 * 4 * 0.016, rel=1e-12)


def test_a_list_of_seeds_and_a_reset_mask_reach_exactly_the_slots_they_name():
    envs, reference = gym.make_vec(ID, num_envs=3, autoreset_mode="Disabled"), sync_vec(3, "Disabled")
    actions = action_table(4, slots=3, ticks=10)
    seeds = [30, 8, 30]
    first, _ = envs.reset(seed=seeds)
    assert_identical(first, reference.reset(seed=seeds)[0])
    for row in actions:
        assert_identical(envs.step(row), reference.step(row))
    mask = np.array([False, True, False])
    for seed in (None, [None, 30, None], 29, None):
        before = envs.step(actions[0])[0]
        assert_identical(before, reference.step(actions[0])[0])
        options = {"scenario": {"distance": 0.3}}
        after, _ = envs.reset(seed=seed, options={**options, "reset_mask": mask})
        assert_identical(after, reference.reset(seed=seed, options={**options, "reset_mask": mask.copy()})[0])
        assert np.array_equal(after[~mask], before[~mask])
    for row in action_table(5, slots=3, ticks=30):
        result = envs.step(row)
        assert_identical(result, reference.step(row))
        if result[2].any():
            break


def test_a_slot_that_was_never_reset_cannot_be_stepped():
    envs = gym.make_vec(ID, num_envs=2)
    with pytest.raises((RuntimeError, gym.error.ResetNeeded), match="reset"):
        envs.step(np.zeros((2, 2), np.float32))
    envs.reset(seed=0, options={"reset_mask": np.array([True, False])})
    with pytest.raises((RuntimeError, gym.error.ResetNeeded), match="reset"):
        envs.step(np.zeros((2, 2), np.float32))


def test_without_autoreset_an_ended_slot_must_be_reset_first():
    envs = gym.make_vec(ID, num_envs=2, autoreset_mode="Disabled", max_episode_steps=2)
    envs.reset(seed=0)
    action = np.zeros((2, 2), np.float32)
    envs.step(action)
    assert envs.step(action)[3].all()
    envs.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(gym.error.ResetNeeded, match="reset_mask"):
        envs.step(action)
    envs.reset(options={"reset_mask": np.array([False, True])})
    assert not envs.step(action)[3].any()


@pytest.mark.usefixtures("cut_small")
@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("options", [*OPTION_SETS, {"max_episode_steps": 29}], ids=str)
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
        for row in action_table(6)[:90]:
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
        found = [None] * 3
        while None in found:
            for slot, info in enumerate(each.step(action)[3]):
                if found[slot] is None and "scenario" in info:
                    found[slot] = info["scenario"]["distance"]
        assert found == distances


def test_stable_baselines3_can_ask_and_change_the_batch():
    envs = ImpactVecEnv(3)
    assert envs.get_attr("render_mode") == [None] * 3
    assert envs.env_is_wrapped(gym.Wrapper) == [False] * 3
    with pytest.raises(ValueError, match="indices"):
        envs.env_method("set_scenario", "hard", indices=[0])
    envs.env_method("set_scenario", {"distance": 0.26})
    envs.seed(0)
    envs.reset()
    found = set()
    while len(found) < 1:
        found |= {info["scenario"]["distance"] for info in envs.step(np.full((3, 2), 0.5, np.float32))[3] if info}
    assert found == {0.26}


def arrays_in(value):
    """Every array of numbers in nested dicts, lists, tuples and arrays of objects."""
    if isinstance(value, np.ndarray) and value.dtype != object:
        return [value]
    if isinstance(value, dict):
        return [array for item in value.values() for array in arrays_in(item)]
    if isinstance(value, (list, tuple, np.ndarray)):
        return [array for item in value for array in arrays_in(item)]
    return []


@pytest.mark.parametrize("kind", ["single", "vector", "stable"])
def test_returned_arrays_are_never_used_again(kind):
    makers = {
        "single": lambda: gym.make(ID),
        "vector": lambda: gym.make_vec(ID, num_envs=2, autoreset_mode="SameStep"),
        "stable": lambda: ImpactVecEnv(2),
    }
    env = makers[kind]()
    action = np.full(2, 0.5, np.float32) if kind == "single" else np.full((2, 2), 0.5, np.float32)

    def go_on():
        history = []
        for _ in range(60):
            history.append(env.step(action))
            if kind == "single" and history[-1][2]:
                history.append(env.reset())
        return history

    returned = [env.reset(), *go_on()]
    snapshot = copy.deepcopy(returned)
    go_on()
    assert_identical(returned, snapshot)
    arrays = arrays_in(returned)
    assert len(arrays) > 60
    assert len({array.__array_interface__["data"][0] for array in arrays}) == len(arrays)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_gymnasiums_vector_wrappers_count_the_episodes_of_the_native_batch(mode):
    envs = RecordEpisodeStatistics(gym.make_vec(ID, num_envs=SLOTS, autoreset_mode=mode))
    envs.reset(seed=2)
    ended = 0
    for row in action_table(7):
        _, _, terminated, _, infos = envs.step(row)
        if terminated.any():
            final = infos["final_info"] if mode == "SameStep" else infos
            terms = sum(value for name, value in final["reward_terms"].items() if name[0] != "_")
            assert infos["episode"]["r"][terminated] == pytest.approx(terms[terminated], rel=1e-12)
            assert np.all((infos["episode"]["l"][terminated] >= 20) & (infos["episode"]["l"][terminated] <= 85))
            ended += terminated.sum()
    assert envs.episode_count == ended > 2 * SLOTS


def test_normalised_rewards_of_the_native_batch_are_those_of_gymnasiums_loop():
    envs, reference = NormalizeReward(gym.make_vec(ID, num_envs=SLOTS)), NormalizeReward(sync_vec())
    assert assert_same_play(envs, reference, 9, action_table(8)[:100]) > 0


def test_the_monitor_of_stable_baselines3_sums_the_reward_terms():
    envs = VecMonitor(ImpactVecEnv(SLOTS))
    envs.seed(0)
    envs.reset()
    ended = 0
    for row in action_table(9)[:100]:
        for info in envs.step(row)[3]:
            if info:
                ended += 1
                assert info["episode"]["r"] == pytest.approx(sum(info["reward_terms"].values()), rel=1e-6)
    assert ended > SLOTS


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"])
@pytest.mark.parametrize("kind", ["single", "vector", "stable"])
def test_a_copy_made_in_mid_episode_goes_on_identically_and_alone(kind, twin):
    options = {"range_noise": 0.01, "reaction_delay": 0.04}
    actions = action_table(10, slots=3)[:150]
    if kind == "single":
        env, actions = gym.make(ID, **options), actions[:, 0]
        env.reset(seed=1)
    elif kind == "vector":
        env = gym.make_vec(ID, num_envs=3, **options)
        env.reset(seed=1)
    else:
        env = ImpactVecEnv(3, **options)
        env.seed(1)
        env.reset()

    def go_on(one, actions):
        history = []
        for action in actions:
            history.append(one.step(action))
            if kind == "single" and history[-1][2]:
                history.append(one.reset())
        return history

    go_on(env, actions[:18])
    other = twin(env)
    history = go_on(env, actions[18:])
    assert_identical(go_on(other, actions[18:]), history)


def test_worker_processes_started_afresh_know_the_environment():
    envs = gym.make_vec(f"impact_gym:{ID}", 2, vectorization_mode="async", vector_kwargs={"context": "spawn"})
    try:
        assert assert_same_play(envs, gym.make_vec(ID, num_envs=2), 4, action_table(11, slots=2)[:80]) > 0
    finally:
        envs.close()


def test_the_same_seed_gives_the_same_episode_in_another_process():
    code = (
        "import gymnasium as gym, numpy as np; env = gym.make('impact_gym:ImpactApproach-v0', range_noise=0.01)\n"
        "env.reset(seed=6); ended = False\n"
        "while not ended: o, r, ended, _, info = env.step(np.float32([0.4, 0.1]))\n"
        "print(o.tobytes().hex(), r.hex(), info)"
    )
    env = gym.make(ID, range_noise=0.01)
    env.reset(seed=6)
    ended = False
    while not ended:
        observation, reward, ended, _, info = env.step(np.float32([0.4, 0.1]))
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert printed.strip() == f"{observation.tobytes().hex()} {reward.hex()} {info}"
