"""Imposed motion of the flange: pieces of constant acceleration.

Every motion here is a sequence of commands 'go to this velocity with this acceleration, then hold it'. A trapezoid
is one command at t = 0 and, if it brakes, a second one when the contact alarm reaches the controller.
"""

from dataclasses import dataclass
from typing import Annotated

from impact_gym.validation import SI, Record, number, one_of


@dataclass(frozen=True, slots=True)
class Brake(Record):
    """Stop once the contact is felt: `delay` after the contact force first exceeds `threshold`.

    The delay is the paper's 16 ms; the deceleration of the paper is not printed (8 m/s^2 identified, see
    docs/provenance.md).
    """

    threshold: Annotated[float, SI("N", at_least=0)] = 1.0
    delay: Annotated[float, SI("s", at_least=0)] = 0.016
    deceleration: float | None = None  # m/s^2; None: the acceleration of the trapezoid

    def __post_init__(self) -> None:
        Record.__post_init__(self)
        if self.deceleration is not None:
            value = number("Brake.deceleration", self.deceleration, "m/s^2", above=0)
            object.__setattr__(self, "deceleration", value)


@dataclass(frozen=True, slots=True)
class Trapezoid(Record):
    """From rest to `speed` at `acceleration`, then constant; never ends by itself (paper, Fig. 11)."""

    speed: Annotated[float, SI("m/s", above=0)]
    acceleration: Annotated[float, SI("m/s^2", above=0)]
    brake: Brake | None = None

    def __post_init__(self) -> None:
        Record.__post_init__(self)
        one_of("Trapezoid.brake", self.brake, Brake, type(None))

    @property
    def deceleration(self) -> float:
        """Deceleration after the alarm, m/s^2."""
        if self.brake is None or self.brake.deceleration is None:
            return self.acceleration
        return self.brake.deceleration
