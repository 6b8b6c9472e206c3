"""Pickles in other processes, Gymnasium's workers and vector wrappers, learning by stable-baselines3 and rl_zoo3."""

import copy
import csv
import importlib.util
import io
import json
import pickle
import subprocess
import sys
import zipfile
from functools import partial
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from episodes import ID, SLOTS, action_table, assert_identical, begin
from gymnasium.wrappers import vector as vector_wrappers
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize
from tasks import EVERYTHING_DRAWN

from impact_gym.sb3 import ImpactVecEnv

EVERYTHING = EVERYTHING_DRAWN["spring"] | {"privileged": True}
KINDS = ["single", "NextStep", "SameStep", "stable"]


def running(kind):
    """An environment in mid-episode."""
    if kind == "single":
        env = gym.make(ID, record_trace=True, **EVERYTHING)
    elif kind == "stable":
        env = ImpactVecEnv(SLOTS, **EVERYTHING)
    else:
        env = gym.make_vec(ID, num_envs=SLOTS, autoreset_mode=kind, **EVERYTHING)
    begin(env, seed=1)
    go_on(env, action_table(4)[:19])
    return env


def go_on(env, rows):
    """Step through further episodes; what happened."""
    history = []
    for row in rows:
        history.append(env.step(row[0] if isinstance(env, gym.Env) else row))
        if isinstance(env, gym.Env) and history[-1][2]:
            trace = env.unwrapped.trace()
            history += [[getattr(trace, name) for name in trace.__slots__], env.reset()]
    return history


def test_pickle_goes_on_identically_in_a_process_that_never_imported_the_package(tmp_path):
    file, rows = tmp_path / "running.pickle", action_table(7, ticks=60)
    envs = running("NextStep")
    file.write_bytes(pickle.dumps((envs, rows)))
    code = ("import pickle, sys\nenvs, rows = pickle.load(open(sys.argv[1], 'rb'))\npickle.dump([envs.step(row) for "
            "row in rows], open(sys.argv[2], 'wb'))\n")  # fmt: skip
    subprocess.run([sys.executable, "-c", code, file, tmp_path / "history"], check=True)
    with (tmp_path / "history").open("rb") as history:
        assert_identical(pickle.load(history), [envs.step(row) for row in rows])


def arrays_in(value):
    """Every array of numbers in nested dicts, lists, tuples and arrays of objects."""
    if isinstance(value, np.ndarray) and value.dtype != object:
        return [value]
    if isinstance(value, dict):
        return [array for item in value.values() for array in arrays_in(item)]
    if isinstance(value, (list, tuple, np.ndarray)):
        return [array for item in value for array in arrays_in(item)]
    return []


@pytest.mark.parametrize("kind", KINDS)
def test_arrays_that_were_returned_are_never_used_again(kind):
    env = running(kind)
    returned = [begin(env), *go_on(env, action_table(9)[:60])]
    snapshot = copy.deepcopy(returned)
    go_on(env, action_table(10)[:60])
    assert_identical(returned, snapshot)
    arrays = arrays_in(returned)
    assert len(arrays) > 60
    assert len({array.__array_interface__["data"][0] for array in arrays}) == len(arrays)


def test_workers_of_gymnasium_give_what_the_native_batch_gives():
    """Also that the same seed gives the same episode in another process, which first imports the package by the id."""
    options = {"context": "spawn", "autoreset_mode": "NextStep"}
    envs = gym.make_vec(f"impact_gym:{ID}", 2, vectorization_mode="async", vector_kwargs=options, **EVERYTHING)
    native = gym.make_vec(ID, num_envs=2, **EVERYTHING)
    try:
        assert_identical(envs.reset(seed=2), native.reset(seed=2))
        ended = 0
        for row in action_table(8, ticks=90, slots=2):
            result = envs.step(row)
            assert_identical(result, native.step(row))
            ended += result[2].sum()
        assert ended > 2
    finally:
        envs.close()


