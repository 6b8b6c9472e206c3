"""The imposed motion x_r: pieces of constant acceleration, planned before (paper, Fig. 11) or steered on the way."""

from math import copysign, inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Command:
    """Pieces (start s, position m, velocity m/s, acceleration m/s^2) in order, the last without end.

    With a motion: from rest to its speed, until its brake. Without: at rest, to be steered; `threshold` (N) is that of
    the contact force whose passing is noted.
    """

    def __init__(self, motion: Any = None, threshold: float = inf) -> None:
        self.pieces = [(0.0, 0.0, 0.0, 0.0)]
        self.nodes: NDArray[np.float64] = np.array(())  # m, positions at which the motion is to be cut too
        self.detection_time: float | None = None  # s, contact force first exceeds the threshold
        self.threshold, self.brake = threshold, None if motion is None else motion.brake
        if motion is not None:
            v, a = float(motion.speed), float(motion.acceleration)
            self.pieces = [(0.0, 0.0, 0.0, a), (v / a, v * v / (2 * a), v, 0.0)]
        if self.brake is not None:
            self.threshold, self.delay = float(self.brake.threshold), float(self.brake.delay)  # N, s
            self.deceleration = a if self.brake.deceleration is None else float(self.brake.deceleration)

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

    def rests(self, t: float) -> bool:
        """Whether the flange stands still from t (s) on, as far as is known."""
        _, v, a, cut = self.at(t)
        return v == 0 and a == 0 and cut == inf

    def steer(self, t: float, velocity: float, acceleration: float) -> None:
        """From t (s) on go to `velocity` (m/s) at `acceleration` (m/s^2), then hold it."""
        x, v, _, _ = self.at(t)
        ramp = abs(velocity - v) / acceleration
        there = (t + ramp, x + (v + velocity) / 2 * ramp, velocity, 0.0)
        self.pieces = [piece for piece in self.pieces if piece[0] < t]
        self.pieces += [(t, x, v, copysign(acceleration, velocity - v)), there]

    def detect(self, t: float) -> None:
        """The force passed the threshold at t (s): from t + delay, a motion with a brake comes to rest."""
        self.detection_time = t
        if self.brake is not None:
            self.steer(t + self.delay, 0.0, self.deceleration)


def _time_to(distance: float, v: float, a: float) -> float:
    """Seconds to go `distance` > 0 (m) from velocity v at acceleration a; inf if it is never gone or behind."""
    square = v * v + 2 * a * distance
    if square < 0 or v + sqrt(square) <= 0:
        return inf
    return 2 * distance / (v + sqrt(square))
