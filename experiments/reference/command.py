"""The commanded motion x_r in pieces of constant acceleration: planned (paper, Fig. 11), or changed by `steer`."""

from math import copysign, inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Command:
    """The commanded motion in pieces: start (s), position (m), velocity (m/s), acceleration (m/s^2)."""

    def __init__(self, motion: Any = None, threshold: float = inf) -> None:
        self.pieces = [(0.0, 0.0, 0.0, 0.0)]
        self.nodes: NDArray[np.float64] = np.array(())  # m, positions in a table of robot parameters
        self.detection_time: float | None = None  # s, when the contact force first exceeds `threshold` (N)
        self.threshold, self.brake = threshold, None if motion is None else motion.brake
        if motion is not None:
            v, a = float(motion.speed), float(motion.acceleration)
            self.pieces = [(0.0, 0.0, 0.0, a), (v / a, v * v / (2 * a), v, 0.0)]
        if self.brake is not None:
            self.threshold, self.delay = float(self.brake.threshold), float(self.brake.delay)  # N and s
            self.deceleration = a if self.brake.deceleration is None else float(self.brake.deceleration)

    def at(self, t: float) -> tuple[float, float, float, float]:
        """Return position (m), velocity (m/s), acceleration (m/s^2), time (s) of the next piece or node (inf: none)."""
        start, x, v, a = [p for p in self.pieces if p[0] <= t][-1]
        s = t - start
        x, v = x + (v + a * s / 2) * s, v + a * s
        cut = min((p[0] for p in self.pieces if p[0] > t), default=inf)
        # a node that was just reached does not count; 1e-12 m allows for rounding
        for node in self.nodes[self.nodes > x + 1e-12][:1].tolist():
            square = v * v + 2 * a * (node - x)  # square of the velocity at the node
            if square >= 0 and v + sqrt(square) > 0:
                cut = min(cut, t + 2 * (node - x) / (v + sqrt(square)))
        return x, v, a, cut

    def steer(self, t: float, velocity: float, acceleration: float) -> None:
        """From t (s) on, change the velocity at `acceleration` (m/s^2) to `velocity` (m/s), then keep `velocity`."""
        x, v, _, _ = self.at(t)
        ramp = abs(velocity - v) / acceleration
        there = (t + ramp, x + (v + velocity) / 2 * ramp, velocity, 0.0)
        self.pieces = [piece for piece in self.pieces if piece[0] < t]
        self.pieces += [(t, x, v, copysign(acceleration, velocity - v)), there]

    def detect(self, t: float) -> None:
        """Record that the contact force exceeds the threshold at t (s). With a brake, brake from t + delay on."""
        self.detection_time = t
        if self.brake is not None:
            self.steer(t + self.delay, 0.0, self.deceleration)
