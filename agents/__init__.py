"""Controllers for the environment: baselines, training with stable-baselines3, and policies that are shipped."""

from agents import baselines
from agents.policy import Policy, load_policy

__all__ = ["Policy", "baselines", "load_policy"]
