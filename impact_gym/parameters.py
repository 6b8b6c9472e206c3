"""The base class of tools, motions, operators, channels, options and other dataclasses that check their fields."""

from collections.abc import Callable
from dataclasses import fields
from functools import cache, partial
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin

from impact_gym.quantities import BY_PATH, Limits, Quantity
from impact_gym.support.validation import Range, choice, flag, interval, number, numbers, one_of, whole


class SI:
    """Unit and limits in the annotation of a dataclass field, for a field that has no row in `quantities`."""

    def __init__(self, unit: str, **limits: float) -> None:
        self.unit, self.limits = unit, Limits(**limits)


Count = Annotated[int, SI("-", at_least=1)]
Index = Annotated[int, SI("-", at_least=0)]
Share = Annotated[float, SI("-", at_least=0, at_most=1)]


class Parameters:
    """Base class of dataclasses that check their numbers when an object is made, and store them as floats.

    The limits of a field come from the row "{path}.{field}" of `quantities` or from an annotation such as
    `Annotated[float, SI("m", above=0)]` or with a row of `quantities`. A number of the type int is whole; a `Range` may
    be one number. Fields of the types bool, str, Literal and a class like this are checked, too. Other fields without
    limits, and those in `checked_by_itself`, are not checked. A field with the default or a type None may be None. A
    sequence of numbers is stored as a tuple.
    """

    __slots__ = ()
    rows: ClassVar[str] = ""  # `path`, with which the paths of its rows in `quantities` begin
    checked_by_itself: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, path: str = "") -> None:
        if path:
            cls.rows = path

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


class Options(Parameters):
    """Base class of the options of commands and of tables in files: a message has only the name of the field."""


@cache
def _checks(kind: Any) -> list[tuple[str, bool, Callable[[Any], Any]]]:
    """Return (name, whether None is allowed, check) for each field that is checked."""
    checks: list[tuple[str, bool, Callable[[Any], Any]]] = []
    for field in fields(kind):
        name = field.name if issubclass(kind, Options) else f"{kind.__name__}.{field.name}"
        check = _check(name, field.type, f"{kind.rows}.{field.name}")
        if check and field.name not in kind.checked_by_itself:
            hint: Any = field.type
            allowed = get_args(hint.__origin__ if get_origin(hint) is Annotated else hint)
            checks.append((field.name, field.default is None or NoneType in allowed, check))
    return checks


def _check(name: str, hint: Any, path: str) -> Callable[[Any], Any] | None:
    """Return a function that checks a value, calls it `name` in messages, and returns it as it is stored; or None."""
    described = BY_PATH.get(path) or next(iter(getattr(hint, "__metadata__", ())), None)
    hint = hint.__origin__ if get_origin(hint) is Annotated else hint
    kinds = get_args(hint) if isinstance(hint, UnionType) else (hint,)  # such as float | None
    hint = kinds[0]
    if isinstance(described, SI | Quantity):
        by_type: dict[Any, Callable[..., Any]] = {float: number, int: _whole, Range: interval}
        return partial(by_type.get(hint, numbers), name, unit=described.unit, **described.limits._asdict())
    if hint is bool or hint is str or get_origin(hint) is Literal:
        return partial(_word, name, (hint,))
    return partial(_word, name, kinds) if isinstance(hint, type) and issubclass(hint, Parameters) else None


def _word(name: str, kinds: tuple[Any, ...], value: Any) -> Any:
    if get_origin(kinds[0]) is Literal:
        choice(name, value, get_args(kinds[0]))
    elif kinds[0] is bool:
        flag(name, value)
    else:
        one_of(name, value, *kinds)
    return value


def _whole(name: str, value: Any, unit: str, above: float, at_least: float, at_most: float) -> int:
    count = whole(name, value, int(at_least))
    number(name, count, unit, at_most=at_most)
    return count
