"""Read and replace values in nested records (dataclass instances) by dotted path; make records from mappings."""

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass, replace
from typing import Any

from impact_gym.support.validation import WrongTypeError, shown

Tree = Mapping[str, Any]


def flatten(records: Tree, prefix: str = "") -> dict[str, float]:
    """Return the floats in nested records or mappings by dotted path; other values are left out."""
    numbers: dict[str, float] = {}
    for name, value in records.items():
        if isinstance(value, float):
            numbers[prefix + name] = value
        elif is_dataclass(value) or isinstance(value, Mapping):
            numbers |= flatten(parts(value), f"{prefix}{name}.")
    return numbers


def parts(record: Any) -> Tree:
    """Return the fields of a record or a mapping by name."""
    if isinstance(record, Mapping):
        return record
    return {field.name: getattr(record, field.name) for field in fields(record)}


def get(record: Any, path: str) -> Any:
    """Return the value at a dotted path in nested records or mappings."""
    for name in path.split("."):
        record = record[name] if isinstance(record, Mapping) else getattr(record, name)
    return record


def replaced(record: Any, numbers: Mapping[str, Any]) -> Any:
    """Return a copy of a record or mapping, with the values in `numbers` at their dotted paths."""
    groups = grouped(numbers).items()
    changes = {name: replaced(get(record, name), to) if isinstance(to, dict) else to for name, to in groups}
    return {**record, **changes} if isinstance(record, Mapping) else replace(record, **changes)


def grouped(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Turn {"a.b": value} into {"a": {"b": value}}; a path is split only at its first dot."""
    groups: dict[str, Any] = {}
    for path, value in numbers.items():
        first, dot, rest = path.partition(".")
        if dot:
            groups.setdefault(first, {})[rest] = value
        else:
            groups[first] = value
    return groups


def record_from(name: str, value: Any, allowed: tuple[type[Any], ...]) -> Any:
    """Return `value` if it is of an `allowed` class, or the record that a mapping of fields and "type" describes.

    "type" is the name of the class. If several classes are allowed, a mapping without "type" (as from
    `EnvSpec.to_json`) must have exactly the fields of one of them, and at least one field.
    """
    if isinstance(value, allowed):
        return value
    kinds = {kind.__name__: kind for kind in allowed}
    if isinstance(value, Mapping):
        given = {field: argument for field, argument in value.items() if field != "type"}
        named = {kind: [field.name for field in fields(of)] for kind, of in kinds.items()}
        fitting = [kind for kind in kinds if len(kinds) == 1 or (given and {*given} == {*named[kind]})]
        chosen = value.get("type", fitting[0] if fitting else None)
        if isinstance(chosen, str) and chosen in kinds:
            for field in given:
                if field not in named[chosen]:
                    raise WrongTypeError(
                        f"{name} has no field {shown(field)}; the fields of a {chosen} are {named[chosen]}"
                    )
            needed = [field.name for field in fields(kinds[chosen]) if field.default is MISSING]
            if absent := [field for field in needed if field not in given]:
                raise WrongTypeError(f"{name}, a {chosen}, needs the fields {absent} too")
            return kinds[chosen](**given)
    wanted = f"{' or '.join(kinds)}, or a mapping whose 'type' is one of {list(kinds)}"
    raise WrongTypeError(f"{name} must be a {wanted}, got {shown(value)}")
