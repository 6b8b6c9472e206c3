"""Approaches, and solvers that compute them, for the studies `speed` and `stability`."""
