"""Functions that the tests of jobs call in other processes: each leaves a line in a file when it is called."""

import os
import signal
import time
from pathlib import Path

import numpy as np

from agents.jobs.work import ONE_THREAD


def _called(log, number):
    with Path(log).open("a") as file:
        file.write(f"{number} {os.getppid()}\n")


def begun(log):
    """Return the jobs that were begun, in order: number, and the process that started the worker, one for a node."""
    lines = Path(log).read_text().splitlines() if Path(log).exists() else []
    return [tuple(map(int, line.split())) for line in lines]


def calls(log):
    """Return the numbers of these jobs."""
    return [number for number, _ in begun(log)]


def numbers(log, number, seconds=0.0):
    """Return what a sum over many numbers rounds to, so that a result in another order would show."""
    _called(log, number)
    time.sleep(seconds)
    drawn = np.random.default_rng(number).standard_normal((64, 64))
    return {"product": drawn @ drawn.T, "number": np.array(number)}


def fails_on(log, number, bad):
    """Raise where the number is bad."""
    if number in bad:
        raise ArithmeticError(f"no result for {number}")
    return numbers(log, number)


def kills_itself(log, number, times):
    """Die as if out of memory, the first so many times."""
    _called(log, number)
    if calls(log).count(number) <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"number": np.array(number)}


def no_arrays():
    """Return what is no result."""
    return {"value": 1.0}


def played(log, number, controller, first, count):
    """Play a slice of the frozen validation set."""
    from agents.evaluate.play import play  # 2 s, which every other worker does without

    _called(log, number)
    return play(controller, {"set": "validation", "first": first, "count": count}) | {"where": np.array(__file__)}


def large(log, number, megabytes):
    """Return more than a cluster sends with its answer: it stays on the node until it is fetched."""
    _called(log, number)
    time.sleep(0.1)
    return {"values": np.random.default_rng(number).random(int(megabytes * 1e6 / 8)), "where": np.array(__file__)}


def threads():
    """Return what the environment of this process says of threads."""
    return {"threads": np.array([os.environ.get(name, "") for name in ONE_THREAD])}
