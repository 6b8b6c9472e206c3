"""One scenario played again, with its time histories."""

from typing import Any

import gymnasium as gym

from agents.evaluation import Controller
from impact_gym.simulation import Trace


def replay(controller: Controller, seed: int, **options: Any) -> tuple[Trace, dict[str, Any]]:
    """Play the scenario of `seed` as in `agents.evaluation.evaluate`; return its trace and its final info."""
    env: Any = gym.make("ImpactApproach-v0", record_trace=True, **{"scenario": "test", **options}).unwrapped
    observation, _ = env.reset(seed=seed)
    state, ended, info = None, False, {}
    while not ended:
        action, state = controller.predict(observation, state=state, deterministic=True)
        observation, _, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
    return env.trace(), info
