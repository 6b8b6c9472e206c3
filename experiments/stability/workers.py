"""Processes that do one task after another, each within its time, and the tables on disk that they fill.

Compiled code does not listen to signals: the only way to survive a hang is a process of its own. Each task is done by
one process alone, so that no answer depends on which other tasks there are.
"""

import math
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from time import monotonic
from typing import Any
from unittest.mock import patch

from pebble import ProcessExpired, ProcessPool
from tqdm import tqdm

from experiments.lab import tables as records
from experiments.lab.tables import Row
from experiments.speed_vs_error.truth import THREADS

SAVED_EVERY = 10.0  # s
Task = tuple[Any, ...]
KEY = ("scene", "contender", "run", "description")


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise TimeoutError once this process has used so much more processor time, s."""

    def late(*_: Any) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds, 0.1)  # more than once: a destructor swallows what is raised in it
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def _answers(
    work: Callable[..., Row], tasks: Sequence[Task], seconds: float, title: str, prepare: Any, processes: int | None
) -> Iterator[Row]:
    """Yield the row of each task as it comes, in any order; see `filled`."""
    count = min(len(tasks), (os.cpu_count() or 1) if processes is None else processes)
    bar = partial(tqdm, desc=title, total=len(tasks), smoothing=0.02)
    if count == 0:
        yield from (_answer(partial(work, *task), task[0], seconds) for task in bar(tasks))
        return
    alone = patch.dict(os.environ, dict.fromkeys(THREADS, "1"))  # each process has its core
    with alone, ProcessPool(count, initializer=prepare, context=get_context("spawn")) as pool:
        try:
            begun = {pool.schedule(work, task, timeout=seconds): task[0] for task in tasks}
            for future in bar(as_completed(begun)):
                yield _answer(future.result, begun[future], seconds)
        finally:
            pool.stop()


def _answer(result: Callable[[], Row], blank: Row, seconds: float) -> Row:
    try:
        return result()
    except BrokenProcessPool:  # no process gets ready
        raise
    except TimeoutError:
        reason = f"no answer within {seconds:g} s"
    except ProcessExpired as death:
        reason = f"the process died, exit code {death.exitcode}"
    except Exception as problem:  # of any kind: it is counted
        reason = f"{type(problem).__name__}: {problem}".replace("\n", " ")
    return blank | {"failure": reason}


def filled(
    path: Path,
    work: Callable[..., Row],
    tasks: Sequence[Task],
    seconds: float,
    prepare: Callable[[], Any] | None = None,
    processes: int | None = None,
) -> tuple[list[Row], int]:
    """Return the row of each task, and how many of them the table at `path` did not have.

    Rows of the table stand for those with the same words in KEY. New ones are kept as they come, with nan
    where others have a number.

    Args:
        path: of the table.
        work: makes a row; a function of a module, so that it can be sent.
        tasks: what it takes, begun in this order; first a row, which is the answer, with the reason as its failure,
            where a task takes too long, ends its process or raises.
        seconds: how long one may take by the clock.
        prepare: called once in each process, not counted.
        processes: how many; None for one a core, 0 for none but this one, without a limit of time.
    """
    wanted, runs = [_key(task[0]) for task in tasks], {task[0].get("run") for task in tasks}
    rows = {_key(row): row for row in records.read(path) if row.get("run") in runs}
    left = [task for key, task in zip(wanted, tasks, strict=True) if key not in rows]

    def save() -> None:
        columns = dict.fromkeys((name for row in rows.values() for name in row), math.nan)
        rows.update({key: columns | row for key, row in rows.items()})
        records.write(path, sorted(rows.values(), key=lambda row: (int(row["scene"]), row.get("contender", ""))))

    saved = monotonic()
    try:
        for row in _answers(work, left, seconds, path.stem, prepare, processes):
            rows[_key(row)] = row
            if monotonic() > saved + SAVED_EVERY:
                save()
                saved = monotonic()
    finally:  # of a run that is stopped too
        if left and rows:
            save()
    return [rows[key] for key in wanted], len(left)


def _key(row: Row) -> tuple[Any, ...]:
    return tuple(row.get(name) for name in KEY)
