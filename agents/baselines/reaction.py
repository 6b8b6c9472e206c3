"""What a rule does once the alarm has come: a velocity to go to, over the time since then.

Letting that velocity depend on the sensed force as well was tried and gained nothing: the best reaction is to retreat
at full acceleration, whatever the force.
"""

import numpy as np
from numpy.typing import ArrayLike

from agents.baselines.rule import Floats, Parameter, Rule, Seen, interpolate
from impact_gym.envs.task import ACCELERATION_RANGE, AFTER_ALARM, VELOCITY_RANGE

TIMES: Floats = np.array([0.0, 0.03, 0.07, AFTER_ALARM])  # s
REACTION = (
    *(Parameter(f"velocity {1e3 * time:g} ms after the alarm", "m/s", *VELOCITY_RANGE, 0.0) for time in TIMES),
    Parameter("acceleration after the alarm", "m/s^2", *ACCELERATION_RANGE, 15.0),
)


class ReactingRule(Rule):
    """A rule for the approach with a reaction behind it; its last parameters are REACTION."""

    def command(self, seen: Seen) -> tuple[ArrayLike, ArrayLike]:
        """Return what `approach` says until the alarm, and the reaction from then on."""
        velocity, acceleration = self.approach(seen)
        after = interpolate(TIMES, self.columns(REACTION[0].name, len(TIMES)), seen.since_alarm)
        return (
            np.where(seen.alarm, after, velocity),
            np.where(seen.alarm, self["acceleration after the alarm"], acceleration),
        )

    def approach(self, seen: Seen) -> tuple[ArrayLike, ArrayLike]:
        """Return velocity (m/s) and acceleration (m/s^2) of the approach."""
        raise NotImplementedError
