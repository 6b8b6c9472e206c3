"""What really happens: the slow independent solver at rtol 1e-13, and how far a second method is from it."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar
from unittest.mock import patch

from tqdm import tqdm

from experiments import reference
from experiments.lab import tables as records
from experiments.lab.tables import Row
from experiments.speed_vs_error.quantities import Answer, answer_of, errors
from experiments.speed_vs_error.scenes import Approach

RTOL = 1e-13
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
Task = TypeVar("Task")
Result = TypeVar("Result")


def in_parallel(function: Callable[[Task], Result], tasks: Sequence[Task], title: str) -> Iterator[Result]:
    """Map with a process for each core, none for a single task; give the results in order, as they come."""
    workers = min(len(tasks), os.cpu_count() or 1)
    bar = partial(tqdm, total=len(tasks), desc=title, disable=not tasks)
    if workers < 2:
        yield from bar(map(function, tasks))
        return
    with (
        patch.dict(os.environ, dict.fromkeys(THREADS, "1")),  # each process has its core
        ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool,
    ):
        yield from bar(pool.map(function, tasks))


def filled(
    path: Path, approaches: Sequence[Approach], function: Callable[[Approach], Row], title: str, again: bool
) -> dict[str, Row]:
    """Return the rows of a table by the name of their approach, after adding what `function` says of those it lacks."""
    rows = {} if again else {row["scene"]: row for row in records.read(path)}
    left = [a for a in approaches if a.name not in rows or rows[a.name]["description"] != a.description]
    for approach, row in zip(left, in_parallel(function, left, title), strict=True):
        rows[approach.name] = {"scene": approach.name, "description": approach.description, **row}
    if left:
        records.write(path, rows.values())
    return rows


def truth(approach: Approach, second_rtol: float) -> Row:
    """Return what DOP853 says at RTOL, and its distance from Radau at `second_rtol`."""

    def solve(rtol: float, method: str) -> Answer:
        outcome = reference.simulate(approach.scene, approach.motion, approach.duration, rtol=rtol, method=method)
        return answer_of(outcome, approach.duration)

    best, second = solve(RTOL, "DOP853"), solve(second_rtol, "Radau")
    doubt = {f"{name}_doubt": value for name, value in errors(second, best).items()}
    return {**asdict(best), "second_contacts": second.contacts, "second_passes": second.passes, **doubt}


def truths(path: Path, approaches: Sequence[Approach], second_rtol: float, again: bool) -> dict[str, Answer]:
    """Return the true answers by the name of the approach, after adding to the table those it does not have."""
    rows = filled(path, approaches, partial(truth, second_rtol=second_rtol), "truth", again)
    return {a.name: Answer(**{name: rows[a.name][name] for name in Answer.__dataclass_fields__}) for a in approaches}
