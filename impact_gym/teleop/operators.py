"""Operators, which command the velocity of an arm over a channel: persons, models of persons, recordings.

A model with a `place_error` assumes that the object is at its true distance plus this error. From about this place on,
the model searches for the object at the speed `creep`. All models stop a reaction time after the display shows a touch.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from impact_gym.kernels import PERSON, REACH, REPLAY, SECOND_ORDER_LAG, STEADY, TRACKER
from impact_gym.parameters import SI, Parameters
from impact_gym.support.validation import rising

SIMPLE_REACTION = 0.213  # s, mean reaction time of 1,469 persons (Woods et al., Front. Hum. Neurosci. 9, 2015, 131)
Instants = Annotated[tuple[float, ...], SI("s", at_least=0.0, at_most=1e6)]


@dataclass(frozen=True, slots=True)
class Replay(Parameters, path="operator"):
    """Recorded commands, interpolated linearly; the last command is held. `Replay` reacts to nothing.

    With a `length` (s), `time` and `velocity` contain several recordings of this length, one after another.
    `recording` is the index, from 0, of the recording to play; with (0, n) each episode draws one of n recordings.
    """

    time: Instants  # rising from 0
    velocity: Annotated[tuple[float, ...], SI("m/s", at_least=-1e3, at_most=1e3)]  # one for each time
    recording: float = 0.0  # -, index, rounded down
    length: Annotated[float, SI("s", at_least=0.0, at_most=1e3)] = 0.0  # duration of each recording; 0: only one

    def __post_init__(self) -> None:
        Parameters.__post_init__(self)
        rising("Replay", self.time, "velocity", self.velocity)
        count = np.ceil(self.time[-1] / self.length) if self.length else 0.0
        if self.recording > count:
            raise ValueError(f"Replay.recording must be at most {count:g} for these times, got {self.recording!r}")

    @property
    def table(self) -> NDArray[np.float64]:
        """The recordings for the compiled program: n times (s), then n commands (m/s)."""
        return np.array([*self.time, *self.velocity])


@dataclass(frozen=True, slots=True)
class Person(Parameters, path="operator"):
    """A person. The command is the velocity last passed to the environment's `command`; 0 when an episode begins."""


@dataclass(frozen=True, slots=True)
class Trapezoid(Parameters, path="operator"):
    """A constant commanded speed until the operator stops; the arm's speed is a trapezoid (paper, Fig. 11)."""

    speed: float = 0.5  # m/s
    reaction: float = SIMPLE_REACTION  # s


@dataclass(frozen=True, slots=True)
class Searcher(Parameters, path="operator"):
    """Base of the operators that assume where the object is."""

    place_error: float  # m
    creep: float  # m/s
    speed: float = 0.5  # m/s
    reaction: float = SIMPLE_REACTION  # s


@dataclass(frozen=True, slots=True)
class Reach(Searcher):
    """A motion of minimum jerk to the assumed place (Flash and Hogan 1985, J. Neurosci. 5, 1688-1703).

    The peak velocity is 1.875 times the mean velocity, and at most `speed`. The duration of the motion is multiplied by
    1 + `lag_slope` x (sum of the channels' mean delays): 1.64 at 225 ms (MacKenzie and Ware 1993, CHI '93, 488-493).
    Motor noise is proportional to the control signal; the noise is filtered by two lags of 40 ms (Todorov 2005, as in
    RothkopfLab/inverse-optimal-control).
    """

    lag_slope: float = 0.64 / 0.225  # 1/s
    noise: float = 0.5  # -


@dataclass(frozen=True, slots=True)
class SecondOrderLag(Searcher):
    """A pointing hand, pulled by a spring and damper to a moving target.

    The target moves at constant speed to the assumed place of the object. The hand's peak velocity is at most `speed`.
    Stiffness and damping are medians of 192 fits, from `optparams/` in the repository fl0fischer/OFC4HCI.
    """

    stiffness: float = 38.0  # 1/s^2, stiffness divided by the hand's mass
    damping: float = 8.9  # 1/s, damping divided by the hand's mass


@dataclass(frozen=True, slots=True)
class Tracker(Searcher):
    """The crossover model: the command is `gain` x the remaining distance on the display, within [`creep`, `speed`].

    `gain` and `reaction` are the initial values of the fits in Idate96/MRAC_manual_control (src/optimize_runs_u.m).
    """

    reaction: float = 0.2  # s
    gain: float = 2.5  # rad/s


Operator = Replay | Person | Trapezoid | Reach | SecondOrderLag | Tracker
KINDS = {
    Replay: REPLAY, Person: PERSON, Trapezoid: STEADY, Reach: REACH, SecondOrderLag: SECOND_ORDER_LAG,
    Tracker: TRACKER,
}  # fmt: skip
