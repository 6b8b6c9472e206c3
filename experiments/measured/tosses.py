"""Tosses of a cube onto a table, as ContactNets recorded them: what restitution its corners have, and over which speed.

A file has a row for each frame: centre (3), quaternion with its real part first (4), and more; lengths over half an
edge. Before its first touch a cube flies: its centre on a parabola, turning evenly. So do the frames right after it,
until the next corner strikes. Both flights are led to the instant of the touch; there the corner's vertical velocities
are compared (Pfrommer, Halm and Posa, CoRL 2020, `data/tosses_processed` of DAIRLab/contact-nets, BSD-3).
"""

from collections.abc import Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from impact_gym.physics.impact import GRAVITY

Array = NDArray[np.float64]
HALF_EDGE = 0.0524  # m
STEP = 1 / 148  # s, between frames
BEFORE, AFTER = 4, 2  # frames of a flight
NEAR = 0.01  # m, below which a corner that stops falling has struck
ALONE = 0.015  # m, that all other corners are above the table at the touch, at least
CORNERS = HALF_EDGE * np.array(list(product((-1.0, 1.0), repeat=3)))
BINS = (0.6, 0.8, 1.0, 1.2, 1.6)  # m/s


def read(path: Path) -> Array:
    """Return the frames of a file (n, 7+), lengths in m.

    Raises:
        ValueError: it holds no such array. Nothing but tensors is loaded.
    """
    import torch

    try:
        frames: Any = torch.load(path, weights_only=True).numpy().squeeze()
    except Exception as problem:  # whatever a damaged archive makes of it
        raise ValueError(f"{path} is not read as a tensor: {' '.join(str(problem).split()):.120}") from None
    if frames.ndim != 2 or frames.shape[1] < 7 or not np.isfinite(frames).all():
        raise ValueError(f"{path} must have frames of 7 finite numbers or more, got {frames.shape}")
    return np.asarray(np.column_stack([HALF_EDGE * frames[:, :3], frames[:, 3:7]]), np.float64)


def touch(frames: Array) -> tuple[float, float] | None:
    """Return approach and separation velocity (m/s) of the corner that strikes first; None where none does alone."""
    turns = Rotation.from_quat(np.roll(frames[:, 3:7], -1, axis=1))
    lowest = np.array([(turn.apply(CORNERS)[:, 2]).min() for turn in turns]) + frames[:, 2]
    turned = np.flatnonzero((np.diff(lowest) > 0.0) & (lowest[:-1] < NEAR))
    first = int(turned[0]) if len(turned) else 0  # the touch lies in the step before it
    if first < BEFORE or first + 1 + AFTER > len(frames):
        return None
    flight = slice(first - BEFORE, first)
    instants = STEP * (first - 1.0 + np.linspace(0.0, 1.0, 201))
    heights = np.array([_corners(frames, turns, flight, time)[0] for time in instants])
    if not (heights.min(axis=1) <= 0.0).any():
        return None
    at = int(np.argmax(heights.min(axis=1) <= 0.0))
    corner, others = int(np.argmin(heights[at])), np.sort(heights[at])[1:]
    if others.min() < ALONE:
        return None
    speeds = [_corners(frames, turns, part, instants[at])[1][corner]
              for part in (flight, slice(first + 1, first + 1 + AFTER))]  # fmt: skip
    return -float(speeds[0]), float(speeds[1])


def _corners(frames: Array, turns: Rotation, flight: slice, time: float) -> tuple[Array, Array]:
    """Return heights (m) and vertical velocities (m/s) of the corners (8,) at `time` (s), led on from a flight."""
    times = STEP * np.arange(flight.start, flight.stop)
    slope, start = np.polyfit(times, frames[flight, 2] + 0.5 * GRAVITY * times**2, 1)
    one, two = turns[flight.start], turns[flight.stop - 1]
    rate = (two * one.inv()).as_rotvec() / (times[-1] - times[0])
    levers = (Rotation.from_rotvec(rate * (time - times[-1])) * two).apply(CORNERS)
    heights = start + slope * time - 0.5 * GRAVITY * time**2 + levers[:, 2]
    return heights, slope - GRAVITY * time + np.cross(rate, levers)[:, 2]


def restitutions(paths: Sequence[Path]) -> list[dict[str, Any]]:
    """Return a row for each range of approach velocities: how many touches, quartiles of their restitution."""
    found = np.array([each for path in paths if (each := touch(read(path))) is not None]).reshape(-1, 2)
    speeds, values = found[:, 0], found[:, 1] / found[:, 0]
    rows = []
    for low, high in [(0.0, np.inf), *pairwise(BINS)]:
        mine = values[(low < speeds) & (speeds <= high)]
        if len(mine):
            lower, middle, upper = np.quantile(mine, [0.25, 0.5, 0.75]).tolist()
            rows.append({"from": low, "to": high, "touches": len(mine), "lower": lower, "e": middle, "upper": upper})
    if not rows:
        raise ValueError(f"no corner strikes alone in {len(paths)} tosses")
    return rows
