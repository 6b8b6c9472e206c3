"""Motions that can be imposed on the robot; each consists of pieces of constant acceleration."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from impact_gym.parameters import SI, Parameters
from impact_gym.support.validation import rising


@dataclass(frozen=True, slots=True)
class Brake(Parameters, path="motion.brake"):
    """Braking to rest; the brake begins `delay` after the contact force first exceeds `threshold`.

    The default delay is from the paper, which prints no deceleration (docs/provenance.md).
    """

    threshold: float = 1.0  # N
    delay: float = 0.016  # s
    deceleration: float | None = None  # m/s^2; None: the acceleration of the trapezoid


@dataclass(frozen=True, slots=True)
class Trapezoid(Parameters, path="motion"):
    """A motion from rest to `speed` at `acceleration`, then at constant speed until the brake (paper, Fig. 11)."""

    speed: float  # m/s
    acceleration: float  # m/s^2
    brake: Brake | None = None

    @property
    def deceleration(self) -> float:
        """Deceleration of the brake, m/s^2; by default the acceleration."""
        if self.brake is None or self.brake.deceleration is None:
            return self.acceleration
        return self.brake.deceleration


@dataclass(frozen=True, slots=True)
class Motion(Parameters, path="motion"):
    """A motion from rest; its velocity is linear in time between the given values, and constant after the last one."""

    times: Annotated[tuple[float, ...], SI("s", at_least=0.0, at_most=1e12)]  # rising from 0
    velocities: Annotated[tuple[float, ...], SI("m/s", at_least=-1e9, at_most=1e9)]  # one for each time; the first is 0

    def __post_init__(self) -> None:
        Parameters.__post_init__(self)
        rising("Motion", self.times, "velocity", self.velocities)
        if self.velocities[0] != 0.0:
            raise ValueError(f"Motion.velocities must begin at 0 m/s, got {self.velocities[0]!r} m/s")

    @property
    def acceleration(self) -> float:
        """Largest absolute acceleration, m/s^2."""
        return float(np.abs(np.diff(self.velocities) / np.diff(self.times)).max())
