"""Check input; an error message says in one sentence what was given and what is allowed."""

import math
import operator
import os
import re
from collections.abc import Container, Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import NDArray

Range = tuple[float, float]
WIDEST = 1e12  # largest ratio of the upper to the lower end of a range that begins above 0
IDENTIFIER = re.compile("[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


class WrongTypeError(TypeError, ValueError):
    """A value has a wrong type: a TypeError, as usual in Python, and a ValueError, like other refused input."""


def shown(value: Any, longest: int = 200) -> str:
    """Return a value as one line of text; for a long value its type, and its beginning or shape."""
    try:
        text = " ".join(repr(value).split())
    except ValueError:  # an int of thousands of digits
        text = ""
    if text and len(text) <= longest:
        return text
    form = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else f"{text[:40]}..."
    return f"a long {type(value).__name__}, {form}"


def nearest(kind: str, name: str, known: Iterable[str]) -> str:
    """Return a message that no `kind`, such as "set-up", is called `name`, with a similar name or all known names."""
    names = sorted(known)
    near = get_close_matches(name, names, 1)
    return f"no {kind} {shown(name)}: " + (f"did you mean {near[0]}?" if near else f"there are {', '.join(names)}")


def unit_text(unit: str, preposition: str = "") -> str:
    """Return `preposition` and `unit` for a message; only the unit if it is in parentheses; "(no unit)" for "-"."""
    text = "(no unit)" if unit == "-" else unit
    return text if text.startswith("(") else f"{preposition}{text}"


def number(
    field: str, value: Any, unit: str, *, above: float = -math.inf, at_least: float = -math.inf,
    at_most: float = math.inf,
) -> float:  # fmt: skip
    """Return `value` as a float, or raise; the unit "-" means no unit.

    Raises:
        TypeError: `value` is not a number (a string, None, a bool, several numbers).
        ValueError: `value` is not finite, or not in (above, at_most] or [at_least, at_most].
    """
    if type(value) is float and above < value <= at_most and at_least <= value < math.inf:  # the usual case
        return value
    wrong = WrongTypeError(f"{field} must be a number {unit_text(unit, 'in ')}, got {shown(value)}")
    unit = unit_text(unit)
    kind = getattr(getattr(value, "dtype", None), "kind", "f")
    if isinstance(value, (str, bytes, bool)) or not hasattr(value, "__float__") or kind not in "fiu":
        raise wrong
    try:
        result = float(value)
    except OverflowError:  # an int too large for a float
        result = math.inf
    except (TypeError, ValueError):  # such as an array of several numbers
        raise wrong from None
    if math.isfinite(result) and above < result <= at_most and result >= at_least:
        return result
    limits = {"above": above, "at least": at_least, "at most": at_most}
    allowed = [f"{words} {limit:g}" for words, limit in limits.items() if math.isfinite(limit)]
    raise ValueError(f"{field} must be {' and '.join(['finite', *allowed])} {unit}, got {result!r} {unit}")


def numbers(field: str, values: Any, unit: str, **limits: float) -> tuple[float, ...]:
    """Return `values`, a sequence or an array of one dimension, as floats that `number` has checked."""
    kind = getattr(getattr(values, "dtype", None), "kind", "f")
    listed = hasattr(values, "__getitem__") and not isinstance(values, (str, bytes, Mapping, type))
    if not listed or getattr(values, "ndim", 1) != 1 or kind not in "fiuO":
        raise WrongTypeError(f"{field} must be a sequence of numbers {unit_text(unit, 'in ')}, got {shown(values)}")
    values = values.tolist() if hasattr(values, "tolist") else values
    return tuple(number(f"{field}[{place}]", value, unit, **limits) for place, value in enumerate(values))


def whole(field: str, value: Any, at_least: int) -> int:
    """Return `value` as an int; raise TypeError unless it is an integer, ValueError if it is below `at_least`."""
    kind = getattr(getattr(value, "dtype", None), "kind", "i")
    if isinstance(value, bool) or not hasattr(value, "__index__") or getattr(value, "ndim", 0) > 0 or kind not in "iu":
        raise WrongTypeError(f"{field} must be a whole number of at least {at_least}, got {shown(value)}")
    result = operator.index(value)
    if result < at_least:
        raise ValueError(f"{field} must be a whole number of at least {at_least}, got {shown(value)}")
    return result


def identifier(field: str, value: Any) -> str:
    """Return `value` if paths, links, pages and commands can contain it without quoting; otherwise raise ValueError."""
    if not isinstance(value, str) or not IDENTIFIER.fullmatch(value):
        allowed = "at most 100 letters a-z and A-Z, digits, '.', '_' and '-', beginning with a letter or a digit"
        raise ValueError(f"{field} must be {allowed}, got {value!r:.80}")
    return value


def fits_memory(field: str, count: int, each: int) -> None:
    """Raise ValueError if `count` items of `each` bytes exceed the memory of this machine."""
    if hasattr(os, "sysconf") and count * each > (most := os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")):
        needed = f"this needs {count * each / 2**30 if count < 10**15 else math.inf:,.0f} GiB"
        raise ValueError(
            f"{field} must fit into memory, got {shown(count)}: {needed}, this machine has {most / 2**30:,.0f} GiB"
        )


def flag(field: str, value: Any) -> None:
    """Raise TypeError unless `value` is True or False, of Python or NumPy."""
    if not isinstance(value, (bool, np.bool_)):
        raise WrongTypeError(f"{field} must be True or False, got {shown(value)}")


def distinct(field: str, values: Sequence[Any]) -> None:
    """Raise ValueError if two of `values` are equal."""
    for value in values:
        if values.count(value) > 1:
            raise ValueError(f"{field} must have no equal entries, got {shown(value)} twice")


def one_of(field: str, value: Any, *kinds: type[Any]) -> None:
    """Raise TypeError unless `value` is an instance of one of `kinds`."""
    if not isinstance(value, kinds):
        names = {type(None): "None", Mapping: "mapping", os.PathLike: "path"}
        wanted = " or ".join(names.get(kind, kind.__name__) for kind in kinds)
        article = "an" if wanted[0] in "AEIOaeio" else "a"
        raise WrongTypeError(f"{field} must be {article} {wanted}, got {shown(value)}")


def choice(field: str, value: Any, allowed: Container[str | None]) -> None:
    """Raise ValueError unless `value` is one of the `allowed` strings, or None if that is allowed."""
    if not isinstance(value, (str, type(None))) or value not in allowed:
        raise ValueError(f"{field} must be one of {allowed}, got {shown(value)}")


def array(
    field: str, values: Any, shape: tuple[int, ...] | None = None, kinds: str = "fiu", what: str = "numbers"
) -> NDArray[Any]:
    """Return `values` as an array. `what` describes the dtype kinds `kinds` in messages. Numbers need not be finite.

    Raise TypeError for rows of unequal length or a dtype whose kind is not in `kinds`, ValueError for another shape.
    """
    try:
        result = np.asarray(values)
    except (TypeError, ValueError):  # such as rows of different lengths
        raise WrongTypeError(f"{field} must hold {what} in rows of equal length, got {shown(values)}") from None
    if result.dtype.kind not in kinds:
        raise WrongTypeError(f"{field} must hold {what}, got dtype {result.dtype}: {shown(values)}")
    if shape is not None and result.shape != shape:
        raise ValueError(f"{field} must hold {what} in shape {shape}, got shape {result.shape}")
    return result


def rising(field: str, time: Sequence[float], name: str, values: Sequence[float]) -> None:
    """Raise ValueError unless the finite `time` (s) rises from 0 s and has 2 entries or more, as many as `values`."""
    if len(values) != len(time) or len(time) < 2:
        got = f"{len(time)} times and {len(values)} values"
        raise ValueError(f"{field} needs 2 or more times in s, each with a {name}, got {got}")
    if time[0] != 0.0 or np.any(np.diff(time) <= 0.0):
        place = int(np.argmax(np.diff(time) <= 0.0))
        raise ValueError(f"{field} must have times that rise from 0 s, got {time[place]!r} s and {time[place + 1]!r} s")


def interval(field: str, value: Any, unit: str, **limits: float) -> Range:
    """Return `value`, a number or a pair (low, high), as a pair, or raise TypeError or ValueError."""
    unit = unit_text(unit)
    if not (isinstance(value, (tuple, list)) or getattr(value, "ndim", 0) > 0):
        single = number(field, value, unit, **limits)
        return single, single
    if len(value) != 2:
        raise ValueError(f"{field} must be a number or a pair (low, high) {unit_text(unit, 'in ')}, got {shown(value)}")
    low, high = (number(f"{field}[{place}]", end, unit, **limits) for place, end in enumerate(value))
    if low > high:
        raise ValueError(f"{field} must not be inverted: low {low:g} is above high {high:g} {unit}")
    if low > 0 and not high / low <= WIDEST:
        raise ValueError(f"{field} must not span more than a factor {WIDEST:g}, got {low:g} to {high:g} {unit}")
    return low, high
