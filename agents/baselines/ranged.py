"""The classical rule for an object whose distance is known roughly: brake so as to arrive slowly."""

import numpy as np

from agents.baselines.reaction import REACTION, ReactingRule
from agents.baselines.rule import Floats, Parameter, Seen
from impact_gym.envs.task import ACCELERATION_RANGE, VELOCITY_RANGE


class Ranged(ReactingRule):
    """Brake at constant deceleration to the contact speed, reached a margin before the estimated distance; creep on."""

    needs_estimate = True
    PARAMETERS = (
        Parameter("top speed", "m/s", 0.1, VELOCITY_RANGE[1], 1.0),
        Parameter("contact speed", "m/s", 0.01, 1.0, 0.3),
        Parameter("deceleration", "m/s^2", *ACCELERATION_RANGE, 10.0),
        Parameter("margin", "m", -0.05, 0.05, 0.0),
        *REACTION,
    )

    def position(self, seen: Seen) -> Floats:
        """Return the flange's position (m), counted from the estimated distance."""
        return -seen.estimate

    def speed(self, position: Floats) -> Floats:
        """Return the speed (m/s) at `position` (m), counted from the estimated distance."""
        left = np.maximum(-position - self["margin"], 0.0)
        braking = np.sqrt(self["contact speed"] ** 2 + 2.0 * self["deceleration"] * left)
        return np.minimum(braking, np.maximum(self["top speed"], self["contact speed"]))
