"""Functions that the tests of jobs call in other processes; each call writes a line into a log."""

import errno
import os
import signal
import time
from pathlib import Path

import numpy as np

from agents.jobs import ONE_THREAD
from impact_gym.files import whole_file


def _called(log, number):
    with Path(log).open("a") as file:
        file.write(f"{number}\n")


def calls(log):
    """Return the numbers of the started calls, in their order."""
    return [*map(int, Path(log).read_text().split())] if Path(log).exists() else []


def kept(folder):
    """Return the stored results below a folder, each with its time of writing."""
    return {path: path.stat().st_mtime_ns for path in folder.glob("**/*.pkl")}


def numbers(log, number, seconds=0.0):
    """Return sums of many numbers, whose last bits depend on the order of summation."""
    _called(log, number)
    time.sleep(seconds)
    drawn = np.random.default_rng(number).standard_normal((64, 64))
    threads = [os.environ.get(name, "") for name in ONE_THREAD]
    return {"product": drawn @ drawn.T, "number": number, "threads": threads}


def played(log, number, count):
    """Play some scenarios of the validation set with the compiled kernels."""
    from agents.evaluate.play import play  # takes 2 s, and other workers do not need it
    from impact_gym import kernels

    _called(log, number)
    scenarios = {"ranges": "train", "seed": 1_000_000 + count * number, "count": count}
    return {**play({"baseline": "paper-trapezoid"}, scenarios), "where": kernels.__file__}


def fails_on(log, number, bad):
    """Raise an error if the number is bad."""
    if number in bad:
        raise ArithmeticError(f"no result for {number}")
    return numbers(log, number)


def kills_itself(log, number):
    """Kill the process, as the kernel does when memory runs out."""
    _called(log, number)
    os.kill(os.getpid(), signal.SIGKILL)


def finds_no_room(path):
    """Write a file to a full disk."""
    with whole_file(Path(path)):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
