"""What an operator and the channels make of a task: whether they fit, and how the compiled program has them."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.kernels import LONGEST_JITTER
from impact_gym.operators import KINDS, Channel

WAYS = ("uplink", "downlink")


def checked(task: Any) -> dict[str, Channel]:
    """Return the channels of a `Task` with an operator; where none was given a perfect one.

    Raises:
        ValueError: something that only an operator has without one, or an operator whom the arm cannot follow.
    """
    if task.operator is None:
        if task.uplink or task.downlink or task.taken_weight:
            raise ValueError("uplink, downlink and taken_weight must be None, None and 0 without an operator")
        return {}
    for way in WAYS:
        if (delay := longest(task, way, "delay")) >= task.horizon:
            raise ValueError(f"{way}.delay must be below the horizon, {task.horizon:g} s, got {delay:g} s")
    if not task.friction or task.drawn.get("friction", (1.0, 1.0))[0] == 0.0:
        raise ValueError("friction must be above 0 (no unit) with an operator: else an object never rests")
    fastest, limit = max(longest(task, "operator", "speed"), task.operator.fastest), task.velocity_range[1]
    if fastest > limit:
        raise ValueError(f"operator.speed must be at most that of the arm, {limit:g} m/s, got {fastest:g} m/s")
    if 0.0 < getattr(task.operator, "length", 0.0) < task.horizon:
        raise ValueError(
            f"Replay.length must be at least the horizon, {task.horizon:g} s, got {task.operator.length!r} s"
        )
    return {way: getattr(task, way) or Channel() for way in WAYS}


def longest(task: Any, part: str, name: str) -> float:
    """Return the largest value of a number of a task's operator or channel, 0 if it has none."""
    value = getattr(getattr(task, part), name, 0.0)
    return float(task.drawn.get(f"{part}.{name}", (value, value))[1])


def lowered(task: Any, record: NDArray[Any], begin: int) -> list[NDArray[np.float64]]:
    """Write a task's operator and channels into its record (1,), TASK; return their tables, the first at `begin`."""
    if task.operator is None:
        return []
    record["operator_kind"] = KINDS[type(task.operator)]
    for part in ("operator", *WAYS):
        numbers = record["numbers"][part]
        for name in numbers.dtype.names or ():
            numbers[name] = getattr(getattr(task, part), name, None) or 0.0
    tables = [task.operator.table, task.uplink.table, task.downlink.table]
    for name, points in zip(("replay", *WAYS), tables, strict=True):
        count = len(points) // 2
        record[name] = begin, count, points[count - 1] if count else 0.0
        begin += len(points)
    record["replay"]["length"] = getattr(task.operator, "length", 0.0)
    return tables


def packets_under_way(task: Any) -> int:
    """Return how many commands must be kept: those on their way, and where the flange was for who sees it late."""
    if task.operator is None:
        return 0
    late = [LONGEST_JITTER * max(longest(task, way, "jitter"), longest(task, way, "tail")) for way in WAYS]
    up, down = (longest(task, way, "delay") + max((0.0, *getattr(task, way).delays)) for way in WAYS)
    most = max(up + late[0], down + late[1] + longest(task, "operator", "reaction"))
    return math.ceil(min(most, task.horizon) / task.control_period) + 4
