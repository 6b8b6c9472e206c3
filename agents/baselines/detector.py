"""Rules that do not trust the alarm: they detect the touch in the sensors' readings by themselves.

Where noisy readings raise the alarm (`alarm="reading"`) at a threshold within that noise, it is on most of the time.
A detector learns the noise and adds up the readings beyond it, by the rule of cumulative sums
(E. S. Page, Continuous inspection schemes, Biometrika 41, 1954).
"""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from agents.baselines.profile import BlindProfile, RangedProfile, ReactingRule
from agents.baselines.rule import Floats, Parameter, View
from impact_gym.task.task import VELOCITY_RANGE

LEAST_NOISE, USUAL_NOISE = 1e-3, 1e-2  # m, of estimates of the distance
CLOCK = 1e-6  # s, resolution of the observed time
Flags = NDArray[np.bool_]
DETECTOR = (
    Parameter("allowance", "N", 0.0, 20.0, 1.0),
    Parameter("allowance per noise", "-", 0.0, 5.0, 1.0),
    Parameter("detection", "N", 0.01, 50.0, 2.0),
    Parameter("detection per noise", "-", 0.0, 20.0, 4.0),
    Parameter("force per kick", "N/m", 0.0, 5e3, 200.0),
    Parameter("share that a deflection keeps", "-", 0.0, 1.0, 0.7),
)
"""Parameters of the cumulative sum: allowance of each step, threshold of a touch, weights of the readings."""


class OwnAlarmView(View):
    """A view with the rule's own alarm, raised at the times `raised` (s), inf where it is off."""

    def __init__(self, view: View, raised: Floats) -> None:
        super().__init__(view.observation, view.spec)
        self._raised = raised

    @property
    def alarm(self) -> Flags:
        """Whether it is on."""
        return np.isfinite(self._raised)

    @property
    def time_since_alarm(self) -> Floats:
        """Time since it was raised, s; 0 where it is off."""
        return np.where(self.alarm, self["time"] - np.where(self.alarm, self._raised, 0.0), 0.0)


class DetectorRule(ReactingRule):
    """A reacting rule whose alarm is Page's cumulative sum of force and deflection beyond their noise.

    Mean and spread of the readings are learnt while no alarm is on. A touch kicks the tool back: the kick is the change
    of the deflection beyond that of a critically damped tool. The alarm clears as an environment's does, so a false one
    costs no more than that time.
    """

    NEEDS: ClassVar[Mapping[str, Any]] = {"deflection_sensor": True, "past_readings": 2}
    MEMORY = 4  # the sum; of readings while no alarm was on how many, their mean and their squared deviations

    def see(self, view: View, state: Any, episode_start: Any) -> tuple[View, Any]:
        """Return a view with the rule's own alarm, and the next state: when that was raised (s), and `memory`."""
        time, start = view["time"], state is None or (episode_start is not None and episode_start)
        raised, *memory = np.zeros((1 + self.MEMORY, *np.shape(time))) if state is None else state
        cleared = start | (time > raised + self.task.after_alarm - CLOCK)
        raised = np.where(cleared, np.inf, raised)
        memory = [np.where(start, 0.0, each) for each in memory]
        touched, memory = self.touched(view, memory, cleared | np.isinf(raised))
        raised = np.where(touched, np.minimum(raised, time), raised)
        return OwnAlarmView(view, raised), (raised, *memory)

    def touched(self, view: View, memory: list[Floats], quiet: Flags) -> tuple[Flags, list[Floats]]:
        """Return whether a touch is detected now, and the MEMORY; `quiet` where no alarm is on."""
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


class DetectorProfile(DetectorRule, BlindProfile):
    """`BlindProfile` with the alarm of a detector."""

    PARAMETERS = (*BlindProfile.PARAMETERS, *DETECTOR)


class DetectorRanged(DetectorRule, RangedProfile):
    """`RangedProfile` with the alarm of a detector, told how good the estimate is: the worse, the longer and slower."""

    NEEDS: ClassVar[Mapping[str, Any]] = {
        **DetectorRule.NEEDS,
        "range_noise": (0.001, 0.01),
        "observe_range_noise": True,
    }
    PARAMETERS = (
        *RangedProfile.PARAMETERS,
        Parameter("stretch", "-", -0.5, 1.5, 0.3),
        Parameter("slowing", "-", -0.5, 1.5, 0.0),
        *DETECTOR,
    )

    def profile(self, view: View) -> Callable[[Floats], Floats]:
        """Return `RangedProfile`'s, with its places stretched and its speeds divided by powers of the noise."""
        noise = np.maximum(view["range_noise"], LEAST_NOISE) / USUAL_NOISE
        stretch, slowing = noise ** self["stretch"], noise ** self["slowing"]
        return lambda place: np.clip(self.speed(place / stretch) / slowing, 0.01, VELOCITY_RANGE[1])
