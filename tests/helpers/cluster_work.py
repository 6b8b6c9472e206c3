"""Functions that the tests of jobs call in other processes; each writes a line into a log."""

import errno
import os
import signal
import time
from pathlib import Path

import numpy as np

from agents.jobs import ONE_THREAD
from impact_gym.support.files import whole_file


def _called(log, number):
    with Path(log).open("a") as file:
        file.write(f"{number}\n")


def calls(log):
    return [*map(int, Path(log).read_text().split())] if Path(log).exists() else []


def numbers(log, number, seconds=0.0):
    """Return sums of many numbers, whose last bits depend on the order of summation."""
    _called(log, number)
    time.sleep(seconds)
    drawn = np.random.default_rng(number).standard_normal((64, 64))
    return {"product": drawn @ drawn.T, "number": number, "threads": [os.environ.get(name, "") for name in ONE_THREAD]}


def played(log, number):
    """Play some scenarios with the compiled kernels."""
    from agents.baselines import PaperTrapezoid  # takes 2 s, and other workers do not need it
    from agents.evaluate.scenario_batch import ScenarioBatch
    from impact_gym import kernels

    _called(log, number)
    batch = ScenarioBatch(1_000_000 + 25 * number, 25, threads=1)
    return {**vars(batch.play(PaperTrapezoid())), "where": kernels.__file__}


def ends_badly(log, number, how=""):
    """Fail, find the disk full, kill the process as the kernel does when memory runs out, or never end."""
    if how == "fails":
        raise ArithmeticError(f"no result for {number}")
    if how == "no room":
        with whole_file(Path(log)):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    result = numbers(log, number, 600.0 if how == "late" else 0.0)
    if how == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    return result
