"""Thinning of time histories to the points that the eye needs."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

MOST = 200  # points of a history
POSITION, VELOCITY, FORCE, DEPTH = 0.0003, 0.003, 0.005, 0.005
"""Errors allowed, as shares: of the way, the highest speed, the highest force, the deepest penetration."""


def thin(columns: Mapping[str, NDArray[np.float64]], limits: Mapping[str, float]) -> NDArray[np.int64]:
    """Return which rows to keep, in order: straight lines between them miss the others by less than is allowed.

    The row that is missed by most comes next, until none is missed or MOST are kept; where a contact begins or ends is
    always kept.
    """
    depth = limits["depth"]
    penetration = columns["tool_position"] - columns["object_position"]
    scaled = {f"{body}_position": POSITION * limits["farthest"] for body in ("flange", "tool", "object")}
    scaled |= {f"{body}_velocity": VELOCITY * limits["speed"] for body in ("flange", "tool", "object")}
    channels = [columns[name] / allowed for name, allowed in scaled.items()]
    if depth > 0.0:
        channels.append(columns["contact_force"] / (FORCE * limits["force"]))
        channels.append(np.clip(penetration, -depth, depth) / (DEPTH * depth))
    values, time = np.array(channels), columns["time"]
    turns = np.flatnonzero(np.diff(penetration > 0.0))
    rows = sorted({0, len(time) - 1, *turns.tolist(), *(turns + 1).tolist()})
    while len(rows) < min(MOST, len(time)):
        missed = np.max([np.abs(row - np.interp(time, time[rows], row[rows])) for row in values], axis=0)
        worst = int(np.argmax(missed))
        if missed[worst] <= 1.0:
            break
        rows = sorted({*rows, worst})
    return np.array(rows)
