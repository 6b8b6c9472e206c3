"""Rules that do not trust the alarm: each compares the force readings with a threshold of its own.

Where noisy readings raise the alarm (`alarm="reading"`) at a threshold within that noise, it is on most of the time.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.baselines.profile import BlindProfile, Ranged
from agents.baselines.reaction import ReactingRule
from agents.baselines.rule import Floats, Parameter, View

THRESHOLD = Parameter("own threshold", "N", 0.5, 100.0, 10.0)
CLOCK = 1e-6  # s, resolution of the observed time


class OwnAlarmView(View):
    """A view with an alarm of one's own, raised at the times `raised` (s), inf where it is off."""

    def __init__(self, view: View, raised: Floats) -> None:
        super().__init__(view.observation, view.spec)
        self._raised = raised

    @property
    def alarm(self) -> NDArray[np.bool_]:
        """Whether it is on."""
        return np.isfinite(self._raised)

    @property
    def time_since_alarm(self) -> Floats:
        """Time since it was raised, s; 0 where it is off."""
        return np.where(self.alarm, self["time"] - np.where(self.alarm, self._raised, 0.0), 0.0)


class OwnThresholdRule(ReactingRule):
    """A reacting rule whose alarm is a reading above THRESHOLD, its last parameter; it clears as an environment's does.

    So a false alarm costs that time and no more.
    """

    def see(self, view: View, state: Any, episode_start: Any) -> tuple[View, Any]:
        """Return a view with the rule's own alarm, and when that was raised, s."""
        time = view["time"]
        raised = np.full(np.shape(time), np.inf) if state is None else state
        raised = np.where(time > raised + self.task.after_alarm - CLOCK, np.inf, raised)
        raised = np.where(False if episode_start is None else episode_start, np.inf, raised)
        raised = np.where(view["force"] > self[THRESHOLD.name], np.minimum(raised, time), raised)
        return OwnAlarmView(view, raised), raised


class WaryProfile(OwnThresholdRule, BlindProfile):
    """`BlindProfile` with an alarm of its own."""

    PARAMETERS = (*BlindProfile.PARAMETERS, THRESHOLD)


class WaryRanged(OwnThresholdRule, Ranged):
    """`Ranged` with an alarm of its own."""

    PARAMETERS = (*Ranged.PARAMETERS, THRESHOLD)
