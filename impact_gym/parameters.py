"""The base class of tools, motions, operators, channels and other dataclasses that check their numbers."""

from collections.abc import Callable
from dataclasses import fields
from functools import cache, partial
from typing import Any, ClassVar

from impact_gym.quantities import BY_PATH
from impact_gym.support.validation import number, numbers


class SI:
    """Unit and limits in the annotation of a dataclass field, for a field that has no row in `quantities`."""

    def __init__(self, unit: str, **limits: float) -> None:
        self.unit, self.limits = unit, limits


class Parameters:
    """Base class of dataclasses that check their numbers when an object is made, and store them as floats.

    The limits of a field come from the row "{path}.{field}" of `quantities` or from an annotation such as
    `Annotated[float, SI("m", above=0)]`. A field without limits, or in `checked_by_itself`, is not checked. A field
    with the default None may be None. A sequence of numbers is stored as a tuple.
    """

    __slots__ = ()
    path: ClassVar[str] = ""
    checked_by_itself: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, path: str = "") -> None:
        if path:
            cls.path = path

    def __post_init__(self) -> None:
        kind: Any = type(self)  # Any: mypy wrongly considers a dataclass unhashable
        for name, optional, check in _checks(kind):
            value = getattr(self, name)
            if value is not None or not optional:
                object.__setattr__(self, name, check(value))

    def fits(self) -> Any:
        """Return whether the numbers, which may be arrays, fit together. A class with checks of its own overrides it.

        False, as here for such a class, only means that a sweep makes a record of each row, which then checks itself.
        """
        return type(self).__post_init__ is Parameters.__post_init__


@cache
def _checks(kind: Any) -> list[tuple[str, bool, Callable[[Any], Any]]]:
    """Return (name, whether None is allowed, check) for each number that is not in `checked_by_itself`."""
    checks: list[tuple[str, bool, Callable[[Any], Any]]] = []
    for field in fields(kind):
        hint: Any = field.type
        if row := BY_PATH.get(f"{kind.path}.{field.name}"):
            unit, limits = row.unit, row.limits._asdict()
        elif annotated := getattr(hint, "__metadata__", ()):
            unit, limits, hint = annotated[0].unit, annotated[0].limits, hint.__origin__
        else:
            continue
        if field.name not in kind.checked_by_itself:
            check = number if hint in (float, float | None) else numbers
            name = f"{kind.__name__}.{field.name}"
            checks.append((field.name, field.default is None, partial(check, name, unit=unit, **limits)))
    return checks
