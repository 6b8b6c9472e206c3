"""Step rates of every front end, of PPO on top of one, and of Gymnasium's own environments for scale."""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

ID = "ImpactApproach-v0"
MIX = 80  # steps before a measurement: episodes have 20 to 75, and slots begin in step
ROLLOUT = 64  # steps of each environment between two updates of PPO, as in `agents.train`
LEARN_ENVS = 512  # likewise
SCALE_BATCH = 1024  # environments in the batch of CartPole

_FIRST = f"""
import json, time
begun = time.perf_counter()
import gymnasium, impact_gym
imported = time.perf_counter()
env = gymnasium.make("{ID}")
env.reset(seed=0)
env.step(env.action_space.sample())
made = time.perf_counter()
print(json.dumps([imported - begun, made - imported]))
"""


class Rate(NamedTuple):
    """What one front end does."""

    name: str
    envs: int  # in its batch, 1 without one
    steps: float  # environment steps a second, 0 if it could not be measured


class Start(NamedTuple):
    """How a fresh process comes to its first step."""

    importing: float  # s
    making: float  # s, `make`, `reset` and one step


def first_start() -> Start:
    """Import, make and step once in a fresh process.

    Raises:
        RuntimeError: it fails; says what it said.
    """
    done = subprocess.run([sys.executable, "-c", _FIRST], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"a fresh process cannot make {ID}:\n{done.stderr}")
    return Start(*json.loads(done.stdout.splitlines()[-1]))


def rate(call: Callable[[], Any], steps: int, seconds: float, rounds: int = 3) -> float:
    """Return the steps per second of `call`, which makes `steps`: the best of `rounds`, together of `seconds`."""
    best = 0.0
    for _ in range(rounds):
        calls, spent, begun = 0, 0.0, time.perf_counter()
        while spent < seconds / rounds or calls == 0:
            call()
            calls += 1
            spent = time.perf_counter() - begun
        best = max(best, calls * steps / spent)
    return best


def single(name: str, seconds: float) -> Rate:
    """Measure `gym.make(name)`, resets included."""
    env: Any = gym.make(name)
    env.reset(seed=0)
    space = env.action_space
    actions = np.random.default_rng(0).uniform(space.low, space.high, (256, *space.shape)).astype(np.float32)
    turn = 0

    def step() -> None:
        nonlocal turn
        turn = (turn + 1) % len(actions)
        _, _, terminated, truncated, _ = env.step(actions[turn])
        if terminated or truncated:
            env.reset()

    for _ in range(MIX):
        step()
    return Rate(f"gym.make({name!r})", 1, rate(step, 1, seconds))


def batch(num_envs: int, seconds: float) -> Rate:
    """Measure the native batch of `gym.make_vec`."""
    envs = gym.make_vec(ID, num_envs=num_envs)
    envs.reset(seed=0)
    return Rate(f"gym.make_vec({ID!r})", num_envs, _batch_rate(envs.step, _actions(num_envs), seconds))


def cart_pole(seconds: float) -> Rate:
    """Measure Gymnasium's own native batch."""
    envs = gym.make_vec("CartPole-v1", num_envs=SCALE_BATCH, vectorization_mode="vector_entry_point")
    envs.reset(seed=0)
    actions = np.random.default_rng(0).integers(0, 2, (32, SCALE_BATCH))
    return Rate("gym.make_vec('CartPole-v1')", SCALE_BATCH, _batch_rate(envs.step, actions, seconds))


def stable_baselines3(num_envs: int, seconds: float) -> Rate:
    """Measure the batch of `impact_gym.sb3`."""
    from impact_gym.envs.sb3 import ImpactVecEnv

    envs = ImpactVecEnv(num_envs)
    envs.seed(0)
    envs.reset()
    return Rate("ImpactVecEnv", num_envs, _batch_rate(envs.step, _actions(num_envs), seconds))


def ppo(num_envs: int, threads: int, seconds: float) -> Rate:
    """Measure PPO of stable-baselines3 with a net of 64x64, learning included, torch on so many `threads`."""
    import torch
    from stable_baselines3 import PPO

    from impact_gym.envs.sb3 import ImpactVecEnv

    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        model = PPO(
            "MlpPolicy",
            ImpactVecEnv(num_envs),
            n_steps=ROLLOUT,
            batch_size=min(2048, num_envs * ROLLOUT),
            n_epochs=3,
            gamma=1.0,
            seed=0,
            device="cpu",
            policy_kwargs={"net_arch": [64, 64]},
        )
        rollout = num_envs * ROLLOUT
        model.learn(rollout)
        steps = rate(lambda: model.learn(rollout, reset_num_timesteps=False), rollout, seconds, 1)
    finally:
        torch.set_num_threads(before)
    return Rate(f"PPO on ImpactVecEnv, {threads} torch thread{'s' * (threads > 1)}", num_envs, steps)


def torch_threads() -> int:
    """Return how many threads torch would use, left alone."""
    import torch

    return torch.get_num_threads()


def _actions(num_envs: int) -> NDArray[np.float32]:
    return np.random.default_rng(0).uniform(-1.0, 1.0, (32, num_envs, 2)).astype(np.float32)


def _batch_rate(step: Callable[[Any], Any], actions: NDArray[Any], seconds: float) -> float:
    """Play `actions` (k, num_envs, ...) in turn."""
    turn = 0

    def call() -> None:
        nonlocal turn
        turn = (turn + 1) % len(actions)
        step(actions[turn])

    for _ in range(MIX):
        call()
    return rate(call, actions.shape[1], seconds)
