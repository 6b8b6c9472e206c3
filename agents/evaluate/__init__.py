"""Evaluation: controllers play the same numbered scenarios, in this process or as jobs."""
