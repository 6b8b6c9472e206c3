"""What a solver says about an approach, how wrong that is, and the truth that it is judged by."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import impact_gym as ig
from agents.jobs import Result, digest_of
from experiments import reference
from experiments.lab.tables import Gather, Row, result_of
from experiments.reference.laws import damping_factor
from experiments.solver.approaches import Approach, approach_of

SHARED = ("experiments.lab.scenes", "experiments.solver.approaches", "experiments.solver.solutions")
"""Modules that the rows of every table follow from."""
OURS = "impact_gym"
ERRORS = {
    "velocity_error": "error of V_p (m/s)",
    "peak_error": "relative error of peak force",
    "duration_error": "relative error of contact duration",
    "detection_error": "error of detection time (s)",
}
"""Columns of the tables, with their axis labels."""
CLASSES = GOOD, MISCOUNTED, WRONG, NOT_FINITE, LATE, GAVE_UP = (
    "V_p and contacts right", "V_p right, events miscounted", "V_p wrong", "not finite", "no answer in 5 s", "gave up",
)  # fmt: skip
"""What becomes of a solver on an approach, from good to bad; in tables the failure of what is good is empty."""
TRUE_RTOL, SECOND_RTOL = 1e-13, 1e-11  # of the truth but for the storm, by DOP853; and of Radau beside it
STIFF = 20.0  # d, above which the truth of a scene of the storm is looked for by an implicit method first
STORM_RTOL = {"DOP853": 1e-11, "Radau": 1e-10}


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


def relative_error(value: float, true: float, speed: float) -> float:
    """Error of V_p, relative to V_p or to a millionth of the commanded speed: an object at rest has some rounding."""
    return abs(value - true) / max(abs(true), 1e-6 * speed)


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


def true_row(approach: str | int, contender: str, rtol: float) -> Result:
    """Return the row of what the independent solver finds by one of its methods."""
    scene = approach_of(approach)
    outcome = reference.simulate(*scene.run, rtol=rtol, method=contender)
    return result_of([scene.labels | {"contender": contender} | asdict(Solution.of(outcome, scene.duration))])


def truths(gather: Gather, runs: Iterable[tuple[str | int, str, float]], **options: Any) -> list[Row]:
    """Return the rows of `true_row` of approaches, each by one of the reference's methods at an rtol."""
    jobs = [dict(zip(("approach", "contender", "rtol"), run, strict=True)) for run in runs]
    return gather("truth", true_row, jobs, digest_of(reference.__name__, *SHARED), **options)


def truths_with_doubt(gather: Gather, approaches: Sequence[str]) -> list[Row]:
    """Return the truth of approaches at TRUE_RTOL, and its distance from what Radau finds at SECOND_RTOL."""
    ways = (("DOP853", TRUE_RTOL), ("Radau", SECOND_RTOL))
    both = truths(gather, [(approach, *way) for approach in approaches for way in ways])
    rows = []
    for best, second in zip(both[::2], both[1::2], strict=True):
        doubt = errors(Solution.of_row(second), Solution.of_row(best))
        counts = {f"second_{name}": second[name] for name in ("contacts", "passes")}
        rows.append(best | counts | {f"{name}_doubt": value for name, value in doubt.items()})
    return rows


def storm_truths(gather: Gather, scenes: Sequence[int], seconds: float) -> dict[int, Row]:
    """Return the truth of scenes of the storm by their number; each method has so many `seconds` for it.

    What is stiff is left to Radau first, all else to DOP853; what one cannot do the other may try.
    """
    rows: dict[int, Row] = {}
    for turn in range(2):
        left = [scene for scene in scenes if scene not in rows or rows[scene]["failure"]]
        runs = []
        for scene in left:
            law = approach_of(scene).scene.contact
            exponents = law.stiffness_exponent, law.damping_exponent
            stiff = damping_factor(law.dissipation, law.restitution, *exponents) > STIFF
            method = "Radau" if stiff == (turn == 0) else "DOP853"
            runs.append((scene, method, STORM_RTOL[method]))
        rows |= zip(left, truths(gather, runs, failed=known, seconds=seconds), strict=True)
    return rows


def known(arguments: Mapping[str, Any]) -> Row:
    """Return the row of a job that has no result, by its arguments: what is known of its approach."""
    contender = {"contender": arguments["contender"]} if "contender" in arguments else {}
    return approach_of(arguments["approach"]).labels | contender
