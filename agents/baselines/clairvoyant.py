"""A controller that knows the scenario, for a bound on what any could do."""

import numpy as np

from agents.baselines.reaction import ACCELERATION, REACTION, ReactingRule
from agents.baselines.rule import Floats, Parameter, View, interpolate
from impact_gym.task.task import ACCELERATION_RANGE, VELOCITY_RANGE

GAPS: Floats = np.array([-0.02, -0.01, 0.0, 0.01, 0.02, 0.04])
"""Gaps (m) between the faces at which its profile has corners; below 0 the coupling gives way, or the object."""


class Clairvoyant(ReactingRule):
    """Follow a velocity profile over the gap that is left, made for this one scenario; then react.

    Needs the environment's option `privileged`, and parameters that were optimised for the scenario it meets.
    """

    needs_truth = True
    PARAMETERS = (
        *(Parameter(f"velocity at a gap of {1e3 * gap:g} mm", "m/s", *VELOCITY_RANGE, 0.3) for gap in GAPS),
        Parameter("deceleration", "m/s^2", *ACCELERATION_RANGE, 12.0),
        ACCELERATION,
        *REACTION,
    )

    def position(self, view: View) -> Floats:
        """Return the tool's position (m), counted from the object."""
        return -view["distance"]

    def speed(self, position: Floats) -> Floats:
        """Return the speed (m/s, below 0 backwards) at `position` (m) from the object; far away it brakes evenly."""
        corners = self.columns(self.PARAMETERS[0].name, len(GAPS))
        far = np.maximum(-position - GAPS[-1], 0.0)
        near = interpolate(GAPS, corners, -position)
        braking = np.sqrt(np.maximum(corners[..., -1], 0.0) ** 2 + 2.0 * self["deceleration"] * far)
        return np.where(far > 0.0, np.minimum(braking, VELOCITY_RANGE[1]), near)
