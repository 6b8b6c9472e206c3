"""Jobs on this machine: processes that each do one job at a time, so that it is known whose process was lost."""

import math
import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from time import monotonic
from unittest.mock import patch

from agents.jobs.job import Job, resolve
from agents.jobs.work import ONE_THREAD, Answer, Answers, Failure, lost, perform

LOOKING_EVERY = 0.1  # s, for jobs that are late


def run(jobs: Sequence[Job], retries: int, *, processes: int | None = None, seconds: float | None = None) -> Answers:
    """Do jobs in so many processes; see `agents.jobs.work.Engine` and `agents.jobs.gather`."""
    limit = math.inf if seconds is None else seconds
    count = min(len(jobs), (os.cpu_count() or 1) if processes is None else processes)
    if count == 0:
        for place, job in enumerate(jobs):
            yield place, perform(job.function, job.arguments)
        return
    waiting, losses = deque(range(len(jobs))), Counter[int]()
    slots = [_Slot() for _ in range(count)]
    busy: dict[Future[Answer], tuple[_Slot, int]] = {}

    def give(slot: _Slot) -> None:
        if waiting:
            place = waiting.popleft()
            busy[slot.begin(jobs[place])] = slot, place

    try:
        for slot in slots:
            give(slot)
        while busy:
            over = wait(busy, LOOKING_EVERY, FIRST_COMPLETED).done
            late = {future for future, (slot, _) in busy.items() if slot.worked() > limit}
            for future in over | late:
                slot, place = busy.pop(future)
                try:
                    answer = future.result(timeout=0.0)
                except TimeoutError:
                    slot.end()  # compiled code listens to nothing else
                    answer = Failure(f"no answer within {limit:g} s")
                except BrokenProcessPool as error:
                    losses[place] += 1
                    slot.end()
                    if losses[place] <= retries:
                        waiting.append(place)
                        give(slot)
                        continue
                    answer = lost(losses[place], str(error))
                give(slot)  # first, so that the process works while the answer is dealt with
                yield place, answer
    finally:
        for slot in slots:
            slot.end()


class _Slot:
    """A process that does one job at a time; a fresh one where it was lost."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._process: Future[int] = Future()
        self._ready: Future[None] = Future()
        self._began = math.inf  # s

    def begin(self, job: Job) -> Future[Answer]:
        try:
            answer = self._running(job).submit(perform, job.function, job.arguments)
        except BrokenProcessPool:  # lost while it had nothing to do
            self.end()
            answer = self._running(job).submit(perform, job.function, job.arguments)
        self._began = math.inf
        self._ready.add_done_callback(self._begin_to_count)
        return answer

    def worked(self) -> float:
        """Return for how long it has been at its job, s; starting the process does not count."""
        return monotonic() - self._began

    def _begin_to_count(self, _: Future[None]) -> None:
        self._began = monotonic()

    def _running(self, job: Job) -> ProcessPoolExecutor:
        """Return the process, started afresh (a fork would inherit threads and locks) with one thread for libraries."""
        if self._pool is None:
            with patch.dict(os.environ, ONE_THREAD):
                self._pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _prepare)
                self._process = self._pool.submit(os.getpid)
                self._ready = self._pool.submit(_load, job.function)
        return self._pool

    def end(self) -> None:
        """End the process, whatever it is doing."""
        if self._pool is None:
            return
        with suppress(BrokenProcessPool, ProcessLookupError):
            os.kill(self._process.result(), signal.SIGKILL)
        self._pool.shutdown(cancel_futures=True)
        self._pool = None


def _prepare() -> None:
    """Leave Ctrl-C to the gathering process, and end with it however it ends."""

    def end_with_parent() -> None:
        multiprocessing.parent_process().join()
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end_with_parent, daemon=True).start()


def _load(function: str) -> None:
    """Import what a job needs, which takes seconds where it is large; `perform` says why it cannot be."""
    with suppress(Exception, SystemExit):
        resolve(function)
