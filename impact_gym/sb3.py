"""The environments for stable-baselines3; importing this module needs the extra `train`."""

from impact_gym.envs.sb3 import ImpactVecEnv

__all__ = ["ImpactVecEnv"]
