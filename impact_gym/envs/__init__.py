"""The environment: scenario, sensing, reward, the batch step, and its front ends."""

import gymnasium as gym


def register() -> None:
    """Register the environments with Gymnasium; again does nothing."""
    if "ImpactApproach-v0" not in gym.registry:
        gym.register(
            "ImpactApproach-v0",
            entry_point="impact_gym.envs.single:ImpactApproachEnv",
            vector_entry_point="impact_gym.envs.vector:ImpactApproachVectorEnv",
        )
