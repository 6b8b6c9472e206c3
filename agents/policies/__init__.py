"""Policies: small networks as plain arrays, which run without torch; and the shipped ones, a file for each set-up."""

from agents.policies.policy import SHIPPED, Controller, Ensemble, Policy, load_ensemble, load_policy

__all__ = ["SHIPPED", "Controller", "Ensemble", "Policy", "load_ensemble", "load_policy"]
