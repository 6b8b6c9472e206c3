"""Evaluation: controllers play the same numbered scenarios, in this process or as jobs."""

from agents.evaluate.scenario_batch import (
    MEASURED,
    RESULTS,
    TEST_SEED,
    TUNING_SEED,
    VALIDATION_SEED,
    Episodes,
    ScenarioBatch,
    Travel,
    Validation,
)

__all__ = [
    "MEASURED", "RESULTS", "TEST_SEED", "TUNING_SEED", "VALIDATION_SEED", "Episodes", "ScenarioBatch", "Travel",
    "Validation",
]  # fmt: skip
