"""Threads of one process, each with environments and scenes of its own: the same bits as one after the other."""

import sys
import warnings
from concurrent.futures import ThreadPoolExecutor

import gymnasium as gym
import numpy as np
import pytest
from episodes import assert_identical
from scenes import COUPLINGS, MOTION, scene

import impact_gym as ig

WORKERS, ROUNDS = 8, 3
IDS = ("ImpactApproach-v0", "ImpactApproachBistable-v0", "ImpactTeleop-v0")


def of_batch(seed):
    """What a batch of another environment for each seed comes to after some steps at random."""
    envs = gym.make_vec(IDS[seed % len(IDS)], num_envs=16, threads=1 + seed % 2)
    rng, kept = np.random.default_rng(seed), [envs.reset(seed=seed)[0]]
    for _ in range(40):
        kept += envs.step(rng.uniform(-0.2, 1.0, envs.action_space.shape))[:4]
    envs.close()
    return kept


def of_scene(seed):
    """What a scene with another stiffness and coupling for each seed comes to."""
    chain = scene(1e4 * (1 + seed), 0.4, [*COUPLINGS.values()][seed % 3])
    outcome = ig.simulate(chain, MOTION, duration=2.0, trace=True)
    return [np.array([outcome.object_velocity, outcome.peak_force]), outcome.trace.time, outcome.trace.contact_force]


@pytest.mark.parametrize("work", [of_batch, of_scene])
def test_threads_do_not_see_each_other(work):
    seeds = list(range(WORKERS))
    alone = list(map(work, seeds))
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(WORKERS) as pool:
            together = list(pool.map(work, seeds * ROUNDS))
    finally:
        sys.setswitchinterval(before)
    assert_identical(together, alone * ROUNDS)


def test_batch_for_stable_baselines3_warns_once_where_torch_takes_more_than_half_of_the_cores():
    sb3 = pytest.importorskip("impact_gym.envs.sb3")
    sb3.warn_of_threads.cache_clear()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for threads, available in ((1, 1), (1, 2), (8, 16)):
            sb3.warn_of_threads(threads, available)
        with pytest.raises(UserWarning, match=r"2 threads on 2 cores.*set_num_threads\(1\)"):
            sb3.warn_of_threads(2, 2)
    with pytest.warns(UserWarning, match="9 threads on 16 cores"):
        sb3.warn_of_threads(9, 16)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb3.warn_of_threads(9, 16)
