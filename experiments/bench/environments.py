"""Environments: steps a second with everything included, beside Gymnasium's own, and what a batch costs a row."""

import tracemalloc
from collections.abc import Callable
from itertools import cycle
from typing import Any

import gymnasium as gym
import numpy as np

from agents.baselines import PaperTrapezoid
from agents.evaluate.stage import VALIDATION_SEED, evaluate

BATCH = 1024
SIZES = (64, 256, 1024, 4096, 16384, 65536)
ERROR = 1e-6  # m/s in V_p
RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


def cheapest_tolerance() -> tuple[float, float]:
    """Return the largest `rtol` with an error in V_p of at most ERROR in each of 1,024 scenarios, and the error."""
    rtols = (1e-12, *RTOLS)
    exact, *found = (evaluate(PaperTrapezoid(), VALIDATION_SEED, BATCH, rtol=r).object_velocity for r in rtols)
    errors = [float(np.abs(velocities - exact).max()) for velocities in found]
    return next((found for found in zip(RTOLS, errors, strict=True) if found[1] <= ERROR), (RTOLS[-1], errors[-1]))


def stepper(size: int, rtol: float) -> Callable[[], None]:
    """Return a call that steps a native batch under the paper's rule: observations, rewards and resets included."""
    envs = gym.make_vec("ImpactApproach-v0", num_envs=size, rtol=rtol)
    rule = PaperTrapezoid()
    held = {"observation": envs.reset(seed=0)[0]}

    def step() -> None:
        held["observation"] = envs.step(rule.predict(held["observation"])[0])[0]

    return step


def contenders(rtol: float) -> dict[str, tuple[Callable[[], Any], int]]:
    """Return, per environment, a call that steps it once with everything included, and how many steps that makes."""
    cart_pole = gym.make_vec("CartPole-v1", num_envs=BATCH, vectorization_mode="vector_entry_point")
    cart_pole.reset(seed=0)
    cart_actions = cycle(np.random.default_rng(0).integers(0, 2, (64, BATCH)))
    return {
        f"ImpactApproach-v0, batch of {BATCH}, rtol {rtol:.0e}, paper's rule": (stepper(BATCH, rtol), BATCH),
        f"CartPole-v1, batch of {BATCH}": (lambda: cart_pole.step(next(cart_actions)), BATCH),
        **{f"{name}, single": (single(name), 1) for name in ("ImpactApproach-v0", "Pendulum-v1")},
    }


def single(name: str) -> Callable[[], None]:
    """Return a call that steps one environment at a constant action, and resets it where an episode ends."""
    env: Any = gym.make(name)
    env.reset(seed=0)
    action = np.full(env.action_space.shape, 0.3, np.float32)

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()

    return step


def memory() -> dict[str, float]:
    """Return the bytes that a batch holds for a row, and those that a step of BATCH rows allocates and lets go."""
    envs: Any = gym.make_vec("ImpactApproach-v0", num_envs=BATCH).unwrapped
    envs.reset(seed=0)
    held = sum(array.nbytes for array in vars(envs.batch).values() if isinstance(array, np.ndarray)) / BATCH
    actions, skip = np.zeros((BATCH, 2)), np.zeros(BATCH, np.bool_)
    envs.batch.step(actions, skip)
    tracemalloc.start()
    envs.batch.step(actions, skip)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return {"bytes_held_per_environment": held, "bytes_allocated_in_a_step_of_the_batch": float(peak)}
