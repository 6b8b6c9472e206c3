"""A solver's answer for an approach, its errors, and the reference solution."""

import math
from dataclasses import asdict, dataclass
from typing import Any

from experiments import reference
from experiments.lab.study import Row
from experiments.studies.solvers.approaches import approach_of

ERRORS = ("velocity_error", "peak_error", "duration_error", "detection_error")
"""Columns of the tables: errors of V_p (m/s), peak force (relative), duration of contact (relative), alarm (s)."""
MISCOUNTED, WRONG, NOT_FINITE, GAVE_UP = "V_p right, events miscounted", "V_p wrong", "not finite", "gave up"
TRUE_RTOL, SECOND_RTOL = 1e-13, 1e-11  # of DOP853, which gives the truth, and of Radau, which is compared with it


@dataclass(frozen=True)
class Solution:
    """A solver's answer for an approach; a number that the solver does not give is nan."""

    velocity: float  # m/s, V_p
    peak_force: float = math.nan  # N
    contact_duration: float = math.nan  # s, sum over all contacts; an unfinished one counts up to the end
    detection_time: float = math.nan  # s, nan if there was no alarm
    contacts: int = 0
    passes: int = 0  # times that the slider passes its alignment
    steps: int = 0  # steps of the integrator, 0 if unknown

    @classmethod
    def of(cls, outcome: Any, duration: float) -> "Solution":
        """Return the answer in an outcome of our solver or of the reference, for a run of `duration` (s)."""
        lasted = sum((duration if contact.end is None else contact.end) - contact.start for contact in outcome.contacts)
        detection = math.nan if outcome.detection_time is None else outcome.detection_time
        counts = len(outcome.contacts), len(outcome.snap_through), getattr(outcome, "steps", 0)
        return cls(outcome.object_velocity, outcome.peak_force, lasted, detection, *counts)


def power(value: float) -> str:
    """Return a number without leading zeros in its exponent, such as 1e-6."""
    return f"{value:g}".replace("e-0", "e-")


def errors(solution: Solution, truth: Solution) -> dict[str, float]:
    """Return the columns of ERRORS."""
    values = (
        abs(solution.velocity - truth.velocity),
        abs(solution.peak_force / truth.peak_force - 1.0) if truth.contacts else abs(solution.peak_force),
        abs(solution.contact_duration / truth.contact_duration - 1.0) if truth.contacts else math.nan,
        abs(solution.detection_time - truth.detection_time),
    )
    return dict(zip(ERRORS, values, strict=True))


def failure(solution: Solution, truth: Solution, allowed: float) -> str:
    """Return why a solution is wrong, or '' if V_p is within `allowed` (m/s) and all events are counted right."""
    if not math.isfinite(solution.velocity):
        return NOT_FINITE
    if not abs(solution.velocity - truth.velocity) <= allowed:
        return WRONG
    counts = [(one.contacts, one.passes, math.isnan(one.detection_time)) for one in (solution, truth)]
    return "" if counts[0] == counts[1] else MISCOUNTED


def true_row(approach: str) -> list[Row]:
    """Return the reference solution of a named approach (DOP853), and how far Radau's solution is from it."""
    found = approach_of(approach)
    best, second = (
        Solution.of(reference.simulate(*found.run, rtol=rtol, method=method), found.duration)
        for rtol, method in ((TRUE_RTOL, "DOP853"), (SECOND_RTOL, "Radau"))
    )
    doubt = {f"{name}_doubt": value for name, value in errors(second, best).items()}
    counts = {"second_contacts": second.contacts, "second_passes": second.passes}
    return [{"description": found.description} | asdict(best) | counts | doubt]
