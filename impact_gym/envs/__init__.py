"""The environment: scenario, sensing, reward, the batch step, and its front ends."""

from typing import Any

import gymnasium as gym

IDS: dict[str, dict[str, Any]] = {
    "ImpactApproach-v0": {},
    "ImpactApproachRigid-v0": {"coupling": {"type": "Rigid"}},
    "ImpactApproachBistable-v0": {"coupling": {"type": "Bistable"}},
    "ImpactApproachRanged-v0": {"range_noise": 0.01},
    "ImpactTeleop-v0": {
        "operator": {"type": "Reach", "place_error": [-0.05, 0.05], "creep": [0.05, 0.15]},
        "uplink": {"delay": 0.1}, "downlink": {"delay": 0.1}, "friction": [0.1, 0.5], "horizon": 8.0,
        "velocity_range": [-0.3, 0.5], "scenario": {"distance": [0.2, 0.8]},
    },
}  # fmt: skip
"""Registered ids and the arguments that set them apart."""
APPROACH, TELEOP = "single:ImpactApproachEnv", "teleop:ImpactTeleopEnv"


def register() -> None:
    """Register the environments with Gymnasium; again does nothing."""
    for name, arguments in IDS.items():
        if name not in gym.registry:
            gym.register(
                name,
                entry_point=f"impact_gym.envs.{TELEOP if 'operator' in arguments else APPROACH}",
                vector_entry_point="impact_gym.envs.vector:ImpactApproachVectorEnv",
                kwargs=dict(arguments),
            )
