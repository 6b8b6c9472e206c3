"""Policies: small networks that run without torch. This folder holds the shipped policies."""

from agents.policies.policy import SHIPPED, Controller, Ensemble, Policy, load_ensemble, load_policy

__all__ = ["SHIPPED", "Controller", "Ensemble", "Policy", "load_ensemble", "load_policy"]
