"""What really happens: the slow independent solver at rtol 1e-13, and how far a second method is from it."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

from tqdm import tqdm

from experiments import reference
from experiments.speed_vs_error import records
from experiments.speed_vs_error.quantities import Answer, answer_of, errors
from experiments.speed_vs_error.scenes import Approach

RTOL = 1e-13
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
Task = TypeVar("Task")
Result = TypeVar("Result")


def in_parallel(function: Callable[[Task], Result], tasks: Sequence[Task], title: str) -> Iterator[Result]:
    """Map with a process for each core, none for a single task; give the results in order, as they come."""
    workers = min(len(tasks), os.cpu_count() or 1)
    bar = partial(tqdm, total=len(tasks), desc=title)
    if workers < 2:
        yield from bar(map(function, tasks))
        return
    before = os.environ.copy()
    os.environ.update(dict.fromkeys(THREADS, "1"))  # each process has its core
    try:
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            yield from bar(pool.map(function, tasks))
    finally:
        os.environ.clear()
        os.environ.update(before)


def truth(approach: Approach, second_rtol: float) -> dict[str, Any]:
    """Return the row of an approach: DOP853 at RTOL, and its distance from Radau at `second_rtol`."""

    def solve(rtol: float, method: str) -> Answer:
        outcome = reference.simulate(approach.scene, approach.motion, approach.duration, rtol=rtol, method=method)
        return answer_of(outcome, approach.duration)

    best, second = solve(RTOL, "DOP853"), solve(second_rtol, "Radau")
    doubt = {f"{name}_doubt": value for name, value in errors(second, best).items()}
    return {
        "scene": approach.name,
        "description": approach.description,
        **asdict(best),
        "second_contacts": second.contacts,
        "second_passes": second.passes,
        **doubt,
    }


def truths(path: Path, approaches: Iterable[Approach], second_rtol: float, again: bool) -> dict[str, Answer]:
    """Return the true answers by the name of the approach; compute, and add to the table, those it does not have."""
    approaches = list(approaches)
    rows = {} if again else {row["scene"]: row for row in records.read(path)}
    missing = [a for a in approaches if a.name not in rows or rows[a.name]["description"] != a.description]
    if missing:
        new = in_parallel(partial(truth, second_rtol=second_rtol), missing, "truth")
        rows |= {row["scene"]: row for row in new}
        records.write(path, rows.values())
    fields = Answer.__dataclass_fields__
    return {a.name: Answer(**{name: rows[a.name][name] for name in fields}) for a in approaches}
