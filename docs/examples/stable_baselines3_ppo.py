"""Train PPO of stable-baselines3 in a vector environment."""

import sys

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor

from impact_gym.sb3 import ImpactVecEnv

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 500_000
torch.set_num_threads(1)  # the network is small: more threads make the training slower


def mean_return() -> float:
    """Mean return (m/s) of 500 episodes in scenarios that the training does not use."""
    test = VecMonitor(ImpactVecEnv(500, scenario="test"))
    test.seed(1_000_000)
    return float(evaluate_policy(model, test, n_eval_episodes=500)[0])


model = PPO(
    "MlpPolicy", VecMonitor(ImpactVecEnv(512)), n_steps=64, batch_size=2048, n_epochs=4,
    learning_rate=1e-3, gamma=1.0, policy_kwargs={"net_arch": [64, 64]}, seed=0,
    device="cpu",
)  # fmt: skip
print(f"mean return untrained: {mean_return():.4f} m/s")
model.learn(steps)
print(f"mean return after {model.num_timesteps} steps: {mean_return():.4f} m/s")
