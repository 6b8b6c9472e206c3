"""Use beside other software: threads, and training by rl_zoo3."""

import importlib.util
import json
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import ID, assert_identical
from solver_scenes import COUPLINGS, MOTION, scene

import impact_gym as ig
from experiments.studies import stock
from impact_gym.envs.batch import ROWS_PER_THREAD

ROOT = Path(__file__).parents[2]


@pytest.mark.skipif(importlib.util.find_spec("rl_zoo3") is None, reason="rl_zoo3 is not installed")
@pytest.mark.parametrize(
    "algorithm", [name if name == "td3" else pytest.param(name, marks=pytest.mark.slow) for name in stock.ALGORITHMS]
)
def test_rl_zoo3_trains_with_the_settings_of_the_study(algorithm, tmp_path):
    # rl_zoo3 is not imported here: it replaces Gymnasium's TimeLimit by its own
    arguments = (f"-m rl_zoo3.train --algo {algorithm} --env {ID} --gym-packages impact_gym -n 4200 --seed 3 "
                 f"--eval-freq -1 --num-threads 1 --device cpu -conf experiments/studies/stock/{algorithm}.yml "
                 f"-f {tmp_path}")  # fmt: skip
    subprocess.run([sys.executable, *arguments.split()], cwd=ROOT, check=True, capture_output=True)
    with zipfile.ZipFile(tmp_path / algorithm / f"{ID}_1" / f"{ID}.zip") as model:
        used = json.loads(model.read("data"))
    assert used["_n_updates"] > 0
    expected = next(iter(stock.trainings(algorithm, True, {}))).arguments["settings"]
    names = {"n_envs", "gamma", "batch_size", "learning_starts", "gradient_steps", "n_epochs"} & {*expected}
    assert {name: used[name] for name in names} == {name: expected[name] for name in names}


IDS = ("ImpactApproach-v0", "ImpactApproachBistable-v0", "ImpactTeleop-v0")


def worked(seed, threads):
    """The results of random steps in a batch, and of a scene; each seed has another environment and coupling."""
    envs = gym.make_vec(IDS[seed % len(IDS)], num_envs=2 * ROWS_PER_THREAD + 3, threads=threads, force_noise=0.1)
    rng, kept = np.random.default_rng(seed), [envs.reset(seed=seed)[0]]
    for _ in range(40):
        kept += envs.step(rng.uniform(-0.2, 1.0, envs.action_space.shape))[:4]
    chain = scene(1e4 * (1 + seed), 0.4, [*COUPLINGS.values()][seed % 3])
    outcome = ig.simulate(chain, MOTION, duration=2.0, trace=True)
    return [*kept, outcome.object_velocity, outcome.peak_force, *outcome.trace]


def test_results_do_not_depend_on_threads():
    alone, before = [worked(seed, 1) for seed in range(6)], sys.getswitchinterval()
    assert np.sum(alone[0][3:161:4]) > ROWS_PER_THREAD  # episodes that ended
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(6) as pool:
            together = list(pool.map(worked, [*range(6)] * 2, [2] * 6 + [3] * 6))
    finally:
        sys.setswitchinterval(before)
    assert_identical(together, alone * 2)


def test_sb3_warns_once_if_torch_uses_over_half_of_the_cores():
    sb3 = pytest.importorskip("impact_gym.sb3")
    sb3.warn_of_threads.cache_clear()
    with pytest.warns(UserWarning, match=r"9 threads on 16 cores.*set_num_threads\(1\)"):
        sb3.warn_of_threads(9, 16)
    for threads, available in ((9, 16), (1, 1), (1, 2), (8, 16)):  # warnings are errors
        sb3.warn_of_threads(threads, available)
