"""A job: a function by its name, and its arguments, as plain data that can be sent anywhere; and doing it."""

import hashlib
import inspect
import json
import pkgutil
import re
import traceback
from collections import Counter, deque
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.files import DiskFullError
from impact_gym.validation import WrongTypeError

Function = Callable[..., Any]  # a job's function may return anything: `perform` checks it
Result = dict[str, NDArray[Any]]
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment of every worker: each has one core, and sums are not split by how many there are."""


@dataclass(frozen=True)
class Job:
    """A call of an importable function that returns arrays by name.

    Raises:
        TypeError: arguments that JSON does not hold as they are (a tuple, an array, a key that is no string), or that
            the function does not take.
        ValueError: a function that is not importable; a number that is not finite.
    """

    function: str  # "module:name"
    arguments: Mapping[str, Any] = field(hash=False)  # keywords
    depends: str = ""  # digest of all else that determines the result, such as sources and the files that it reads

    def __post_init__(self) -> None:
        if not isinstance(self.depends, str):
            raise WrongTypeError(f"depends must be a string, got {self.depends!r}")
        if not isinstance(self.arguments, Mapping):
            raise WrongTypeError(f"arguments of {self.function} must be a mapping, got {self.arguments!r}")
        function = resolve(self.function)
        copied = _plain(self.function, dict(self.arguments))
        try:
            _signature(function).bind(**copied)
        except TypeError as error:
            raise WrongTypeError(f"{self.function} does not take {copied}: {error}") from None
        object.__setattr__(self, "arguments", copied)  # so that no later change of the caller's reaches it

    @property
    def key(self) -> str:
        """SHA-256 of what determines the result."""
        content = json.dumps([self.function, self.arguments, self.depends], sort_keys=True)
        return hashlib.sha256(content.encode()).hexdigest()

    def __str__(self) -> str:
        arguments = ", ".join(f"{name}={value!r}" for name, value in self.arguments.items())
        return f"{self.function}({arguments if len(arguments) <= 400 else arguments[:400] + '...'})"


@dataclass(frozen=True)
class Failure:
    """Why a job has no result."""

    reason: str
    trace: str = ""  # where the function raised


Answer = Result | Failure | DiskFullError
Answers = Generator[tuple[int, Answer], None, None]
Engine = Callable[[Sequence[Job], int], Answers]
"""Does jobs, each whose worker is lost up to so many times again; yields places in the list and answers, in any order.
Closing the iterator ends what is under way."""


class Queue:
    """Places of the jobs that wait for a worker, and how often each job's worker was lost."""

    def __init__(self, count: int, retries: int) -> None:
        self.waiting, self._losses, self._retries = deque(range(count)), Counter[int](), retries

    def lose(self, place: int, how: str) -> Failure | None:
        """Let a job whose worker was lost wait again, or return its failure where that was once too often."""
        self._losses[place] += 1
        if self._losses[place] <= self._retries:
            self.waiting.append(place)
            return None
        causes = "killed, out of memory, or unable to begin in a script without `if __name__ == '__main__':`"
        return Failure(f"its worker was lost {self._losses[place]} time(s), {causes}; the last time: {how}")


def perform(function: str, arguments: Mapping[str, Any]) -> Answer:
    """Call the function; a failure says what it raised. A full disk is not the job's failure: it ends the gathering."""
    try:
        return _checked(resolve(function)(**arguments))
    except DiskFullError as error:
        return error
    except (Exception, SystemExit) as error:
        return Failure(f"{type(error).__name__}: {error}", traceback.format_exc())


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


@lru_cache
def resolve(function: str) -> Function:
    """Return the function that "module:name" names.

    Raises:
        ValueError: it cannot be imported, or not by other processes.
    """
    if not isinstance(function, str) or not re.fullmatch(r"[\w.]+:\w+", function):
        raise WrongTypeError(f"function must be a string 'module:name' of a module's function, got {function!r}")
    if function.startswith("__main__:"):
        raise ValueError(f"function {function!r} is not importable elsewhere: put it into a module")
    try:
        resolved: Function = pkgutil.resolve_name(function)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(f"function {function!r} is not importable: {error}") from error
    if not callable(resolved):
        raise ValueError(f"function {function!r} is no function but {resolved!r}")
    return resolved


_signature = lru_cache(inspect.signature)


def _plain(function: str, arguments: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of the arguments as JSON gives them back, which must be what they are."""
    where = f"arguments of {function} must be"
    try:
        copied: dict[str, Any] = json.loads(json.dumps(arguments, allow_nan=False))
    except TypeError as error:
        raise WrongTypeError(f"{where} what JSON holds: {error}; got {arguments!r}") from None
    except ValueError as error:  # not finite, or a circle
        raise ValueError(f"{where} finite and what JSON holds: {error}") from None
    if copied != arguments:
        raise WrongTypeError(f"{where} what JSON holds (lists, string keys), got {arguments!r}")
    return copied
