"""Ten episodes of the paper's rule as a Minari dataset: go at 1 m/s, stop at the contact alarm."""

import gymnasium as gym
import minari
import numpy as np

from impact_gym.minari import EpisodeInfo

GO = np.array([0.5, -5 / 19], np.float32)  # to 1 m/s at 8 m/s^2
STOP = np.array([-0.5, -5 / 19], np.float32)  # to 0 m/s at 8 m/s^2
ALARM = 3  # its place in the observation

env = minari.DataCollector(gym.make("ImpactApproach-v0"), EpisodeInfo, record_infos=True)
for seed in range(10):
    observation, info = env.reset(seed=seed)
    ended = False
    while not ended:
        observation, reward, ended, truncated, info = env.step(STOP if observation[ALARM] else GO)
dataset = env.create_dataset("impact/paper-rule-v0", algorithm_name="the paper's rule")
env.close()
for episode in dataset:
    print(f"{len(episode)} steps, peak force {episode.infos['peak_force'][-1]:.2f} N")
