"""The batch for stable-baselines3; needs the extra `train`."""

from impact_gym.envs.sb3 import ImpactVecEnv

__all__ = ["ImpactVecEnv"]
