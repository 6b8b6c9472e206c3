"""Environments: steps per second with everything included, beside Gymnasium's own, and what a batch costs a row."""

import tracemalloc
from typing import Any

import gymnasium as gym
import numpy as np
import polars as pl
from tqdm import tqdm

from agents.baselines import PaperTrapezoid
from agents.evaluate.stage import VALIDATION_SEED, evaluate
from impact_gym.doctor import BATCH_SCALE, ID, SCALE, batch, rate, single, stepping

BATCH = 1024
RTOL = 1e-6  # of the batch: the largest power of ten with an error in V_p below 1e-6 m/s
SECONDS = 1.0  # of each measurement


def error() -> float:
    """Return the largest error in V_p of a batch of scenarios under the paper's rule, m/s."""
    exact, found = (
        evaluate(PaperTrapezoid(), VALIDATION_SEED, BATCH, rtol=rtol).object_velocity for rtol in (1e-12, RTOL)
    )
    return float(np.abs(found - exact).max())


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
    """Return step rates, the best of some rounds in which the environments take turns, and memory."""
    batched, rule = gym.make_vec(ID, num_envs=BATCH, rtol=RTOL), PaperTrapezoid()
    stepped = [
        (f"{ID}, the paper's rule", BATCH, stepping(batched, lambda last: rule.predict(last[0])[0])),
        (BATCH_SCALE, BATCH, batch(BATCH_SCALE, BATCH)),
        (ID, 1, single(ID)),
        (SCALE, 1, single(SCALE)),
    ]
    turns = [
        [rate(step, envs, SECONDS, rounds=1) for _, envs, step in stepped]
        for _ in tqdm(range(1 if quick else 5), desc="environments")
    ]
    rates = pl.DataFrame([(name, envs) for name, envs, _ in stepped], ["environment", "in a batch"], orient="row")
    steps = pl.Series("steps per second", np.max(turns, axis=0))
    ratio = pl.col(steps.name).first().over("in a batch") / pl.col(steps.name)
    return {
        "Environments": rates.with_columns(steps).with_columns(ratio.alias("ours over it")),
        "The batch": pl.DataFrame([{"rtol": RTOL, "largest error in V_p, µm/s": 1e6 * error(), **memory()}]),
    }
