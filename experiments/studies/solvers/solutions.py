"""What a solver says about an approach, how wrong that is, and the truth that it is judged by."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import impact_gym as ig
from experiments import reference
from experiments.lab.study import Row
from experiments.studies.solvers.approaches import Approach, approach_of

ERRORS = {
    "velocity_error": "error of V_p (m/s)",
    "peak_error": "relative error of peak force",
    "duration_error": "relative error of contact duration",
    "detection_error": "error of detection time (s)",
}
"""Columns of the tables, with their axis labels."""
MISCOUNTED, WRONG, NOT_FINITE, GAVE_UP = "V_p right, events miscounted", "V_p wrong", "not finite", "gave up"
"""What may be wrong with a solver's answer; the failure of a right one is empty."""
TRUE_RTOL, SECOND_RTOL = 1e-13, 1e-11  # of the truth of a named approach, by DOP853; and of Radau beside it


@dataclass(frozen=True)
class Solution:
    """What a solver says about an approach; nan where it says nothing."""

    velocity: float  # m/s, V_p
    peak_force: float = math.nan  # N
    contact_duration: float = math.nan  # s, of all contacts together; one that is unfinished counts up to the end
    detection_time: float = math.nan  # s, nan if there was no alarm
    contacts: int = 0
    passes: int = 0  # of a slider through its alignment
    steps: int = 0  # of the integrator, 0 if not known

    @classmethod
    def of(cls, outcome: Any, duration: float) -> "Solution":
        """Return what an `Outcome` of ours, or of the reference, says of a run over `duration` (s)."""
        lasted = sum((duration if contact.end is None else contact.end) - contact.start for contact in outcome.contacts)
        detection = math.nan if outcome.detection_time is None else outcome.detection_time
        counts = len(outcome.contacts), len(outcome.snap_through), getattr(outcome, "steps", 0)
        return cls(outcome.object_velocity, outcome.peak_force, lasted, detection, *counts)

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> "Solution":
        """Return the solution that stands in a row of a table."""
        return cls(**{field.name: row[field.name] for field in fields(cls)})

    @property
    def numbers(self) -> dict[str, float]:
        """What it says, as arguments of a job: without nan. `Solution(**numbers)` is the same."""
        return {name: value for name, value in asdict(self).items() if not math.isnan(value)}

    @property
    def alarms(self) -> int:
        """Whether there was one."""
        return int(not math.isnan(self.detection_time))


def power(value: float) -> str:
    """Return a number without the zeros that fill its exponent, 1e-6."""
    return f"{value:g}".replace("e-0", "e-")


def solve(approach: Approach, simulate: Callable[..., Any] = ig.simulate, **options: Any) -> Solution:
    """Return the solution by impact_gym, or by `simulate` of the reference."""
    return Solution.of(simulate(*approach.run, **options), approach.duration)


def errors(solution: Solution, truth: Solution) -> dict[str, float]:
    """Return the four errors, by their column; those of force and duration are relative to what there is."""
    values = (
        abs(solution.velocity - truth.velocity),
        abs(solution.peak_force / truth.peak_force - 1.0) if truth.contacts else abs(solution.peak_force),
        abs(solution.contact_duration / truth.contact_duration - 1.0) if truth.contacts else math.nan,
        abs(solution.detection_time - truth.detection_time),
    )
    return dict(zip(ERRORS, values, strict=True))


def failure(
    solution: Solution, truth: Solution, allowed: float, counted: Iterable[str] = ("contacts", "passes", "alarms")
) -> str:
    """Return the class of a solution whose V_p is not within `allowed` (m/s) or whose counts are wrong, else ''."""
    if not math.isfinite(solution.velocity):
        return NOT_FINITE
    if not abs(solution.velocity - truth.velocity) <= allowed:
        return WRONG
    right = all(getattr(solution, name) == getattr(truth, name) for name in counted)
    return "" if right else MISCOUNTED


def true_row(approach: str) -> list[Row]:
    """Return the truth of a named approach, and how far what Radau finds is from it."""
    found = approach_of(approach)
    best = solve(found, reference.simulate, rtol=TRUE_RTOL)
    second = solve(found, reference.simulate, rtol=SECOND_RTOL, method="Radau")
    doubt = {f"{name}_doubt": value for name, value in errors(second, best).items()}
    counts = {"second_contacts": second.contacts, "second_passes": second.passes}
    return [{"description": found.description} | asdict(best) | counts | doubt]
