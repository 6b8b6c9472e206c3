"""Functions that read the tables of a set-up's file."""

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from difflib import get_close_matches
from typing import Any, TypeVar

from impact_gym.quantities import SCENARIO
from impact_gym.support.validation import shown

Record = TypeVar("Record")
MOVED = {f"environment.{row.id}": f"environment.scenario.{row.id}" for row in SCENARIO}  # wrong keys, and right ones
MOVED |= {"environment.time_weight": "training.time_weight", "environment.privileged": "training.informed_critic"}
MOVED["scenario"] = "environment.scenario"


@contextmanager
def prefixed_errors(place: str) -> Iterator[None]:
    """Turn a RuntimeError, TypeError or ValueError of the `with` block into a ValueError that begins with `place`."""
    try:
        yield
    except (RuntimeError, TypeError, ValueError) as error:
        raise ValueError(f"{place}: {error}") from error


def refuse_unknown(prefix: str, given: Iterable[str], allowed: Iterable[str], kind: str = "key") -> None:
    """Raise ValueError for the first key, or name of another `kind`, that is not allowed."""
    names = sorted(allowed) if isinstance(allowed, (set, frozenset)) else list(allowed)
    for key in given:
        if key not in names:
            nearest = [MOVED[prefix + key]] if prefix + key in MOVED else get_close_matches(key, names, 1)
            meant = f"; did you mean {nearest[0]!r}?" if nearest else "."
            raise ValueError(f"unknown {kind} {prefix}{shown(key)[1:-1]}{meant} Known are {', '.join(names)}")


def from_table(kind: type[Record], content: Mapping[str, Any], place: str, others: Iterable[str] = ()) -> Record:
    """Return the dataclass `kind` with the fields in a table (lists become tuples); `others` are further known keys."""
    refuse_unknown(f"{place}.", content, [*others, *(item.name for item in fields(kind))])  # type: ignore[arg-type]
    with prefixed_errors(place):
        return kind(**{name: tuple(value) if isinstance(value, list) else value for name, value in content.items()})


def table(content: Mapping[str, Any], name: str, prefix: str = "") -> dict[str, Any]:
    """Return a table of a file; empty if the file does not have this table."""
    value = content.get(name, {})
    if not isinstance(value, dict):
        raise ValueError(f"{prefix}{name} must be a table, [{prefix}{name}], got {shown(value)}")
    return value


def text(content: Mapping[str, Any], name: str, otherwise: str, prefix: str = "") -> str:
    """Return the text of a key, by default `otherwise`; the text must be one line."""
    value = content.get(name, otherwise)
    if not isinstance(value, str) or not re.fullmatch(r"[^\x00-\x1f\x7f]+", value):
        raise ValueError(f"{prefix}{name} must be a text in one line, got {value!r:.80}")
    return value
