"""Pickles and Gymnasium's workers in other processes, arrays that are handed out, wrappers, and learning by rl_zoo3."""

import copy
import importlib.util
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
from episodes import ID, SLOTS, action_table, assert_identical, begin
from gymnasium.wrappers import vector as wrappers
from tasks import EVERYTHING_DRAWN

from impact_gym.sb3 import ImpactVecEnv

EVERYTHING = EVERYTHING_DRAWN["spring"] | {"privileged": True}
KINDS = ["single", "NextStep", "SameStep", "stable"]


def running(kind):
    """An environment in mid-episode."""
    make = {"single": partial(gym.make, ID, record_trace=True), "stable": partial(ImpactVecEnv, SLOTS)}
    env = make.get(kind, partial(gym.make_vec, ID, SLOTS, autoreset_mode=kind))(**EVERYTHING)
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


def wrapped(envs):
    """Gymnasium's wrappers for batches, on top of each other."""
    envs = wrappers.NormalizeReward(wrappers.NormalizeObservation(wrappers.RecordEpisodeStatistics(envs)))
    envs = wrappers.RescaleAction(envs, np.full(2, -0.5, np.float32), np.full(2, 1.5, np.float32))
    return wrappers.DictInfoToList(envs)


def test_wrapped_batch_returns_what_gymnasiums_workers_return_that_import_the_package_by_the_id():
    make, workers = partial(gym.make_vec, num_envs=2, **EVERYTHING), {"context": "spawn", "autoreset_mode": "NextStep"}
    envs = wrapped(make(ID))
    other = wrapped(make(f"impact_gym:{ID}", vectorization_mode="async", vector_kwargs=workers))
    try:
        assert (envs.observation_space, envs.action_space) == (other.observation_space, other.action_space)
        assert_identical(envs.reset(seed=2), other.reset(seed=2))
        ended = 0
        for row in action_table(8, ticks=90, slots=2):
            result, expected = envs.step(row), other.step(row)
            for info in (*result[4], *expected[4]):
                info.get("episode", {}).pop("t", None)  # s, of the clock on the wall
            assert_identical(result, expected)
            ended += sum("episode" in info for info in result[4])
        assert ended > 2
    finally:
        other.close()


ROOT = Path(__file__).parents[2]


def trained_by_rl_zoo3(algorithm, steps, folder):
    """What rl_zoo3 trains with the settings of the documentation: the settings in its file, and its folder."""
    # not imported here: it replaces Gymnasium's TimeLimit by its own
    arguments = (f"-m rl_zoo3.train --algo {algorithm} --env {ID} --gym-packages impact_gym -n {steps} --seed 3 "
                 f"--eval-freq -1 --num-threads 1 --device cpu -conf docs/examples/rl_zoo3-{algorithm}.yml "
                 f"-f {folder}")  # fmt: skip
    subprocess.run([sys.executable, *arguments.split()], cwd=ROOT, check=True, capture_output=True)
    run = folder / algorithm / f"{ID}_1"
    with zipfile.ZipFile(run / f"{ID}.zip") as model:
        return json.loads(model.read("data")), run


WITHOUT_ZOO = pytest.mark.skipif(importlib.util.find_spec("rl_zoo3") is None, reason="rl_zoo3 is not installed")


@WITHOUT_ZOO
@pytest.mark.parametrize(("algorithm", "envs", "steps"), [("sac", 16, 4200), ("td3", 128, 10_400)])
def test_rl_zoo3_takes_the_settings_of_algorithms_with_a_replay_buffer(algorithm, envs, steps, tmp_path):
    settings, _ = trained_by_rl_zoo3(algorithm, steps, tmp_path)
    assert (settings["n_envs"], settings["gamma"], settings["tau"]) == (envs, 1.0, 0.02)
    assert settings["_n_updates"] > 0


@WITHOUT_ZOO
def test_rl_zoo3_trains_from_its_command_line_with_the_set_up_of_the_documentation_and_learns(tmp_path):
    settings, folder = trained_by_rl_zoo3("ppo", 65536, tmp_path)
    assert (settings["n_envs"], settings["num_timesteps"]) == (64, 65536)
    monitors = [np.loadtxt(file, delimiter=",", skiprows=2, ndmin=2) for file in folder.glob("*.monitor.csv")]
    episodes = np.concatenate(monitors)  # return, length, and time (s) by the clock on the wall
    first, *_, last = np.array_split(episodes[episodes[:, 2].argsort(), 0], 8)
    assert last.mean() - first.mean() > 4.0 * (first.var() / len(first) + last.var() / len(last)) ** 0.5
