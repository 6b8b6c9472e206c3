"""Environments: steps a second with everything included, beside Gymnasium's own, and what a batch costs a row."""

import tracemalloc
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.baselines import PaperTrapezoid
from agents.evaluation import VALIDATION_SEED, evaluate

BATCH = 1024
SIZES = (64, 256, 1024, 4096, 16384, 65536)
ERROR = 1e-6  # m/s in V_p
RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


def cheapest_tolerance() -> tuple[float, float]:
    """Return the largest `rtol` with an error in V_p of at most ERROR in each of 1,024 scenarios, and the error."""
    rule = PaperTrapezoid()

    def velocities(rtol: float) -> NDArray[np.float64]:
        return evaluate(rule, VALIDATION_SEED, BATCH, rtol=rtol).object_velocity

    exact = velocities(1e-12)
    for rtol in RTOLS:
        error = float(np.abs(velocities(rtol) - exact).max())
        if error <= ERROR:
            break
    return rtol, error


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
    found: dict[str, tuple[Callable[[], Any], int]] = {
        f"ImpactApproach-v0, batch of {BATCH}, rtol {rtol:.0e}, paper's rule": (stepper(BATCH, rtol), BATCH)
    }
    cart_pole = gym.make_vec("CartPole-v1", num_envs=BATCH, vectorization_mode="vector_entry_point")
    cart_pole.reset(seed=0)
    cart_actions = np.random.default_rng(0).integers(0, 2, (64, BATCH))
    turn = iter(range(10**9))
    found[f"CartPole-v1, batch of {BATCH}"] = (lambda: cart_pole.step(cart_actions[next(turn) % 64]), BATCH)
    for name in ("ImpactApproach-v0", "Pendulum-v1"):
        env: Any = gym.make(name)
        env.reset(seed=0)
        action = np.zeros(env.action_space.shape, np.float32) + 0.3

        def step_single(env: Any = env, action: Any = action) -> None:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

        found[f"{name}, single"] = (step_single, 1)
    return found


def memory() -> dict[str, float]:
    """Return the bytes that a batch holds for a row, and those that a step of BATCH rows allocates and lets go."""
    envs: Any = gym.make_vec("ImpactApproach-v0", num_envs=BATCH).unwrapped
    envs.reset(seed=0)
    batch = envs.batch
    held = sum(array.nbytes for array in vars(batch).values() if isinstance(array, np.ndarray)) / batch.size
    actions, skip = np.zeros((BATCH, 2)), np.zeros(BATCH, np.bool_)
    batch.step(actions, skip)
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    batch.step(actions, skip)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return {"bytes_held_per_environment": held, "bytes_allocated_in_a_step_of_the_batch": float(peak - before)}
