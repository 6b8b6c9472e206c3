"""Processes that do one task after another, and are ended when they say nothing for too long.

Compiled code does not listen to signals: the only way to survive a hang is a process of its own. Each task is done by
one process alone, so that no answer depends on which other tasks there are.
"""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

from tqdm import tqdm

from experiments.speed_vs_error.truth import THREADS

Task = TypeVar("Task")
Result = TypeVar("Result")
PATIENCE = 1800.0  # s, for a process to get ready: it may have to compile


@dataclass(frozen=True)
class Job(Generic[Task, Result]):
    """What a process does: both are functions of a module, so that they can be sent."""

    work: Callable[[Task], Result]
    prepare: Callable[[], None]  # once in each process, not counted


class _Worker(Generic[Task, Result]):
    """A process and what it is doing."""

    def __init__(self, job: Job[Task, Result]) -> None:
        context = get_context("spawn")
        self.connection, other = context.Pipe()
        self.process = context.Process(target=_serve, args=(other, job), daemon=True)
        self.process.start()
        other.close()
        self.task: Task | None = None
        self.ready = False
        self.deadline = time.monotonic() + PATIENCE

    def give(self, task: Task, seconds: float) -> None:
        self.task, self.deadline = task, time.monotonic() + seconds
        self.connection.send((task,))

    def end(self) -> None:
        self.connection.close()
        self.process.kill()
        self.process.join()


def _serve(connection: Connection, job: Job[Any, Any]) -> None:
    job.prepare()
    connection.send(None)
    with suppress(EOFError, KeyboardInterrupt):
        while True:
            (task,) = connection.recv()
            connection.send((job.work(task),))


def answers(
    job: Job[Task, Result],
    tasks: Sequence[Task],
    seconds: float,
    silent: Callable[[Task, str], Result],
    title: str,
    processes: int | None = None,
) -> Iterator[Result]:
    """Yield the result of each task as it comes, in any order.

    Args:
        job: what is done.
        tasks: to do; begun in this order.
        seconds: how long one may take by the clock.
        silent: makes the result of a task whose process took longer, or died, from the task and the reason.
        title: of the progress bar.
        processes: how many; None for one a core, 0 for none but this one, without a limit of time.
    """
    bar = tqdm(total=len(tasks), desc=title, smoothing=0.02)
    count = min(len(tasks), (os.cpu_count() or 1) if processes is None else processes)
    if count == 0:
        for task in tasks:
            yield job.work(task)
            bar.update()
        return
    before = os.environ.copy()
    os.environ.update(dict.fromkeys(THREADS, "1"))  # each process has its core
    left = list(reversed(tasks))
    workers: list[_Worker[Task, Result]] = []
    try:
        workers += [_Worker(job) for _ in range(count)]
        while workers:
            soonest = min(worker.deadline for worker in workers)
            wait([worker.connection for worker in workers], max(soonest - time.monotonic(), 0.0))
            for worker in list(workers):
                for result in _heard(worker, seconds, silent):
                    bar.update()
                    yield result
                if worker.process.is_alive() and worker.ready and worker.task is None and left:
                    worker.give(left.pop(), seconds)
                elif worker.task is None and (worker.ready or not worker.process.is_alive()):
                    worker.end()
                    workers.remove(worker)
            workers += [_Worker(job) for _ in range(min(count, len(left)) - len(workers))]
    finally:
        for worker in workers:
            worker.end()
        os.environ.clear()
        os.environ.update(before)
        bar.close()


def _heard(worker: _Worker[Task, Result], seconds: float, silent: Callable[[Task, str], Result]) -> Iterator[Result]:
    """Yield the result of the worker's task if there is one; end the worker if it is too late or dead."""
    task = worker.task
    try:
        if worker.connection.poll():
            answer = worker.connection.recv()
            worker.ready, worker.task = True, None
            if answer is not None:
                yield answer[0]
            return
        if time.monotonic() < worker.deadline:
            return
        reason = f"no answer within {seconds:g} s"
    except (EOFError, ConnectionResetError):
        worker.process.join()
        reason = f"the process died, exit code {worker.process.exitcode}"
    if not worker.ready:
        raise RuntimeError(f"a process did not get ready: {reason}")
    worker.process.kill()
    worker.process.join()
    worker.task = None
    assert task is not None
    yield silent(task, reason)
