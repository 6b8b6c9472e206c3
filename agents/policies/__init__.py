"""Policies: networks as plain arrays that run without torch, and those that are shipped, a file for each set-up."""

from agents.policies.policy import ACTIONS, SHIPPED, Controller, Policy, load_policy, observation_table

__all__ = ["ACTIONS", "SHIPPED", "Controller", "Policy", "load_policy", "observation_table"]
