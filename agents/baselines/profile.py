"""Rules that follow a speed profile while the alarm is off, and react while the alarm is on.

The reaction is a velocity as a function of the time since the alarm. A profile is a speed as a function of the flange's
position, of the estimated distance, or of the true distance. No sensor measures the true distance.
"""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from agents.baselines.rule import Floats, Parameter, Rule, View, interpolate, ranges_for
from impact_gym.quantities import AFTER_ALARM
from impact_gym.task.task import ACCELERATION_RANGE, VELOCITY_RANGE

TIMES: Floats = np.array([0.0, 0.03, 0.07, AFTER_ALARM])  # s after the alarm; REACTION has a velocity for each time
REACTION = (
    *(Parameter(f"velocity {1e3 * time:g} ms after the alarm", "m/s", *VELOCITY_RANGE, 0.0) for time in TIMES),
    Parameter("acceleration after the alarm", "m/s^2", *ACCELERATION_RANGE, 15.0),
)
ACCELERATION = Parameter("acceleration", "m/s^2", *ACCELERATION_RANGE, 15.0)
"""Limit of acceleration and deceleration on a profile; a low limit keeps a bistable mechanism on the front stop."""
# m, reference value and lower limit of the standard deviation of a distance
USUAL_SPREAD, LEAST_SPREAD = 1e-2, 1e-3


class ReactingRule(Rule):
    """Follow a speed profile; while the alarm is on, follow the velocities in REACTION."""

    OVER = "position"  # key, in the view, of the profile's argument; a distance is negated to give a position

    def command(self, view: View) -> tuple[ArrayLike, ArrayLike]:
        """Return velocity (m/s) and acceleration (m/s^2): the reaction's while the alarm is on, else the profile's."""
        most = self[ACCELERATION.name] if ACCELERATION in self.PARAMETERS else ranges_for(self.task)["m/s^2"][1]
        speed, velocity, period = self.profile(view), view["velocity"], self.task.control_period
        position = view[self.OVER] if self.OVER == "position" else -view[self.OVER]
        reach = np.asarray(most) * period
        ahead = np.clip(speed(position + velocity * period), velocity - reach, velocity + reach)
        target = speed(position + 0.5 * (velocity + ahead) * period)
        acceleration = np.clip(np.abs(target - velocity) / period, ACCELERATION_RANGE[0], most)
        after = interpolate(TIMES, self.columns(REACTION[0].name, len(TIMES)), view["time_since_alarm"])
        fast = self["acceleration after the alarm"]
        return np.where(view.alarm, after, target), np.where(view.alarm, fast, acceleration)

    def profile(self, view: View) -> Callable[[Floats], Floats]:
        """Return the profile for `view`: a function from position (m) to speed (m/s)."""
        return self.speed

    def speed(self, position: Floats) -> Floats:
        """Return the profile's speed (m/s) at `position` (m)."""
        raise NotImplementedError


KNOTS: Floats = np.array([0.08, 0.12, 0.15, 0.17, 0.19, 0.22, 0.25, 0.28, 0.315, 0.35])
"""Positions (m) of the corners of the piecewise linear `BlindProfile`, see `Rule.placed`."""
AHEAD: Floats = np.array([-0.2, -0.12, -0.08, -0.05, -0.035, -0.02, -0.01, 0.0, 0.01, 0.025, 0.05])
"""Positions (m) of the corners of `RangedProfile`, relative to the estimated place of the object."""
GAPS: Floats = np.array([-0.02, -0.01, 0.0, 0.01, 0.02, 0.04])
"""Corners of the profile of `Clairvoyant`: the object's distance minus the flange's position (m)."""


class BlindProfile(ReactingRule, tunable=True):
    """Follow a speed profile over the flange's position, piecewise linear."""

    PARAMETERS = (
        *(Parameter(f"speed at {1e3 * knot:g} mm", "m/s", 0.01, VELOCITY_RANGE[1], 0.6) for knot in KNOTS),
        ACCELERATION,
        *REACTION,
    )

    def speed(self, position: Floats) -> Floats:
        """Return the profile's speed (m/s) at `position` (m)."""
        return interpolate(self.placed(KNOTS), self.columns(self.PARAMETERS[0].name, len(KNOTS)), position)


