"""The paper's rule in a plain Gymnasium loop: move at 1 m/s, stop at the alarm."""

import gymnasium as gym
import numpy as np

import impact_gym  # noqa: F401  # registers the environments

GO = np.array([0.5, -5 / 19], np.float32)  # action: to 1 m/s, at 8 m/s^2
STOP = np.array([-0.5, -5 / 19], np.float32)  # action: to 0 m/s, at 8 m/s^2
ALARM = 3  # index of the alarm in the observation

env = gym.make("ImpactApproach-v0")
for seed in range(5):
    observation, info = env.reset(seed=seed)
    terminated = truncated = False
    while not (terminated or truncated):
        action = STOP if observation[ALARM] else GO
        observation, reward, terminated, truncated, info = env.step(action)
    time, velocity = info["approach_time"], info["object_velocity"]
    print(f"seed {seed}: contact after {time:.4f} s, object left at {velocity:.4f} m/s")
env.close()
