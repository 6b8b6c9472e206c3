"""Controllers of the environment: baselines, and policies trained with stable-baselines3."""

from agents import baselines
from agents.policies.policy import Policy, load_policy
from agents.setups import Setup, load_baseline, load_setup

__all__ = ["Policy", "Setup", "baselines", "load_baseline", "load_policy", "load_setup"]
