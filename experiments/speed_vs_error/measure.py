"""Time and judge contenders, and add the rows to a table."""

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

from experiments.speed_vs_error import records
from experiments.speed_vs_error.contenders import OURS, Contender, Grid, contenders
from experiments.speed_vs_error.quantities import ERRORS, Answer, errors, failure
from experiments.speed_vs_error.records import Row
from experiments.speed_vs_error.scenes import Approach
from experiments.speed_vs_error.timing import best_times
from experiments.speed_vs_error.truth import in_parallel

Key = tuple[str, str, float]
SAVED_EVERY = 20  # scenes of the population


def key(row: Row) -> Key:
    """What tells a row from others."""
    return row["scene"], row["contender"], row["setting"]


def judged(contender: Contender, truth: Answer) -> Row:
    """Return the row of a contender without its time."""
    try:
        answer = contender.solve()
    except Exception as problem:  # a failure is a result here
        nothing = dict.fromkeys((*ERRORS, "contacts", "passes"), math.nan)
        return {**nothing, "steps": 0, "failure": f"{type(problem).__name__}: {problem}".replace("\n", " ")}
    counts = {"contacts": answer.contacts, "passes": answer.passes, "steps": answer.steps}
    return {**errors(answer, truth), **counts, "failure": failure(answer, truth)}


def measured(approach: Approach, found: Sequence[Contender], truth: Answer, rounds: int) -> list[Row]:
    """Return a row for each contender, timed in turns."""
    load, run = os.getloadavg()[0], datetime.now(UTC).isoformat(timespec="seconds")
    seconds = best_times(found, rounds, approach.name if rounds > 1 else None)
    return [
        {
            "scene": approach.name,
            "contender": contender.name,
            "setting": contender.setting,
            "microseconds": 1e6 * seconds[contender],
            **judged(contender, truth),
            "rounds": rounds,
            "load": load,
            "run": run,
        }
        for contender in found
    ]


def missing(there: Iterable[Key], approach: Approach, found: Sequence[Contender]) -> list[Contender]:
    """Return the contenders that have no row, and ours if there are any, so that their ratios are of one run."""
    there = set(there)
    left = [contender for contender in found if (approach.name, contender.name, contender.setting) not in there]
    return [contender for contender in found if contender.name == OURS or contender in left] if left else []


def extend(path: Path, approach: Approach, found: Sequence[Contender], truth: Answer, rounds: int) -> None:
    """Measure what the table does not have of an approach, and write the table."""
    rows = {key(row): row for row in records.read(path)}
    left = missing(rows, approach, found)
    if left:
        rows |= {key(row): row for row in measured(approach, left, truth, rounds)}
        records.write(path, rows.values())


def _rows(task: tuple[Approach, Answer, Grid, frozenset[Key]]) -> list[Row]:
    approach, truth, grid, there = task
    return measured(approach, missing(there, approach, contenders(approach, grid, None)), truth, rounds=1)


def extend_all(path: Path, approaches: Sequence[Approach], grid: Grid, truth: Mapping[str, Answer]) -> None:
    """Likewise for many approaches, in one round each; as many at a time as there are cores."""
    rows = {key(row): row for row in records.read(path)}
    tasks = []
    for approach in approaches:
        there = frozenset(place for place in rows if place[0] == approach.name)
        if missing(there, approach, contenders(approach, grid, None)):
            tasks.append((approach, truth[approach.name], grid, there))
    for count, new in enumerate(in_parallel(_rows, tasks, "population"), start=1):
        rows |= {key(row): row for row in new}
        if count % SAVED_EVERY == 0 or count == len(tasks):
            records.write(path, rows.values())
