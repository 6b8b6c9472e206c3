"""The environments, and their registration with Gymnasium."""

import re
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
"""For each id with a scalar reward, the arguments that differ from the defaults."""
APPROACH, TELEOP, BATCH = "single:ImpactApproachEnv", "teleop:ImpactTeleopEnv", "vector:ImpactApproachVectorEnv"
OBJECTIVES = "objectives:MOImpactApproachEnv", "objectives:MOImpactApproachVectorEnv"


def register() -> None:
    """Register the environments with Gymnasium; do nothing if they are registered already."""
    for name, arguments in IDS.items():
        single = TELEOP if "operator" in arguments else APPROACH
        with_vectors = "mo" + re.sub("([A-Z])", r"-\1", name).lower()  # "mo-impact-approach-v0"
        for each, (entry, batch) in {name: (single, BATCH), with_vectors: OBJECTIVES}.items():
            if each not in gym.registry:
                gym.register(
                    each,
                    entry_point=f"impact_gym.envs.{entry}",
                    vector_entry_point=f"impact_gym.envs.{batch}",
                    kwargs=dict(arguments),
                )
