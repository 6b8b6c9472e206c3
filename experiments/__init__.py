"""Evaluation, the report, the paper's figures, and benchmarks."""
