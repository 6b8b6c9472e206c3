"""The arguments of the task in the signatures of all front ends, declared once, in `Task`."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec

from impact_gym.task.task import ARGUMENTS
from impact_gym.validation import WrongTypeError, shown

P = ParamSpec("P")


def with_task_arguments(**without: str) -> Callable[[Callable[P, None]], Callable[P, None]]:
    """Return a decorator of constructors, whose `**arguments` become those of `Task`.

    They are in the signature that `inspect` and `help` show, with their defaults. Those in `without` are refused, for
    the reason given there.
    """

    def decorate(constructor: Callable[P, None]) -> Callable[P, None]:
        own = inspect.signature(constructor)
        parameters = [p for p in own.parameters.values() if p.kind is not inspect.Parameter.VAR_KEYWORD]
        task = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=item.default, annotation=item.type)
            for name, item in ARGUMENTS.items()
            if name not in without
        ]
        names = {parameter.name for parameter in (*parameters, *task)} - {"self"}

        @wraps(constructor)
        def checked(*given: P.args, **options: P.kwargs) -> None:
            for name in options:
                if name in without:
                    raise WrongTypeError(f"{name} {without[name]}")
                if name not in names:
                    known = [name for name in (*ARGUMENTS, *own.parameters) if name in names]
                    raise WrongTypeError(f"unknown argument {shown(name)}; allowed are {', '.join(known)}")
            constructor(*given, **options)

        checked.__signature__ = own.replace(parameters=[*parameters, *task])  # type: ignore[attr-defined]
        return checked

    return decorate
