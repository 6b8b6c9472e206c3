"""Policies: networks as plain arrays that run without torch, and those that are shipped, a file for each set-up."""

from agents.policies.policy import SHIPPED, Controller, Ensemble, Policy, load_ensemble, load_policy

__all__ = ["SHIPPED", "Controller", "Ensemble", "Policy", "load_ensemble", "load_policy"]