class ConstantDeceleration(ReactingRule, tunable=True):
    """Approach ever slower, with constant deceleration to a `lowest speed` at the position `end`."""

    PARAMETERS = (
        Parameter("top speed", "m/s", 0.1, VELOCITY_RANGE[1], 1.0),
        Parameter("deceleration", "m/s^2", 0.1, ACCELERATION_RANGE[1], 3.0),
        Parameter("end", "m", 0.2, 0.6, 0.4),
        Parameter("lowest speed", "m/s", 0.01, 1.0, 0.1),
        ACCELERATION,
        *REACTION,
    )

    def speed(self, position: Floats) -> Floats:
        """Return the speed (m/s) at `position` (m)."""
        left = np.maximum(self.placed(self["end"]) - position, 0.0)
        braking = np.sqrt(self["lowest speed"] ** 2 + 2.0 * self["deceleration"] * left)
        return np.minimum(braking, self["top speed"])


class Ranged(ReactingRule, tunable=True):
    """Brake with constant deceleration to the `contact speed`, reached `margin` (m) before the estimated place."""

    NEEDS: ClassVar[Mapping[str, Any]] = {"range_noise": 0.01}
    PARAMETERS = (
        Parameter("top speed", "m/s", 0.1, VELOCITY_RANGE[1], 1.0),
        Parameter("contact speed", "m/s", 0.01, 1.0, 0.3),
        Parameter("deceleration", "m/s^2", *ACCELERATION_RANGE, 10.0),
        Parameter("margin", "m", -0.05, 0.05, 0.0),
        *REACTION,
    )
    OVER = "distance_estimate"

    def speed(self, position: Floats) -> Floats:
        """Return the speed (m/s) at `position` (m) relative to the estimated place."""
        left = np.maximum(-position - self["margin"], 0.0)
        braking = np.sqrt(self["contact speed"] ** 2 + 2.0 * self["deceleration"] * left)
        return np.minimum(braking, np.maximum(self["top speed"], self["contact speed"]))


class RangedProfile(ReactingRule, tunable=True):
    """Follow a piecewise linear profile over the position relative to the object's estimated place."""

    NEEDS: ClassVar[Mapping[str, Any]] = {"range_noise": 0.01}
    PARAMETERS = (
        *(
            Parameter(f"speed at {1e3 * place:g} mm", "m/s", 0.01, VELOCITY_RANGE[1], start)
            for place, start in zip(AHEAD, np.sqrt(np.clip(-36.0 * AHEAD, 0.06, 2.25)).tolist(), strict=True)
        ),
        ACCELERATION,
        *REACTION,
    )
    OVER = "distance_estimate"

    def speed(self, position: Floats) -> Floats:
        """Return the profile's speed (m/s) at `position` (m) relative to the estimated place."""
        return interpolate(AHEAD, self.columns(self.PARAMETERS[0].name, len(AHEAD)), position)


class StretchedProfile(RangedProfile):
    """`RangedProfile` whose positions and speeds are scaled by powers of the estimate's standard deviation."""

    PARAMETERS = (
        *RangedProfile.PARAMETERS,
        Parameter("stretch", "-", -0.5, 1.5, 0.3),
        Parameter("slowing", "-", -0.5, 1.5, 0.0),
    )
    SPREAD = "range_noise"  # key, in the view, of the standard deviation (m) of the estimated distance

    def profile(self, view: View) -> Callable[[Floats], Floats]:
        """Return the profile with positions * s**stretch and speeds / s**slowing, where s = spread / USUAL_SPREAD."""
        spread = np.maximum(view[self.SPREAD], LEAST_SPREAD) / USUAL_SPREAD
        stretch, slowing = spread ** self["stretch"], spread ** self["slowing"]
        fastest = ranges_for(self.task)["m/s"][1]
        return lambda place: np.clip(self.speed(place / stretch) / slowing, 0.01, fastest)


class Clairvoyant(ReactingRule):
    """Follow a velocity profile over the object's true distance minus the flange's position."""

    NEEDS: ClassVar[Mapping[str, Any]] = {"privileged": True}
    PARAMETERS = (
        *(Parameter(f"velocity at a gap of {1e3 * gap:g} mm", "m/s", *VELOCITY_RANGE, 0.3) for gap in GAPS),
        Parameter("deceleration", "m/s^2", *ACCELERATION_RANGE, 12.0),
        ACCELERATION,
        *REACTION,
    )
    OVER = "distance"

    def speed(self, position: Floats) -> Floats:
        """Return the velocity (m/s) at a flange `position` (m) relative to the object's distance."""
        corners = self.columns(self.PARAMETERS[0].name, len(GAPS))
        far = np.maximum(-position - GAPS[-1], 0.0)
        near = interpolate(GAPS, corners, -position)
        braking = np.sqrt(np.maximum(corners[..., -1], 0.0) ** 2 + 2.0 * self["deceleration"] * far)
        return np.where(far > 0.0, np.minimum(braking, ranges_for(self.task)["m/s"][1]), near)
