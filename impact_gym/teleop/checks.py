"""Whether operator and channels fit a task, and their records for the compiled program."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.kernels import LONGEST_JITTER, WITHDRAWAL_FADE
from impact_gym.teleop.channels import LOST, Channel
from impact_gym.teleop.operators import KINDS
from impact_gym.validation import Range, shown

WAYS = ("uplink", "downlink")
LONGEST_SPACING, SLOWEST_PING = 200, 2.0  # control periods, or s, between the packets of a trace
FADE: float = WITHDRAWAL_FADE  # s, in which a withdrawal ends


def checked(task: Any) -> dict[str, Channel]:
    """Return the channels of a `Task` with an operator; perfect ones where none were given.

    Raises:
        ValueError: channels without an operator, or an operator whom the arm cannot follow.
    """
    if task.operator is None:
        if task.uplink or task.downlink:
            raise ValueError("uplink and downlink must be None without an operator")
        return {}
    low, high = task.velocity_range
    if low > 0.0:
        raise ValueError(f"velocity_range must not begin above 0 m/s with an operator, who stops by 0, got {low:g} m/s")
    if not task.friction or task.drawn.get("friction", (1.0, 1.0))[0] == 0.0:
        raise ValueError("friction must be above 0 (no unit) with an operator: else an object never rests")
    for name in ("speed", "creep"):
        if (fastest := ends(task, "operator", name)[1]) > high:
            raise ValueError(f"operator.{name} must be at most that of the arm, {high:g} m/s, got {fastest:g} m/s")
    for velocity in task.operator.recorded:
        if not low <= velocity <= high:
            raise ValueError(f"Replay.velocity must be {low:g} to {high:g} m/s, as the arm's, got {velocity:g} m/s")
    if 0.0 < getattr(task.operator, "length", 0.0) < task.horizon:
        length = task.operator.length
        raise ValueError(f"Replay.length must be at least the horizon, {task.horizon:g} s, got {length!r} s")
    channels = {way: getattr(task, way) or Channel() for way in WAYS}
    for way, channel in channels.items():
        delay, jitter, tail = (ends(task, way, name)[1] for name in ("delay", "jitter", "tail"))
        mean = delay + max(jitter + share * (tail - jitter) for share in ends(task, way, "tail_share"))
        late, note = max(mean, *channel.delays, 0.0), " with the mean jitter" if mean > delay else ""
        of, note = ("trace", ": is it in ms?") if channel.trace else ("delay", note)
        if late >= task.horizon:
            raise ValueError(f"{way}.{of} must be below the horizon, {task.horizon:g} s, got {late:g} s{note}")
        apart = float(np.median(np.diff([time for time, _ in channel.trace]))) if channel.trace else 0.0
        if apart > (most := max(LONGEST_SPACING * task.control_period, SLOWEST_PING)):
            raise ValueError(f"{way}.trace must have a packet each {most:g} s or more often beside a control period of "
                             f"{task.control_period:g} s, got one each {apart:g} s: is it in ms?")  # fmt: skip
    if (timeout := channels["downlink"].timeout) != Channel().timeout:
        raise ValueError(f"downlink.timeout must be left out: the uplink's alone stops the arm, got {timeout:g} s")
    return channels


def without_files(environment: Mapping[str, Any]) -> dict[str, Any]:
    """Return arguments of an environment from an untrusted file; it may not name files to read.

    Raises:
        ValueError: a channel's trace is the name of a file or an URL instead of rows.
    """
    for way in WAYS:
        channel = environment.get(way)
        if isinstance(channel, Mapping) and isinstance(trace := channel.get("trace"), str):
            raise ValueError(f"{way}.trace must be rows of time and delay in s, got {shown(trace)}: no file is read")
    return dict(environment)


def ends(task: Any, part: str, name: str) -> Range:
    """Return the least and the largest value of a number of a task's operator or channel, 0 if it has none."""
    value = getattr(getattr(task, part), name, 0.0)
    return task.drawn.get(f"{part}.{name}", (value, value))


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
        times, values = points.reshape(2, count)
        length = times[-1] if count else 0.0
        kept = values < LOST
        mean = np.trapezoid(values[kept], times[kept]) / np.ptp(times[kept]) if count else 0.0
        record[name] = begin, count, length, mean
        begin += len(points)
    record["replay"]["length"] = getattr(task.operator, "length", 0.0)
    return tables


def packets_under_way(task: Any) -> int:
    """Return how many packets must be kept: those in transit, and those that the operator sees late."""
    if task.operator is None:
        return 0
    late = [LONGEST_JITTER * max(ends(task, way, name)[1] for name in ("jitter", "tail")) for way in WAYS]
    up, down = (ends(task, way, "delay")[1] + max((0.0, *getattr(task, way).delays)) for way in WAYS)
    most = max(up + late[0], down + late[1] + ends(task, "operator", "reaction")[1])
    return math.ceil(min(most, task.horizon) / task.control_period) + 4
