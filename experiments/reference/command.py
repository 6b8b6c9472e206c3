"""The imposed motion x_r: pieces of constant acceleration (paper, Fig. 11)."""

from __future__ import annotations

from math import inf, sqrt
from typing import Any

import numpy as np


class Command:
    """Pieces (start s, position m, velocity m/s, acceleration m/s^2) in order, the last without end.

    `nodes` are positions (m) at which the motion is to be cut too.
    """

    def __init__(self, motion: Any, nodes: tuple[float, ...] = ()) -> None:
        v, a, brake = float(motion.speed), float(motion.acceleration), motion.brake
        self.pieces = [(0.0, 0.0, 0.0, a), (v / a, v * v / (2 * a), v, 0.0)]
        self.nodes = np.array(nodes)
        self.detection_time: float | None = None
        self.threshold = inf if brake is None else float(brake.threshold)  # N
        self.delay = 0.0 if brake is None else float(brake.delay)  # s
        self.deceleration = a if brake is None or brake.deceleration is None else float(brake.deceleration)

    def at(self, t: float) -> tuple[float, float, float, float]:
        """Position (m), velocity (m/s), acceleration (m/s^2) and when the motion is to be cut next (s)."""
        start, x, v, a = [p for p in self.pieces if p[0] <= t][-1]
        s = t - start
        x, v = x + (v + a * s / 2) * s, v + a * s
        cut = min((p[0] for p in self.pieces if p[0] > t), default=inf)
        if self.nodes.size:
            # a node just reached counts as passed: rounding may leave x a little before it
            ahead = self.nodes[self.nodes > x + 1e-12]
            cut = min(cut, t + _time_to(float(ahead[0]) - x, v, a)) if ahead.size else cut
        return x, v, a, cut

    def detect(self, t: float) -> None:
        """The force passed the threshold at t: from t + delay, brake to rest."""
        self.detection_time, t_b = t, t + self.delay
        x_b, v_b, _, _ = self.at(t_b)
        stopping = v_b / self.deceleration  # s
        self.pieces = [p for p in self.pieces if p[0] < t_b]
        self.pieces += [(t_b, x_b, v_b, -self.deceleration), (t_b + stopping, x_b + v_b * stopping / 2, 0.0, 0.0)]


def _time_to(distance: float, v: float, a: float) -> float:
    """Seconds to go `distance` > 0 (m) from velocity v >= 0 at acceleration a; inf if it is never gone."""
    square = v * v + 2 * a * distance
    if square < 0 or v + sqrt(square) == 0:
        return inf
    return 2 * distance / (v + sqrt(square))
