"""What is compared of an approach, and when an answer counts as a failure."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

TOO_WRONG = 1e-2  # m/s in V_p


@dataclass(frozen=True)
class Answer:
    """What a contender says about an approach; nan where it says nothing."""

    velocity: float  # m/s, V_p
    peak_force: float  # N
    contact_duration: float  # s, of all contacts together; one that is unfinished counts up to the end of the run
    detection_time: float  # s, nan if there was no alarm
    contacts: int
    passes: int  # of a slider through its alignment
    steps: int = 0  # of the integrator, 0 if not known


def as_json(answer: Answer) -> dict[str, float | None]:
    """Return an answer as arguments of a job: None for nan."""
    return {name: None if math.isnan(value) else value for name, value in asdict(answer).items()}


def from_json(values: Mapping[str, float | None]) -> Answer:
    """Return the answer of which `as_json` made these."""
    return Answer(**{name: math.nan if value is None else value for name, value in values.items()})


ERRORS = {
    "velocity_error": "error of V_p (m/s)",
    "peak_error": "relative error of peak force",
    "duration_error": "relative error of contact duration",
    "detection_error": "error of detection time (s)",
}
"""Columns of the tables, with their axis labels."""


def answer_of(outcome: Any, duration: float) -> Answer:
    """Return what an `Outcome` of ours, or of the reference, says of a run over `duration` (s)."""
    lasted = sum((duration if contact.end is None else contact.end) - contact.start for contact in outcome.contacts)
    return Answer(
        velocity=outcome.object_velocity,
        peak_force=outcome.peak_force,
        contact_duration=lasted,
        detection_time=math.nan if outcome.detection_time is None else outcome.detection_time,
        contacts=len(outcome.contacts),
        passes=len(outcome.snap_through),
        steps=getattr(outcome, "steps", 0),
    )


def errors(answer: Answer, truth: Answer) -> dict[str, float]:
    """Return the four errors, by their column."""
    return {
        "velocity_error": abs(answer.velocity - truth.velocity),
        "peak_error": abs(answer.peak_force / truth.peak_force - 1.0),
        "duration_error": abs(answer.contact_duration / truth.contact_duration - 1.0),
        "detection_error": abs(answer.detection_time - truth.detection_time),
    }


def failure(answer: Answer, truth: Answer) -> str:
    """Return why an answer is no approximation at all, or an empty string."""
    if not math.isfinite(answer.velocity):
        return "not finite"
    if answer.contacts != truth.contacts:
        return f"{answer.contacts} contacts, not {truth.contacts}"
    if answer.passes != truth.passes:
        return f"{answer.passes} snap-throughs, not {truth.passes}"
    if math.isnan(answer.detection_time) != math.isnan(truth.detection_time):
        return "alarm missed" if math.isnan(answer.detection_time) else "false alarm"
    if abs(answer.velocity - truth.velocity) > TOO_WRONG:
        return f"V_p wrong by more than {TOO_WRONG:g} m/s"
    return ""
