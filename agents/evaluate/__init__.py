"""Evaluation: controllers played through the same numbered scenarios, here or as jobs."""

from agents.evaluate.stage import (
    RESULTS,
    TEST_SEED,
    TUNING_SEED,
    VALIDATION_SEED,
    Controller,
    Episodes,
    Stage,
    Validation,
    evaluate,
)

__all__ = [
    "RESULTS",
    "TEST_SEED",
    "TUNING_SEED",
    "VALIDATION_SEED",
    "Controller",
    "Episodes",
    "Stage",
    "Validation",
    "evaluate",
]
