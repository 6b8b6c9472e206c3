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


def batch(name: str, num_envs: int) -> Step:
    """Return a call that steps the native batch of `gym.make_vec(name)`."""
    return stepping(gym.make_vec(name, num_envs=num_envs, vectorization_mode="vector_entry_point"))


def stable_baselines3(num_envs: int) -> Step:
    """Return a call that steps `ImpactVecEnv`, with the same action everywhere."""
    envs = ImpactVecEnv(num_envs)
    actions = cycle([np.tile(envs.action_space.sample(), (num_envs, 1)) for _ in range(32)])
    return stepping(envs, lambda _: next(actions))


def stepped(quick: bool) -> pl.DataFrame:
    """Return step rates beside Gymnasium's, the best of some rounds in which the environments take turns."""
    batched, rule = gym.make_vec(ID, num_envs=BATCH, rtol=RTOL), PaperTrapezoid()
    steps = [
        (f"{ID}, the paper's rule", BATCH, stepping(batched, lambda last: rule.predict(last[0])[0])),
        (BATCH_SCALE, BATCH, batch(BATCH_SCALE, BATCH)),
        (ID, 1, single(ID)),
        (SCALE, 1, single(SCALE)),
        ("ImpactVecEnv", LEARN_ENVS, stable_baselines3(LEARN_ENVS)),
        *((ID, size, batch(ID, size)) for size in (SIZES[::2] if quick else SIZES)),
    ]
    rounds, seconds = (1, 0.03) if quick else (5, 0.5)
    turns = [
        [rate(step, envs, seconds, rounds=1) for _, envs, step in steps]
        for _ in tqdm(range(rounds), desc="environments")
    ]
    rows = [(name, envs, best) for (name, envs, _), best in zip(steps, np.max(turns, axis=0), strict=True)]
    table = pl.DataFrame(rows, ["environment", "in a batch", "steps per second"], orient="row")
    ratio = pl.col("steps per second").first().over("in a batch") / pl.col("steps per second")
    return table.with_columns(ratio.alias("ours over it"))


def error() -> float:
    """Return the largest error in V_p of a batch of scenarios under the paper's rule, m/s."""
    exact, rough = (
        evaluate(PaperTrapezoid(), VALIDATION_SEED, BATCH, rtol=rtol).object_velocity for rtol in (1e-12, RTOL)
    )
    return float(np.abs(rough - exact).max())


def memory() -> dict[str, float]:
    """Return the bytes that a batch holds for a row, and those that a step allocates for it and lets go."""
    envs: Any = gym.make_vec(ID, num_envs=BATCH).unwrapped
    envs.reset(seed=0)
    held = sum(array.nbytes for array in vars(envs.batch).values() if isinstance(array, np.ndarray))
    actions, skip = np.zeros((BATCH, 2)), np.zeros(BATCH, np.bool_)
    envs.batch.step(actions, skip)
    tracemalloc.start()
    envs.batch.step(actions, skip)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return {"bytes held for a row": held / BATCH, "bytes allocated for it in a step": peak / BATCH}


def measure(quick: bool) -> dict[str, pl.DataFrame]:
    """Return step rates beside Gymnasium's, and the error and the memory of a batch."""
    batch_row = {"rtol": RTOL, "largest error in V_p, µm/s": 1e6 * error(), **memory()}
    return {"Environments": stepped(quick), "The batch": pl.DataFrame([batch_row])}


def training(setup: str, steps: int, threads: int) -> float:
    """Return the steps per second of a training as its set-up has it, with so many threads of torch."""
    loaded = load_setup(setup)
    asked = Run(loaded, replace(loaded.training, steps=steps, threads=threads))
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        run = train(asked, Path(folder) / "run")
        return float(json.loads((run / "metrics.json").read_text())["steps_per_second"])


def three_rates(quick: bool, setups: Sequence[str] = SETUPS) -> dict[str, pl.DataFrame]:
    """Return the three rates of set-ups, with as many environments side by side as their training has."""
    seconds, steps, threads = (0.1, STEPS // 30, {1}) if quick else (3.0, STEPS, {1, len(os.sched_getaffinity(0))})
    rows = []
    for setup in setups:
        count, policy = load_setup(setup).training.envs, load_policy(setup)
        envs = load_setup(setup).make_vec(count)
        ways = {"environment": None, "environment with inference": lambda last, act=policy: act.predict(last[0])[0]}
        row = {name: rate(stepping(envs, act), count, seconds) for name, act in ways.items()}
        row |= {f"training, torch threads: {number}": training(setup, steps, number) for number in sorted(threads)}
        rows.append({"set-up": setup, "environments": count, **row})
    return {"The three rates, steps per second": pl.DataFrame(rows)}
