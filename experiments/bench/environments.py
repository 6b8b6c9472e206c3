"""Environments and training: steps per second with everything included, beside Gymnasium's own; what a batch costs.

The rates of batches by size tell how many environments are enough. A set-up has three rates. *environment*: actions
drawn beforehand. *environment with inference*: the set-up's shipped policy acts. *training*: all that `agents.train`
does from the first rollout to the end, updates and validation included; `metrics.json` has it too. Random actions play
other episodes than a policy, so the first rate need not be the highest.
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


def three_rates(quick: bool, setups: Sequence[str] = SETUPS) -> dict[str, pl.DataFrame]:
    """Return the three rates of set-ups, with as many environments side by side as their training has."""
    seconds, steps, threads = (0.1, STEPS // 100, {1}) if quick else (3.0, STEPS, {1, len(os.sched_getaffinity(0))})
    rows = []
    for name in setups:
        setup, policy = load_setup(name), load_policy(name)
        count = setup.training.envs
        envs = setup.make_vec(count)
        ways = {"environment": None, "environment with inference": lambda last, act=policy: act.predict(last[0])[0]}
        row = {way: rate(stepping(envs, act), count, seconds) for way, act in ways.items()}
        for number in sorted(threads):
            asked = Run(setup, replace(setup.training, steps=steps, threads=number))
            with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
                metrics = json.loads((train(asked, Path(folder) / "run") / "metrics.json").read_text())
            row[f"training, torch threads: {number}"] = metrics["steps_per_second"]
        rows.append({"set-up": name, "environments": count, **row})
    return {"The three rates, steps per second": pl.DataFrame(rows)}
