"""Numbers of nested records by dotted paths: `coupling.stiffness`, `motion.brake.delay`."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

Tree = Mapping[str, Any]


def flatten(records: Tree, prefix: str = "") -> dict[str, float]:
    """Return the numbers in records, or in mappings of them, by their dotted paths, in order."""
    numbers: dict[str, float] = {}
    for name, value in records.items():
        if isinstance(value, float):
            numbers[prefix + name] = value
        elif is_dataclass(value) or isinstance(value, Mapping):
            numbers |= flatten(parts(value), f"{prefix}{name}.")
    return numbers


def parts(record: Any) -> Tree:
    """Return the fields of a record, or of a mapping, by name."""
    if isinstance(record, Mapping):
        return record
    return {field.name: getattr(record, field.name) for field in fields(record)}


def get(record: Any, path: str) -> Any:
    """Return what is at a dotted path of a record or of mappings of records."""
    for name in path.split("."):
        record = record[name] if isinstance(record, Mapping) else getattr(record, name)
    return record


def replaced(record: Any, numbers: Mapping[str, Any]) -> Any:
    """Return a record, or a mapping of records, with other `numbers` by path; each record is made once."""
    groups = nested(numbers).items()
    changes = {name: replaced(get(record, name), to) if isinstance(to, dict) else to for name, to in groups}
    return {**record, **changes} if isinstance(record, Mapping) else replace(record, **changes)


def nested(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by dotted path as mappings in mappings; what has no dot stays."""
    groups: dict[str, Any] = {}
    for path, value in numbers.items():
        first, dot, rest = path.partition(".")
        if dot:
            groups.setdefault(first, {})[rest] = value
        else:
            groups[first] = value
    return groups
