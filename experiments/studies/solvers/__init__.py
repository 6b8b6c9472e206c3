"""Shared by the studies `speed` and `stability`: approaches, the solvers that compute them, solutions and errors."""
