"""The environment: scenario, sensing, reward, the batch step, and its front ends."""

from typing import Any

import gymnasium as gym

IDS: dict[str, dict[str, Any]] = {
    "ImpactApproach-v0": {},
    "ImpactApproachRigid-v0": {"coupling": {"type": "Rigid"}},
    "ImpactApproachBistable-v0": {"coupling": {"type": "Bistable"}},
    "ImpactApproachRanged-v0": {"range_noise": 0.01},
}
"""Registered ids and the arguments that set them apart."""


def register() -> None:
    """Register the environments with Gymnasium; again does nothing."""
    for name, arguments in IDS.items():
        if name not in gym.registry:
            gym.register(
                name,
                entry_point="impact_gym.envs.single:ImpactApproachEnv",
                vector_entry_point="impact_gym.envs.vector:ImpactApproachVectorEnv",
                kwargs=dict(arguments),
            )
