"""A job: a function by its name, and its arguments, as plain data that can be sent anywhere and named by a digest."""

import hashlib
import importlib
import inspect
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from numpy.typing import NDArray

from impact_gym.validation import WrongTypeError

Result = dict[str, NDArray[Any]]


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
        called = resolve(self.function)
        copied = _plain(self.function, dict(self.arguments))
        try:
            _signature(called).bind(**copied)
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


@lru_cache
def resolve(function: str) -> Callable[..., Any]:
    """Return the function that "module:name" names.

    Raises:
        ValueError: it cannot be imported, or not by other processes.
    """
    if not isinstance(function, str):
        raise WrongTypeError(f"function must be a string 'module:name', got {function!r}")
    module, colon, name = function.partition(":")
    if not (module and colon and name.isidentifier()):
        raise ValueError(f"function must be 'module:name' of a module's function, got {function!r}")
    if module == "__main__":
        raise ValueError(f"function {function!r} is not importable elsewhere: put it into a module")
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(f"function {function!r} is not importable: {error}") from error
    if not callable(found):
        raise ValueError(f"function {function!r} is no function but {found!r}")
    return found


_signature = lru_cache(inspect.signature)


def _plain(function: str, arguments: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of the arguments as JSON gives them back, which must be what they are."""
    where = f"arguments of {function} must be"
    try:
        copied = json.loads(json.dumps(arguments, allow_nan=False))
        if copied == arguments:
            return copied
    except TypeError as error:
        raise WrongTypeError(f"{where} what JSON holds: {error}; got {arguments!r}") from None
    except ValueError as error:  # not finite, or a circle
        raise ValueError(f"{where} finite and what JSON holds: {error}") from None
    raise WrongTypeError(f"{where} what JSON holds (lists, string keys), got {arguments!r}")
