"""Evaluation: controllers played through the same numbered scenarios, here or as jobs."""

from agents.evaluate.scenario_batch import (
    RESULTS,
    TEST_SEED,
    TUNING_SEED,
    VALIDATION_SEED,
    Episodes,
    ScenarioBatch,
    Validation,
    evaluate,
)
from agents.evaluate.travel import Travel

__all__ = [
    "RESULTS", "TEST_SEED", "TUNING_SEED", "VALIDATION_SEED", "Episodes", "ScenarioBatch", "Travel", "Validation",
    "evaluate",
]  # fmt: skip
