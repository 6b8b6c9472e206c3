"""Rules that detect the touch from sensor readings instead of using the environment's alarm.

The method is a cumulative sum (E. S. Page, Continuous inspection schemes, Biometrika 41, 1954).
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from agents.baselines.profile import BlindProfile, ReactingRule, StretchedProfile
from agents.baselines.rule import CLOCK, Floats, Parameter, View

Flags = NDArray[np.bool_]
DETECTOR = (
    Parameter("allowance", "N", 0.0, 20.0, 1.0),
    Parameter("allowance per noise", "-", 0.0, 5.0, 1.0),
    Parameter("detection", "N", 0.01, 50.0, 2.0),
    Parameter("detection per noise", "-", 0.0, 20.0, 4.0),
    Parameter("force per kick", "N/m", 0.0, 5e3, 200.0),
    Parameter("share that a deflection keeps", "-", 0.0, 1.0, 0.7),
)
"""Parameters of the cumulative sum in `DetectorRule.touched`. For a critically damped tool, the last parameter is
exp(-w T), with the natural frequency w (rad/s) and the control period T (s)."""


class DetectorRule(ReactingRule):
    """A `ReactingRule` that raises its own alarm when a cumulative sum over the readings detects a touch.

    While the alarm is off, the rule estimates mean and standard deviation (noise) of the force readings. The `kick`
    is the deflection minus the value that the two previous readings predict for the free motion of a critically damped
    tool. The alarm lasts for the time `after_alarm`, an argument of the environment.
    """

    NEEDS: ClassVar[Mapping[str, Any]] = {"deflection_sensor": True, "past_readings": 2}
    MEMORY = 4  # cumulative sum; count, mean and sum of squared deviations of the forces read while the alarm is off

    def see(self, view: View, state: Any, episode_start: Any) -> tuple[View, Any]:
        """Return the view with the rule's own alarm, and the next state.

        The state holds the time (s) at which the alarm began, inf while the alarm is off, and MEMORY further numbers.
        """
        time, start = view["time"], state is None or (episode_start is not None and episode_start)
        raised, *memory = np.zeros((1 + self.MEMORY, *np.shape(time))) if state is None else state
        cleared = start | (time > raised + self.task.after_alarm - CLOCK)
        raised = np.where(cleared, np.inf, raised)
        memory = [np.where(start, 0.0, each) for each in memory]
        touched, memory = self.touched(view, memory, cleared | np.isinf(raised))
        raised = np.where(touched, np.minimum(raised, time), raised)
        alarm = np.isfinite(raised)
        since = np.where(alarm, time - np.where(alarm, raised, 0.0), 0.0)
        own = View(view.observation, view.spec, alarm=alarm.astype(np.float64), time_since_alarm=since)
        return own, (raised, *memory)

    def touched(self, view: View, memory: list[Floats], quiet: Flags) -> tuple[Flags, list[Floats]]:
        """Return whether a touch is detected now, and the next memory; `quiet`: rows whose alarm is off."""
        total, count, mean, squares = memory
        force, noise = view["force"], np.sqrt(squares / np.maximum(count - 1.0, 1.0))
        now, before, earlier = view["deflection"], view["deflection_1"], view["deflection_2"]
        kept = self["share that a deflection keeps"]
        kick = (now - kept * before) - kept * (before - kept * earlier)
        evidence = np.where(count > 0.0, force - mean, 0.0) - self["force per kick"] * kick
        total = np.maximum(total + evidence - self["allowance"] - self["allowance per noise"] * noise, 0.0)
        touched = total > self["detection"] + self["detection per noise"] * noise
        learns = quiet & ~touched
        count = count + learns
        learnt = mean + np.where(learns, (force - mean) / np.maximum(count, 1.0), 0.0)
        squares = squares + np.where(learns, (force - mean) * (force - learnt), 0.0)
        return touched, [np.where(touched, 0.0, total), count, learnt, squares]


class DetectorProfile(DetectorRule, BlindProfile, tunable=True):
    """Follow a speed profile over the flange's position; a detector raises the alarm."""

    PARAMETERS = (*BlindProfile.PARAMETERS, *DETECTOR)


class DetectorRanged(DetectorRule, StretchedProfile, tunable=True):
    """Follow a speed profile over the estimated distance; a detector raises the alarm."""

    NEEDS: ClassVar[Mapping[str, Any]] = {
        **DetectorRule.NEEDS, "range_noise": (0.001, 0.01), "observe_range_noise": True,
    }  # fmt: skip
    PARAMETERS = (*StretchedProfile.PARAMETERS, *DETECTOR)
