"""Controllers for the environment: baselines, training with stable-baselines3, and policies that are shipped."""

from agents import baselines
from agents.policies.policy import Policy, load_policy
from agents.setups import Setup, load_setup

__all__ = ["Policy", "Setup", "baselines", "load_policy", "load_setup"]
