"""Arguments of an environment as plain data: what it is made with, by dotted path, and the same with other numbers."""

from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from typing import Any

from impact_gym.task.paths import nested
from impact_gym.task.task import Task, arguments


def flat(environment: Mapping[str, Any]) -> dict[str, Any]:
    """Return all that an environment is made with but its scenario, by dotted path; ranges as they were given."""
    task, by_path = Task(**environment), dict[str, Any]()
    for name in arguments():
        record = getattr(task, name)
        if name != "scenario":
            by_path[name] = environment.get(name, record)
        if is_dataclass(record) and name != "scenario":
            by_path |= {f"{name}.{part}": value for part, value in _table(environment, name, record).items()}
    return by_path


def changed(environment: Mapping[str, Any], numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return an environment's arguments with others, by dotted path; a part of a coupling leaves its other parts."""
    task, result = Task(**environment), dict(environment)
    for name, value in nested(numbers).items():
        if any(path.startswith(f"{name}.") for path in numbers):
            record = getattr(task, name)
            value = {"type": type(record).__name__, **_table(environment, name, record), **value}
        result[name] = value
    return result


def _table(environment: Mapping[str, Any], name: str, record: Any) -> dict[str, Any]:
    """Return the parts of a coupling or a robot, as they were given where that was a mapping."""
    given = environment.get(name)
    own = given if isinstance(given, Mapping) else {}
    parts = asdict(record) | {part: value for part, value in own.items() if part != "type"}
    return {part: value for part, value in parts.items() if value is not None}
