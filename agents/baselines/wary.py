"""Rules that do not trust the alarm: each judges the readings of the force by a threshold of its own.

Where noisy readings raise the alarm (`alarm="reading"`) at a threshold within that noise, it is on most of the time.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.baselines.profile import BlindProfile, Ranged
from agents.baselines.reaction import ReactingRule
from agents.baselines.rule import Floats, Parameter, Seen, encode
from impact_gym.envs.scenario import Range
from impact_gym.envs.task import AFTER_ALARM

THRESHOLD = Parameter("own threshold", "N", 0.5, 100.0, 10.0)
CLOCK = 1e-6  # s, resolution of the time that is seen


class Judged(Seen):
    """What is seen, with an alarm that was raised at the times `raised` (s), inf where it is off."""

    def __init__(self, observation: ArrayLike, velocity_range: Range, raised: Floats) -> None:
        super().__init__(observation, velocity_range)
        self._raised = raised

    @property
    def alarm(self) -> NDArray[np.bool_]:
        """Whether it is on."""
        return np.isfinite(self._raised)

    @property
    def since_alarm(self) -> Floats:
        """Time since it was raised, s; 0 where it is off."""
        return np.where(self.alarm, self.time - np.where(self.alarm, self._raised, 0.0), 0.0)


class WaryRule(ReactingRule):
    """A reacting rule whose alarm is a reading above THRESHOLD, its last parameter; it is over after 0.15 s.

    So what was no touch costs that time and no more.
    """

    def predict(
        self,
        observation: NDArray[np.float32],
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the actions, and when the alarm was raised, s."""
        seen = Seen(observation, self.velocity_range)
        time = seen.time
        raised = np.full(np.shape(time), np.inf) if state is None else state
        raised = np.where(time > raised + AFTER_ALARM - CLOCK, np.inf, raised)
        raised = np.where(False if episode_start is None else episode_start, np.inf, raised)
        raised = np.where(seen.force > self[THRESHOLD.name], np.minimum(raised, time), raised)
        command = self.command(Judged(observation, self.velocity_range, raised))
        return encode(*command, self.velocity_range, self.acceleration_range), raised


class WaryProfile(WaryRule, BlindProfile):
    """`BlindProfile` with an alarm of its own."""

    PARAMETERS = (*BlindProfile.PARAMETERS, THRESHOLD)


class WaryRanged(WaryRule, Ranged):
    """`Ranged` with an alarm of its own."""

    PARAMETERS = (*Ranged.PARAMETERS, THRESHOLD)
