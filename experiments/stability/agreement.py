"""The slow independent solver on a random sample of the storm, and whether it finds the same.

It works at rtol 1e-11 with DOP853, or at 1e-10 with Radau where the contact is stiff; what one of them cannot do in the
time it is given the other may try. Where V_p differs, three more runs of ours say how well the scene defines it: one
at the finest tolerance, two with the object moved by a few rounding errors of its distance.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import impact_gym as ig
from experiments import reference
from experiments.reference.dissipation import damping_factor
from experiments.speed_vs_error import records
from experiments.speed_vs_error.quantities import Answer, answer_of
from experiments.speed_vs_error.records import Row
from experiments.speed_vs_error.scenes import Approach
from experiments.stability.scenes import draw, kind
from experiments.stability.storm import sources
from experiments.stability.workers import Job, answers

EVERY = 50  # one scene in so many: 2 %
FIRST = 17  # of them; the scenes are random themselves
RTOL = {"DOP853": 1e-11, "Radau": 1e-10}
STIFF = 20.0  # d, above which Radau begins
FINEST = 1e-12  # rtol of ours
SHIFT = 1e-13  # of the distance, relative
SHARE = 1e-6  # error of V_p beyond which a scene is looked at again, relative


def sample(count: int, every: int = EVERY) -> list[int]:
    """Return the numbers of the sample among the first `count` scenes, one in `every`."""
    return list(range(FIRST, count, every))


@dataclass(frozen=True)
class Task:
    """A scene and a method."""

    number: int
    method: str


def order(approach: Approach) -> tuple[str, str]:
    """Return the methods, the better one for this contact first."""
    contact = approach.scene.contact
    m, n = contact.stiffness_exponent, contact.damping_exponent
    d = damping_factor(contact.dissipation, contact.restitution, m, n)
    return ("Radau", "DOP853") if d > STIFF else ("DOP853", "Radau")


def truth(task: Task) -> Row:
    """Return the row of what the independent solver finds."""
    approach, rtol = draw(task.number), RTOL[task.method]
    row = unknown(task, "")
    try:
        found = reference.simulate(approach.scene, approach.motion, approach.duration, rtol=rtol, method=task.method)
    except Exception as problem:  # what it cannot do is counted
        return row | {"failure": f"{type(problem).__name__}: {problem}".replace("\n", " ")}
    answer = answer_of(found, approach.duration)
    return (
        row
        | {name: getattr(answer, name) for name in Answer.__dataclass_fields__}
        | {"tool_velocity": found.tool_velocity}
    )


def unknown(task: Task, reason: str) -> Row:
    """Return the row of a scene that the independent solver did not finish."""
    approach = draw(task.number)
    return {
        "scene": str(task.number),
        "coupling": kind(approach.scene),
        "contender": task.method,
        "failure": reason,
        "speed": approach.motion.speed,
        **dict.fromkeys(Answer.__dataclass_fields__, math.nan),
        "tool_velocity": math.nan,
        "description": approach.description,
    }


def nothing() -> None:
    """There is nothing to prepare."""


def extend(path: Path, numbers: Iterable[int], seconds: float, processes: int | None = None) -> dict[int, Row]:
    """Return the truth by the number of the scene; compute, and add to the table, what it does not have."""
    rows = {int(row["scene"]): row for row in records.read(path)}
    numbers = list(numbers)
    described = {number: draw(number).description for number in numbers}
    for attempt, title in enumerate(("truth", "truth, second method")):

        def wanted(number: int, attempt: int = attempt) -> bool:
            row = rows.get(number)
            if row is None or row["description"] != described[number]:
                return True
            return attempt == 1 and bool(row["failure"]) and row["contender"] == order(draw(number))[0]

        tasks = [Task(number, order(draw(number))[attempt]) for number in numbers if wanted(number)]
        if attempt == 1:
            tasks = [task for task in tasks if task.number in rows]
        for count, row in enumerate(answers(Job(truth, nothing), tasks, seconds, unknown, title, processes), start=1):
            rows[int(row["scene"])] = row
            if count % 20 == 0 or count == len(tasks):
                records.write(path, [rows[number] for number in sorted(rows)])
    return {number: rows[number] for number in numbers}


def velocity(approach: Approach, rtol: float = 1e-8, shift: float = 0.0) -> float:
    """V_p of ours, m/s; nan if there is none. The object stands farther by `shift` of its distance."""
    target = replace(approach.scene.object, distance=approach.scene.object.distance * (1.0 + shift))
    scene = replace(approach.scene, object=target)
    try:
        return ig.simulate(scene, approach.motion, approach.duration, rtol).object_velocity
    except RuntimeError:
        return math.nan


def compared(number: int, true: Row) -> Row:
    """Return the row of a scene that the independent solver finished."""
    approach = draw(number)
    row: Row = {
        "scene": str(number),
        "coupling": kind(approach.scene),
        "run": sources(),
        "contender": true["contender"],
        "failure": "",
        "speed": approach.motion.speed,
        "velocity": math.nan,
        "true_velocity": true["velocity"],
        "contacts": math.nan,
        "true_contacts": true["contacts"],
        "passes": math.nan,
        "true_passes": true["passes"],
        "peak_error": math.nan,
        "tool_error": math.nan,
        "finest_velocity": math.nan,
        "spread": math.nan,
        "description": approach.description,
    }
    try:
        outcome = ig.simulate(approach.scene, approach.motion, approach.duration)
    except RuntimeError as problem:
        return row | {"failure": str(problem)}
    row |= {
        "velocity": outcome.object_velocity,
        "contacts": len(outcome.contacts),
        "passes": len(outcome.snap_through),
        "peak_error": abs(outcome.peak_force - true["peak_force"]) / max(abs(true["peak_force"]), 1e-300),
        "tool_error": abs(outcome.tool_velocity - true["tool_velocity"]) / approach.motion.speed,
    }
    if not relative_error(row["velocity"], row["true_velocity"], approach.motion.speed) <= SHARE:
        fine = velocity(approach, FINEST)
        moved = [velocity(approach, FINEST, shift) for shift in (SHIFT, -SHIFT)]
        row |= {"finest_velocity": fine, "spread": max(abs(one - fine) for one in moved)}
    return row


def relative_error(value: float, true: float, speed: float) -> float:
    """Error of V_p, relative to V_p or to a millionth of the commanded speed: an object at rest has some rounding."""
    return abs(value - true) / max(abs(true), 1e-6 * speed)


def compare(path: Path, truths: dict[int, Row], processes: int | None = None) -> Sequence[Row]:
    """Return a row for each scene whose truth is known; compute what the table does not have from these sources."""
    rows = {int(row["scene"]): row for row in records.read(path) if row["run"] == sources()}
    known = {number: row for number, row in truths.items() if not row["failure"]}
    left = [number for number in known if number not in rows]
    job = Job(partial(_compared, truths={number: known[number] for number in left}), nothing)
    for row in answers(job, left, 600.0, _hung, "agreement", processes):
        rows[int(row["scene"])] = row
    found = [rows[number] for number in sorted(known)]
    if left:
        records.write(path, found)
    return found


def _compared(number: int, truths: dict[int, Row]) -> Row:
    return compared(number, truths[number])


def _hung(number: int, reason: str) -> Row:
    raise RuntimeError(f"scene {number}: {reason}")
