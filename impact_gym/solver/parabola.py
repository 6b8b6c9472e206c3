"""A gap that closes under constant acceleration."""

import math

from impact_gym.kernel import kernel


@kernel
def gap_closes(gap: float, speed: float, acceleration: float) -> float:
    """Time (s) until gap - speed t - acceleration t^2 / 2 falls to zero from above; inf if never.

    A gap of zero that opens counts as open, one that closes as closed. No difference of nearly equal numbers is taken.
    """
    square = speed * speed + 2.0 * acceleration * gap
    if square < 0.0:
        return math.inf
    if speed > 0.0:
        return 2.0 * gap / (speed + math.sqrt(square)) if gap > 0.0 else 0.0
    if acceleration > 0.0:  # not closing yet, or just opened: back once the acceleration has turned it
        return (math.sqrt(square) - speed) / acceleration
    return math.inf
