"""Rules that follow a speed profile until the alarm, and then a reaction: a velocity to go to, over the time since.

Letting that velocity depend on the sensed force as well was tried and gained nothing: the best reaction is to retreat
at full acceleration, whatever the force.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from agents.baselines.rule import CONTROL_PERIOD, Floats, Parameter, Rule, View, interpolate
from impact_gym.quantities import AFTER_ALARM
from impact_gym.task.task import ACCELERATION_RANGE, VELOCITY_RANGE

TIMES: Floats = np.array([0.0, 0.03, 0.07, AFTER_ALARM])  # s
REACTION = (
    *(Parameter(f"velocity {1e3 * time:g} ms after the alarm", "m/s", *VELOCITY_RANGE, 0.0) for time in TIMES),
    Parameter("acceleration after the alarm", "m/s^2", *ACCELERATION_RANGE, 15.0),
)
ACCELERATION = Parameter("acceleration", "m/s^2", *ACCELERATION_RANGE, 15.0)
"""The most that following a profile may take, either way: too much throws a bistable mechanism off its stop."""


class ReactingRule(Rule):
    """A speed profile over position, followed until the alarm; then a reaction, whose parameters, REACTION, are last.

    Without the parameter ACCELERATION a rule follows its profile with all that the environment has by default.
    """

    def command(self, view: View) -> tuple[ArrayLike, ArrayLike]:
        """Return what `approach` says until the alarm, and the reaction from then on."""
        velocity, acceleration = self.approach(view)
        after = interpolate(TIMES, self.columns(REACTION[0].name, len(TIMES)), view.time_since_alarm)
        return (
            np.where(view.alarm, after, velocity),
            np.where(view.alarm, self["acceleration after the alarm"], acceleration),
        )

    def approach(self, view: View) -> tuple[ArrayLike, ArrayLike]:
        """Return the profile's velocity (m/s) one control period ahead, and the acceleration (m/s^2) for it."""
        most = self[ACCELERATION.name] if ACCELERATION in self.PARAMETERS else ACCELERATION_RANGE[1]
        return follow(self.profile(view), self.position(view), view["velocity"], most, self.task.control_period)

    def position(self, view: View) -> Floats:
        """Return the position (m) on the profile: the flange's, unless a rule counts from somewhere else."""
        return view["position"]

    def profile(self, view: View) -> Callable[[Floats], Floats]:
        """Return what gives the speed at a position: `speed`, whatever else is seen, unless a rule says otherwise."""
        return self.speed

    def speed(self, position: Floats) -> Floats:
        """Return the profile's speed (m/s) at `position` (m)."""
        raise NotImplementedError


def follow(
    speed: Callable[[Floats], Floats], position: Floats, velocity: Floats,
    acceleration: ArrayLike = ACCELERATION_RANGE[1], period: float = CONTROL_PERIOD,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Return the command that has the flange on the profile `speed` one control `period` (s) from now.

    The position by then follows from the mean of the velocities now and then; one look ahead gives the latter. Where
    the profile asks for more than `acceleration` (m/s^2), that much is used.
    """
    ahead = speed(position + velocity * period)
    reach = np.asarray(acceleration) * period
    ahead = np.clip(ahead, velocity - reach, velocity + reach)
    target = speed(position + 0.5 * (velocity + ahead) * period)
    return target, np.clip(np.abs(target - velocity) / period, ACCELERATION_RANGE[0], acceleration)
