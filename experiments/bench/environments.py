"""Environments and training: steps per second with everything included, beside Gymnasium's own; what a batch costs.

The rates of batches by size tell how many environments are enough. A set-up has three rates, beside those of CartPole
and Pendulum in batches of the same size. *environment*: Gymnasium's own benchmark, random actions. *environment with
inference*: the set-up's shipped policy acts, beside them one of stable-baselines3. *training*: all that `agents.train`
does from the first rollout to the end, updates and validation included (`metrics.json` has it too), beside them PPO of
stable-baselines3 on the batch that it makes. Random actions play other episodes than a policy, so the first rate need
not be the highest.
"""

import io
import json
import os
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import polars as pl
import torch
from gymnasium.utils.performance import benchmark_vector_step
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from tqdm import tqdm

from agents import load_policy
from agents.baselines import PaperTrapezoid
from agents.evaluate import VALIDATION_SEED, evaluate
from agents.setups import load_setup
from agents.train.ppo import Run, train
from impact_gym.sb3 import ImpactVecEnv

ID, SCALE, BATCH_SCALE, BATCH = "ImpactApproach-v0", "Pendulum-v1", "CartPole-v1", 1024
SIZES = (64, 256, 1024, 4096, 16384)  # environments in a batch
LEARN_ENVS = 512  # environments of a training
SETUPS = ("linear-blind", "bistable-blind")
STEPS = 1_000_000  # of training
RTOL = 1e-6  # of the batch: the largest power of ten with an error in V_p below 1e-6 m/s
MIX = 80  # steps before a measurement: episodes have 20 to 75, and slots begin in step

Step = Callable[[], Any]


