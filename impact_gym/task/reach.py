"""How far the flange comes in a time, how long an episode lasts by default, and which speed an arm needs."""

import math

from impact_gym.quantities import HORIZON, QUANTITIES


def usual_horizon(distance: float, top_speed: float) -> float:
    """Return the time (s) to a distance (m) at a fifth of the top speed (m/s), rounded up to 0.1 s.

    It is at least HORIZON, so that policies observe time alike where objects are nearer than in the default
    environment, as in the scenarios "hard".
    """
    tenths = 10.0 * min(5.0 * distance / top_speed, QUANTITIES["horizon"].limits.at_most)
    return max(math.ceil(round(tenths, 6)) / 10.0, HORIZON)


def reach(speed: float, acceleration: float, time: float) -> float:
    """Return the way (m) from rest in a time (s), at an acceleration (m/s^2) up to a speed (m/s)."""
    ramp = min(time, speed / acceleration)
    return 0.5 * acceleration * ramp**2 + speed * (time - ramp)


def needed_speed(distance: float, acceleration: float, time: float) -> float:
    """Return the speed (m/s) of which the `reach` is `distance` (m); infinity: the distance is out of reach."""
    square = time**2 - 2.0 * distance / acceleration
    return math.inf if square < 0.0 else acceleration * (time - math.sqrt(square))
