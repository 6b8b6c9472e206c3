"""What is compared of an approach, and when a solution counts as a failure."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

TOO_WRONG = 1e-2  # m/s in V_p
ERRORS = {
    "velocity_error": "error of V_p (m/s)",
    "peak_error": "relative error of peak force",
    "duration_error": "relative error of contact duration",
    "detection_error": "error of detection time (s)",
}
"""Columns of the tables, with their axis labels."""


@dataclass(frozen=True)
class Solution:
    """What a contender says about an approach; nan where it says nothing."""

    velocity: float  # m/s, V_p
    peak_force: float  # N
    contact_duration: float  # s, of all contacts together; one that is unfinished counts up to the end of the run
    detection_time: float  # s, nan if there was no alarm
    contacts: int
    passes: int  # of a slider through its alignment
    steps: int = 0  # of the integrator, 0 if not known


def as_json(solution: Solution) -> dict[str, float | None]:
    """Return a solution as arguments of a job: None for nan."""
    return {name: None if math.isnan(value) else value for name, value in asdict(solution).items()}


def from_json(values: Mapping[str, float | None]) -> Solution:
    """Return the solution of which `as_json` made these."""
    return Solution(**{name: math.nan if value is None else value for name, value in values.items()})


def solution_of(outcome: Any, duration: float) -> Solution:
    """Return what an `Outcome` of ours, or of the reference, says of a run over `duration` (s)."""
    lasted = sum((duration if contact.end is None else contact.end) - contact.start for contact in outcome.contacts)
    detection = math.nan if outcome.detection_time is None else outcome.detection_time
    counts = len(outcome.contacts), len(outcome.snap_through), getattr(outcome, "steps", 0)
    return Solution(outcome.object_velocity, outcome.peak_force, lasted, detection, *counts)


def errors(found: Solution, truth: Solution) -> dict[str, float]:
    """Return the four errors, by their column."""
    values = (
        abs(found.velocity - truth.velocity),
        abs(found.peak_force / truth.peak_force - 1.0),
        abs(found.contact_duration / truth.contact_duration - 1.0),
        abs(found.detection_time - truth.detection_time),
    )
    return dict(zip(ERRORS, values, strict=True))


def failure(found: Solution, truth: Solution) -> str:
    """Return why a solution is no approximation at all, or an empty string."""
    if not math.isfinite(found.velocity):
        return "not finite"
    if found.contacts != truth.contacts:
        return f"{found.contacts} contacts, not {truth.contacts}"
    if found.passes != truth.passes:
        return f"{found.passes} snap-throughs, not {truth.passes}"
    if math.isnan(found.detection_time) != math.isnan(truth.detection_time):
        return "alarm missed" if math.isnan(found.detection_time) else "false alarm"
    if abs(found.velocity - truth.velocity) > TOO_WRONG:
        return f"V_p wrong by more than {TOO_WRONG:g} m/s"
    return ""