def rate(
    call: Step, steps: int, seconds: float, rounds: int = 3, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Return the steps per second of `call`, which makes `steps`: the best of `rounds`, together of `seconds`."""
    best = 0.0
    for _ in range(rounds):
        calls, spent, begun = 0, 0.0, clock()
        while spent < seconds / rounds or calls == 0:
            call()
            calls += 1
            spent = clock() - begun
        best = max(best, calls * steps / spent)
    return best


def stepping(env: Any, act: Callable[[Any], Any] | None = None) -> Step:
    """Return a call that steps `env` by `act` of its last return, at random without it; episodes are in all phases."""
    actions = cycle([env.action_space.sample() for _ in range(32)])  # drawn before time is taken
    last = env.reset()

    def step() -> None:
        nonlocal last
        last = env.step(act(last) if act else next(actions))

    for _ in range(MIX):
        step()
    return step


def single(name: str) -> Step:
    """Return a call that steps `gym.make(name)`; a reset is a step of its own, as in Gymnasium's batches."""
    return stepping(gym.wrappers.Autoreset(gym.make(name)))


def batch(name: str, size: int) -> Step:
    """Return a call that steps the native batch of `gym.make_vec(name)`."""
    return stepping(gym.make_vec(name, num_envs=size, vectorization_mode="vector_entry_point"))


def stepped(quick: bool) -> pl.DataFrame:
    """Return step rates beside Gymnasium's, the best of some rounds in which the environments take turns."""
    batched, rule = gym.make_vec(ID, num_envs=BATCH, rtol=RTOL), PaperTrapezoid()
    of_library = ImpactVecEnv(LEARN_ENVS)
    alike = np.tile(of_library.action_space.sample(), (LEARN_ENVS, 1))  # the same action everywhere
    steps = [
        (f"{ID}, the paper's rule", BATCH, stepping(batched, lambda last: rule.predict(last[0])[0])),
        (BATCH_SCALE, BATCH, batch(BATCH_SCALE, BATCH)),
        (ID, 1, single(ID)),
        (SCALE, 1, single(SCALE)),
        ("ImpactVecEnv", LEARN_ENVS, stepping(of_library, lambda _: alike)),
        *((ID, size, batch(ID, size)) for size in (SIZES[::2] if quick else SIZES)),
    ]
    rounds, seconds = (1, 0.03) if quick else (5, 0.5)
    turns = tqdm(range(rounds), desc="environments")
    rates = np.max([[rate(step, envs, seconds, rounds=1) for _, envs, step in steps] for _ in turns], axis=0)
    rows = [(name, envs, best) for (name, envs, _), best in zip(steps, rates, strict=True)]
    table = pl.DataFrame(rows, ["environment", "in a batch", "steps per second"], orient="row")
    ratio = pl.col("steps per second").first().over("in a batch") / pl.col("steps per second")
    return table.with_columns(ratio.alias("ours over it"))


def measure(quick: bool) -> dict[str, pl.DataFrame]:
    """Return step rates beside Gymnasium's, and the largest error in V_p and the memory of a batch."""
    played = (evaluate(PaperTrapezoid(), VALIDATION_SEED, BATCH, rtol=rtol) for rtol in (1e-12, RTOL))
    exact, rough = (episodes.object_velocity for episodes in played)
    envs: Any = gym.make_vec(ID, num_envs=BATCH).unwrapped
    envs.reset(seed=0)
    held = sum(array.nbytes for array in vars(envs.batch).values() if isinstance(array, np.ndarray))
    actions, skip = np.zeros((BATCH, 2)), np.zeros(BATCH, np.bool_)
    envs.batch.step(actions, skip)
    tracemalloc.start()
    envs.batch.step(actions, skip)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    row = {
        "rtol": RTOL,
        "largest error in V_p, µm/s": 1e6 * float(np.abs(rough - exact).max()),
        "bytes held for a row": held / BATCH,
        "bytes allocated for it in a step": peak / BATCH,
    }
    return {"Environments": stepped(quick), "The batch": pl.DataFrame([row])}


def neighbour(name: str, count: int, quick: bool) -> dict[str, Any]:
    """Return the three rates of one of Gymnasium's environments, in its own batch; see above."""
    mode = "sync" if gym.spec(name).vector_entry_point is None else "vector_entry_point"
    learner = PPO("MlpPolicy", make_vec_env(name, count), n_steps=32, batch_size=4096, n_epochs=4, device="cpu")
    envs = [gym.make_vec(name, count, mode) for _ in range(2)]
    row = rates(name, envs, lambda last: learner.predict(last[0], deterministic=True)[0], quick)
    begun = time.perf_counter()
    learner.learn(2 * count if quick else STEPS // 2)
    return row | {"training, torch threads: 1": learner.num_timesteps / (time.perf_counter() - begun)}


def rates(name: str, envs: Sequence[Any], act: Callable[[Any], Any], quick: bool) -> dict[str, Any]:
    """Return a row with the rates of two batches without training, one for random actions, one that `act` steps."""
    count, seconds = envs[0].num_envs, 0.1 if quick else 3.0
    random: Any = benchmark_vector_step(envs[0], seconds, seed=0)  # type: ignore[arg-type]  # parts of a second, too
    inference = rate(stepping(envs[1], act), count, seconds)
    return {"set-up": name, "environments": count, "environment": random, "environment with inference": inference}


def three_rates(quick: bool, setups: Sequence[str] = SETUPS) -> dict[str, pl.DataFrame]:
    """Return the three rates of set-ups, with as many environments side by side as their training has."""
    steps, threads = (STEPS // 100, {1}) if quick else (STEPS, {1, len(os.sched_getaffinity(0))})
    rows = []
    for name in setups:
        setup, policy = load_setup(name), load_policy(name)
        envs = [setup.make_vec(setup.training.envs) for _ in range(2)]
        row = rates(name, envs, lambda last, act=policy: act.predict(last[0])[0], quick)  # type: ignore[misc]
        for number in sorted(threads):
            asked = Run(setup, replace(setup.training, steps=steps, threads=number))
            with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
                metrics = json.loads((train(asked, Path(folder) / "run") / "metrics.json").read_text())
            row[f"training, torch threads: {number}"] = metrics["steps_per_second"]
        rows.append(row)
    torch.set_num_threads(1)
    rows += [neighbour(name, rows[0]["environments"], quick) for name in (BATCH_SCALE, SCALE)]
    return {"The three rates, steps per second": pl.DataFrame(rows)}