@pytest.mark.parametrize("wrap", [
    vector_wrappers.NormalizeReward, vector_wrappers.NormalizeObservation, vector_wrappers.DictInfoToList,
    partial(vector_wrappers.RescaleAction, min_action=np.full(2, -0.5, np.float32),
            max_action=np.full(2, 1.5, np.float32)),
    vector_wrappers.RecordEpisodeStatistics,
], ids=["rewards", "observations", "list", "rescaled", "statistics"])  # fmt: skip
def test_vector_wrapper_does_to_the_native_batch_what_it_does_to_gymnasiums_loop(wrap):
    wrapped, other = wrap(gym.make_vec(ID, SLOTS)), wrap(gym.make_vec(ID, SLOTS, vectorization_mode="sync"))
    assert (wrapped.observation_space, wrapped.action_space) == (other.observation_space, other.action_space)
    assert_identical(wrapped.reset(seed=8), other.reset(seed=8))
    ended = 0
    for row in action_table(2):
        result, expected = wrapped.step(row), other.step(row)
        for returned in (result, expected):
            if "episode" in returned[4]:
                del returned[4]["episode"]["t"]  # s, of the clock on the wall
        assert_identical(result, expected)
        ended += result[2].sum()
    assert ended > SLOTS


OPTIONS = {"scenario": "hard", "time_weight": (0.5, 8.0), "reaction_delay": 0.03}
ROOT = Path(__file__).parents[2]
CONFIGURATION = ROOT / "docs" / "examples" / "rl_zoo3.yml"


@pytest.fixture
def one_thread():
    """Torch is left as it was."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("one_thread")
def test_ppo_learns_from_the_batch_behind_the_wrappers_of_stable_baselines3():
    envs = VecNormalize(VecMonitor(ImpactVecEnv(SLOTS, **OPTIONS), info_keywords=("reward_terms",)), gamma=1.0)
    model = PPO("MlpPolicy", envs, n_steps=64, batch_size=64, n_epochs=2, gamma=1.0, seed=0, device="cpu")
    start = [parameter.detach().clone() for parameter in model.policy.parameters()]
    model.learn(768)
    assert model.num_timesteps == 768
    assert any(not torch.equal(before, after) for before, after in zip(start, model.policy.parameters(), strict=True))
    assert len(model.ep_info_buffer) > SLOTS
    for episode in model.ep_info_buffer:  # before normalisation, as in the final info
        assert episode["r"] == pytest.approx(sum(episode["reward_terms"].values()), rel=1e-6)
        assert 20 <= episode["l"] <= 80
    envs.training = False
    mean, deviation = envs.obs_rms.mean, np.sqrt(envs.obs_rms.var + envs.epsilon)
    observations, raw = envs.reset(), envs.get_original_obs()
    assert observations == pytest.approx(np.clip((raw - mean) / deviation, -10, 10), abs=1e-5)
    assert np.all(np.abs(raw) <= 1.0)


@pytest.mark.skipif(importlib.util.find_spec("rl_zoo3") is None, reason="rl_zoo3 is not installed; see docs/examples")
def test_rl_zoo3_trains_from_its_command_line(tmp_path):
    # not imported here: it replaces Gymnasium's TimeLimit by its own
    arguments = (f"-m rl_zoo3.train --algo ppo --env {ID} --gym-packages impact_gym -n 32768 --seed 3 --eval-freq -1 "
                 f"--num-threads 1 --device cpu -conf {CONFIGURATION.relative_to(ROOT)} -f {tmp_path}")  # fmt: skip
    subprocess.run([sys.executable, *arguments.split()], cwd=ROOT, check=True, capture_output=True)
    folder = tmp_path / "ppo" / f"{ID}_1"
    with zipfile.ZipFile(folder / f"{ID}.zip") as model:
        settings = json.loads(model.read("data"))
        weights = torch.load(io.BytesIO(model.read("policy.pth")), weights_only=True)
    assert (settings["n_envs"], settings["num_timesteps"]) == (64, 32768)
    layers = [tuple(each.shape) for name, each in weights.items() if "policy_net" in name or name.startswith("action")]
    assert layers == [(64, 8), (64,), (64, 64), (64,), (2, 64), (2,)]
    episodes = []
    for file in folder.glob("*.monitor.csv"):
        with file.open() as lines:
            episodes += list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert len(episodes) >= 64
    numbers = np.array([[float(episode[name]) for name in "trl"] for episode in episodes])
    returns, lengths = numbers[numbers[:, 0].argsort(), 1:].T
    assert 20 <= lengths.min() < lengths.max() <= 80
    assert -6.0 < returns.min() < returns.max() < 0.0
    first, *_, last = np.array_split(returns, 8)  # by the clock on the wall
    assert last.mean() - first.mean() > 4.0 * (first.var() / len(first) + last.var() / len(last)) ** 0.5
