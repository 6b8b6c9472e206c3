"""The paper's rule in a vector environment: one episode in each environment."""

import gymnasium as gym
import numpy as np

import impact_gym  # noqa: F401  # registers the environments

GO, STOP = np.float32([[0.5, -5 / 19], [-0.5, -5 / 19]])  # to 1 or 0 m/s, at 8 m/s^2
ALARM = 3  # index of the alarm in the observation

envs = gym.make_vec("ImpactApproach-v0", num_envs=1000)
observations, infos = envs.reset(seed=0)  # environment k has the seed k
time, velocity = np.full((2, envs.num_envs), np.nan)
while np.isnan(time).any():
    actions = np.where(observations[:, [ALARM]] > 0, STOP, GO)
    observations, rewards, terminated, truncated, infos = envs.step(actions)
    first = terminated & np.isnan(time)  # where the first episode has just ended
    if first.any():
        time[first] = infos["approach_time"][first]
        velocity[first] = infos["object_velocity"][first]
envs.close()
means = f"contact after {time.mean():.4f} s, object left at {velocity.mean():.4f} m/s"
print(f"{means}, means of {time.size} scenarios")
