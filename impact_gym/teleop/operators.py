"""Operators, who command an arm from afar.

An operator commands a velocity, and sees a touch on the display. Operators do not know where the object stands: they
believe it `place_error` beyond its face, and search at the speed `creep` from there on. All but a `Replay` and a
`Person` stop a reaction time after the display shows the touch. In a dict, as in a set-up's file, any number
may be a pair, from which episodes draw. A number without a default has none because no source for one was found.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from impact_gym.kernels import PERSON, REACH, REPLAY, SECOND_ORDER_LAG, STEADY, TRACKER
from impact_gym.parameters import SI, Parameters
from impact_gym.validation import rising

SIMPLE_REACTION = 0.213  # s, mean of 1,469 persons (Woods et al., Front. Hum. Neurosci. 9, 2015, 131)
NOTHING: NDArray[np.float64] = np.empty(0)
Instants = Annotated[tuple[float, ...], SI("s", at_least=0.0, at_most=1e6)]


class Commander(Parameters, path="operator"):
    """Base of all operators."""

    __slots__ = ()

    @property
    def table(self) -> NDArray[np.float64]:
        """Recorded times (s), then as many commands (m/s); empty without a recording."""
        return NOTHING

    @property
    def recorded(self) -> NDArray[np.float64]:
        """Recorded commands, m/s."""
        return self.table[len(self.table) // 2 :]


@dataclass(frozen=True, slots=True)
class Replay(Commander):
    """Plays recorded commands, linear between their points, the last one held; sees nothing.

    With a `length` there are several recordings in a row, which begin `length` apart: `recording` counts
    from 0, and from a pair (0, n) an episode draws one of n.
    """

    time: Instants  # rising, from 0
    velocity: Annotated[tuple[float, ...], SI("m/s", at_least=-1e3, at_most=1e3)]  # at each
    recording: float = 0.0  # -, its fraction does not count
    length: Annotated[float, SI("s", at_least=0.0, at_most=1e3)] = 0.0  # at least the horizon; 0: there is one

    def __post_init__(self) -> None:
        Parameters.__post_init__(self)
        rising("Replay", self.time, {"velocity": self.velocity})
        count = np.ceil(self.time[-1] / self.length) if self.length else 0.0
        if self.recording > count:
            raise ValueError(
                f"Replay.recording must be at most {count:g}, as many as there are, got {self.recording!r}"
            )

    @property
    def table(self) -> NDArray[np.float64]:
        """Times, s, then commands, m/s."""
        return np.array([*self.time, *self.velocity])


@dataclass(frozen=True, slots=True)
class Person(Commander):
    """A person: sends at each tick the velocity last given to the environment's `command`, at first 0."""


@dataclass(frozen=True, slots=True)
class Trapezoid(Commander):
    """One speed until the stop: with an arm of finite acceleration the paper's trapezoid (paper, Fig. 11)."""

    speed: float = 0.5  # m/s
    reaction: float = SIMPLE_REACTION  # s


@dataclass(frozen=True, slots=True)
class Reach(Commander):
    """A minimum jerk to where the object is believed (Flash and Hogan 1985, J. Neurosci. 5, 1688-1703).

    Its peak is 1.875 times the mean and at most `speed`. Lag lengthens it: 64 % at 225 ms (MacKenzie and Ware 1993,
    CHI '93, 488-493, whose effect is a factor). Its noise is signal-dependent: a share of the control, behind two lags
    of 40 ms (Todorov 2005, as in the code of RothkopfLab/inverse-optimal-control).
    """

    place_error: float  # m
    creep: float  # m/s
    speed: float = 0.5  # m/s
    reaction: float = SIMPLE_REACTION  # s
    lag_slope: float = 0.64 / 0.225  # 1/s
    noise: float = 0.5  # -


@dataclass(frozen=True, slots=True)
class SecondOrderLag(Commander):
    """A pointing hand on a spring and damper (medians of 192 fits, `optparams/` of fl0fischer/OFC4HCI).

    Its target goes to where the object is believed, so fast that the hand, with its overshoot, gets to `speed`.
    """

    place_error: float  # m
    creep: float  # m/s
    speed: float = 0.5  # m/s
    reaction: float = SIMPLE_REACTION  # s
    stiffness: float = 38.0  # 1/s^2
    damping: float = 8.9  # 1/s


@dataclass(frozen=True, slots=True)
class Tracker(Commander):
    """The crossover model: a speed of `gain` times the remaining distance that the operator sees.

    `gain` and `reaction` are where `src/optimize_runs_u.m` of Idate96/MRAC_manual_control begins to fit recorded runs.
    """

    place_error: float  # m
    creep: float  # m/s
    speed: float = 0.5  # m/s
    gain: float = 2.5  # rad/s
    reaction: float = 0.2  # s


Operator = Replay | Person | Trapezoid | Reach | SecondOrderLag | Tracker
KINDS = {
    Replay: REPLAY, Person: PERSON, Trapezoid: STEADY, Reach: REACH, SecondOrderLag: SECOND_ORDER_LAG,
    Tracker: TRACKER,
}  # fmt: skip
"""Kinds in the compiled program."""
