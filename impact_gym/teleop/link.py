"""The link of a task (its operator and channels), and checks that the link fits the task."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_gym.kernels import LONGEST_JITTER, WITHDRAWAL_FADE
from impact_gym.support.column_names import unit_hint
from impact_gym.support.validation import Range
from impact_gym.teleop.channels import LEAST_USUAL, LOST, WAYS, Channel
from impact_gym.teleop.operators import KINDS, Operator, Replay

# limits of the median time between a trace's packets, in control periods and in s; the longer limit applies
LONGEST_SPACING, SLOWEST_PING = 200, 2.0
FADE: float = WITHDRAWAL_FADE  # s, time in which a withdrawal falls to 0


class Link(NamedTuple):
    """Operator and channels of a task."""

    operator: Operator
    uplink: Channel
    downlink: Channel
    drawn: Mapping[str, Range]  # ranges from which episodes draw numbers of the set-up, by dotted path

    def ends(self, part: str, name: str) -> Range:
        """Return least and largest value of `name` in `part`, the operator or a channel; 0, 0: no such number."""
        value = getattr(getattr(self, part), name, 0.0)
        return self.drawn.get(f"{part}.{name}", (value, value))

    def check(self, velocity_range: Range, friction: float | None, horizon: float, control_period: float) -> None:
        """Raise ValueError if operator, channels, arm and times do not fit together."""
        low, high = velocity_range
        if low > 0.0:
            raise ValueError(f"velocity_range must not begin above 0 m/s with an operator, got {low:g} m/s")
        if not friction or self.drawn.get("friction", (1.0, 1.0))[0] == 0.0:
            raise ValueError("friction must be above 0 (no unit) with an operator: else an object never rests")
        for name in ("speed", "creep"):
            if (fastest := self.ends("operator", name)[1]) > high:
                raise ValueError(f"operator.{name} must be at most {high:g} m/s (velocity_range), got {fastest:g} m/s")
        for velocity in getattr(self.operator, "velocity", ()):
            if not low <= velocity <= high:
                allowed = f"within velocity_range, {low:g} to {high:g} m/s"
                raise ValueError(f"Replay.velocity must be {allowed}, got {velocity:g} m/s")
        if 0.0 < (length := getattr(self.operator, "length", 0.0)) < horizon:
            raise ValueError(f"Replay.length must be 0 or at least the horizon, {horizon:g} s, got {length!r} s")
        first = self.ends("operator", "recording")[0]
        if isinstance(self.operator, Replay) and length and first == math.ceil(self.operator.time[-1] / length):
            raise ValueError(f"Replay.recording must be below {first:g}, the number of recordings, got {first:g}")
        for way in WAYS:
            self._check_delay(way, horizon, control_period)
        if (timeout := self.downlink.timeout) != Channel().timeout:
            raise ValueError(f"downlink.timeout must be left out: only uplink.timeout stops the arm, got {timeout:g} s")

    def _check_delay(self, way: str, horizon: float, control_period: float) -> None:
        channel: Channel = getattr(self, way)
        delay, jitter, tail = (self.ends(way, name)[1] for name in ("delay", "jitter", "tail"))
        mean = delay + max(jitter + share * (tail - jitter) for share in self.ends(way, "tail_share"))
        note = " with the mean jitter" if mean > delay else ""
        if mean >= horizon:
            raise ValueError(f"{way}.delay must be below the horizon, {horizon:g} s, got {mean:g} s{note}")
        apart = float(np.median(np.diff([time for time, _ in channel.trace]))) if channel.trace else 0.0
        if apart > (most := max(LONGEST_SPACING * control_period, SLOWEST_PING)):
            raise ValueError(f"{way}.trace must have packets at most {most:g} s apart, in the median, with a control "
                             f"period of {control_period:g} s, got {apart:g} s"
                             + unit_hint(apart, most, LEAST_USUAL))  # fmt: skip

    def pack(self, record: NDArray[Any], begin: int) -> list[NDArray[np.float64]]:
        """Return the tables of operator and channels; write the operator's kind and a `Table` for each into `record`.

        `record`: (1,), TASK. `begin`: index of the first table's first number among the numbers of all tables.
        """
        record["operator_kind"] = KINDS[type(self.operator)]
        tables = [getattr(self.operator, "table", np.empty(0)), self.uplink.table, self.downlink.table]
        for name, points in zip(("replay", *WAYS), tables, strict=True):
            times, values = np.split(points, 2)
            length = times[-1] if len(times) else 0.0
            kept = values < LOST
            mean = np.trapezoid(values[kept], times[kept]) / np.ptp(times[kept]) if len(times) else 0.0
            record[name] = begin, len(times), length, mean
            begin += len(points)
        record["replay"]["length"] = getattr(self.operator, "length", 0.0)
        return tables

    def packets(self, horizon: float, control_period: float) -> int:
        """Return how many packets to store: packets in transit, and packets that the operator has not seen yet."""
        late = [LONGEST_JITTER * max(self.ends(way, name)[1] for name in ("jitter", "tail")) for way in WAYS]
        up, down = (self.ends(way, "delay")[1] + max((0.0, *getattr(self, way).delays)) for way in WAYS)
        most = max(up + late[0], down + late[1] + self.ends("operator", "reaction")[1])
        return math.ceil(min(most, horizon) / control_period) + 4
