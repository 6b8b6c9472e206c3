"""Doing one job, wherever: a result or a failure as a value, so that one bad job spoils no batch."""

import traceback
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.jobs.job import Job, Result, resolve

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment of every worker: each has one core, and sums are not split by how many there are."""


@dataclass(frozen=True)
class Failure:
    """Why a job has no result."""

    reason: str
    trace: str = ""  # where the function raised


Answer = Result | Failure
Answers = Generator[tuple[int, Answer], None, None]
Engine = Callable[[Sequence[Job], int], Answers]
"""Does jobs, each whose worker is lost up to so many times again; yields places in the list and answers, in any order.
Closing the iterator ends what is under way."""


def perform(function: str, arguments: Mapping[str, Any]) -> Answer:
    """Call the function; a failure says what it raised."""
    try:
        return _checked(resolve(function)(**arguments))
    except (Exception, SystemExit) as error:
        return Failure(f"{type(error).__name__}: {error}", traceback.format_exc())


def lost(times: int, how: str) -> Failure:
    """Return the failure of a job whose worker was lost too often."""
    causes = "killed, out of memory, or unable to begin in a script without `if __name__ == '__main__':`"
    return Failure(f"its worker was lost {times} time(s), {causes}; the last time: {how}")


def _checked(result: Any) -> Result:
    """Return the result if it is one that an archive holds."""
    if not isinstance(result, dict):
        raise TypeError(f"a job's function must return arrays by name, got {type(result).__name__}")
    for name, array in result.items():
        if not isinstance(name, str) or not name.isidentifier() or name in ("header", "file"):
            raise ValueError(f"an array of a result must be named by a word other than header and file, got {name!r}")
        if not isinstance(array, np.ndarray) or array.dtype.hasobject:
            raise TypeError(f"{name!r} of a result must be an array without objects, got {type(array).__name__}")
    return result
