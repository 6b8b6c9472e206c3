"""Jobs on this machine: processes that each do one job at a time, so that it is known whose process was lost."""

import math
import multiprocessing
import os
import signal
import threading
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from time import monotonic
from unittest.mock import patch

from agents.jobs.job import ONE_THREAD, Answer, Answers, Failure, Job, Queue, perform, resolve

SPAWN = multiprocessing.get_context("spawn")
LOOKING_EVERY = 0.1  # s, for jobs that are late
PATIENCE = 1.0  # s, for a process whose connection has broken to end by itself


def run(jobs: Sequence[Job], retries: int, *, processes: int | None = None, seconds: float | None = None) -> Answers:
    """Do jobs in so many processes; see `agents.jobs.job.Engine` and `agents.jobs.gather`."""
    limit = math.inf if seconds is None else seconds
    count = min(len(jobs), (os.cpu_count() or 1) if processes is None else processes)
    if count == 0:
        for place, job in enumerate(jobs):
            yield place, perform(job.function, job.arguments)
        return
    queue = Queue(len(jobs), retries)
    workers = [_Worker() for _ in range(count)]
    busy: dict[_Worker, int] = {}

    def give(worker: _Worker) -> None:
        if queue.waiting:
            busy[worker] = queue.waiting.popleft()
            worker.begin(jobs[busy[worker]])

    try:
        for worker in workers:
            give(worker)
        while busy:
            wait([worker.connection for worker in busy], LOOKING_EVERY)
            for worker, place in list(busy.items()):
                answer: Answer | None
                try:
                    answer = worker.answer(limit)
                    if answer is None:
                        continue
                except (EOFError, OSError):
                    answer = queue.lose(place, f"its process ended with exit code {worker.end(PATIENCE)}")
                del busy[worker]
                give(worker)  # first, so that the process works while the answer is dealt with
                if answer is not None:
                    yield place, answer
    finally:
        for worker in workers:
            worker.end()


class _Worker:
    """A process that does one job at a time; a fresh one where it was lost."""

    connection: Connection

    def __init__(self) -> None:
        self._process: SpawnProcess | None = None
        self._began = math.inf  # s

    def begin(self, job: Job) -> None:
        """Give it a job; the process starts afresh (a fork would inherit threads and locks), one thread for libraries.

        It is a daemon, so that a gathering that nobody finished does not keep the interpreter from ending.
        """
        if self._process is None or not self._process.is_alive():
            self.end()
            self.connection, other_end = multiprocessing.Pipe()
            with patch.dict(os.environ, ONE_THREAD):
                self._process = SPAWN.Process(target=_work, args=[other_end], daemon=True)
                self._process.start()
            other_end.close()
        self._began = math.inf
        with suppress(OSError):  # lost just now, which `answer` finds out
            self.connection.send((job.function, job.arguments))

    def answer(self, limit: float) -> Answer | None:
        """Return the answer to the job, a failure after `limit` seconds of work, or None while there is none.

        Starting the process, and importing the function, does not count as work.

        Raises:
            EOFError, OSError: the process was lost.
        """
        if self.connection.poll():
            answer: Answer | None = self.connection.recv()
            if answer is not None:
                return answer
            self._began = monotonic()
        if monotonic() - self._began <= limit:
            return None
        self.end()  # compiled code listens to nothing else
        return Failure(f"no answer within {limit:g} s")

    def end(self, patience: float = 0.0) -> int | None:
        """End the process, whatever it is doing, after so many seconds at the most; return its exit code."""
        if self._process is None:
            return None
        self._process.join(patience)
        self._process.kill()
        self._process.join()
        code, self._process = self._process.exitcode, None
        self.connection.close()
        return code


def _work(connection: Connection) -> None:
    """Do the jobs that come; leave Ctrl-C to the gathering process, and end with it however it ends."""

    def end_with_parent() -> None:
        parent = multiprocessing.parent_process()
        if parent:
            parent.join()
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end_with_parent, daemon=True).start()
    while True:
        function, arguments = connection.recv()
        with suppress(Exception):  # `perform` says what is wrong with it
            resolve(function)
        connection.send(None)  # it begins
        connection.send(perform(function, arguments))
