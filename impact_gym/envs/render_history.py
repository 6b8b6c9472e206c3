"""What is drawn, and when: the time histories of an episode read at any instant, and the instants of a slowed film."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from impact_gym.envs.batch import EpisodeState
from impact_gym.outcome import Trace
from impact_gym.scene import Rigid
from impact_gym.task.task import Task

FRAME_RATE = 30  # 1/s
FLIGHT_FACTOR = 8  # times slower than life, where nothing touches
CONTACT_FACTOR = 32  # times slower at least, while tool and object touch
LARGEST_FACTOR = 1024  # times slower at the most
SMALLEST_FACTOR = 0.25  # faster than life, for a long settling
FRAMES_PER_IMPACT = 16  # in the time that an elastic Hertz impact of the bodies takes
FRAMES_PER_FOLD = 8  # while the time to or since the touch grows e-fold
SETTLING_FRAMES = 90  # after the end, but for impacts, at the most
SLOWEST_IMPACT = 1e-3  # m/s


class State(NamedTuple):
    """The chain at one instant: SI units, names as in `Trace`."""

    time: float
    flange_position: float
    flange_velocity: float
    tool_position: float
    tool_velocity: float
    object_position: float
    object_velocity: float
    contact_force: float
    coupling_force: float
    command_position: float
    command_velocity: float

    @property
    def penetration(self) -> float:
        """How far the tool's face is behind the object's undeformed one, m; the gap is its negative."""
        return self.tool_position - self.object_position

    @property
    def closing(self) -> float:
        """How fast it comes nearer, m/s."""
        return self.tool_velocity - self.object_velocity


class History:
    """An episode up to now, from the simulator's own trace: nothing here is simulated again."""

    def __init__(self, trace: Trace, info: dict[str, Any], task: Task, events: EpisodeState, ended: bool) -> None:
        """Take the trace, which begins with the first step, `info` and the times of alarm and end.

        These are what `episode_info()` and `episode_state()` of an environment return. `task` becomes that of this
        episode, with what it drew.
        """
        self.info = info
        self.ended = ended
        self.events = events
        self.task = task = task.at(info["record"])
        at_rest = {name: 0.0 for name in State._fields} | {"object_position": info["scenario"]["distance"]}
        rows = np.vstack([list(at_rest.values()), np.column_stack([getattr(trace, name) for name in at_rest])])
        rows = rows[np.isfinite(rows).all(axis=1)]  # a solver that fails may leave others
        self.columns = dict(zip(at_rest, np.ascontiguousarray(rows.T), strict=True))
        self.time = self.columns["time"]
        self.now = float(self.time[-1])
        object_mass = info["scenario"]["object_mass"]
        imposed = isinstance(task.coupling, Rigid) and task.robot is None
        self.reduced_mass = object_mass if imposed else 1.0 / (1.0 / task.tool_mass + 1.0 / object_mass)
        touching = self.columns["tool_position"] - self.columns["object_position"] > 0.0
        edges = np.diff(touching.astype(np.int8), prepend=0)
        self.touches = self.time[np.maximum(np.flatnonzero(edges > 0) - 1, 0)]
        partings = self.time[np.flatnonzero(edges < 0)]
        self.partings = np.append(partings, math.inf)[: len(self.touches)]
        self.threshold = task.alarm_threshold

    def at(self, time: float) -> State:
        """Return the chain at `time` (s), linear between points of the trace."""
        return State(*(float(np.interp(time, self.time, column)) for column in self.columns.values()))

    def seen(self, time: float) -> int:
        """Return how many points of the trace lie up to `time` (s)."""
        return int(np.searchsorted(self.time, time, side="right"))

    def peak_force(self, state: State) -> float:
        """Return the largest contact force up to the time of `state`, N."""
        return max(float(self.columns["contact_force"][: self.seen(state.time)].max()), state.contact_force)

    def impact_time(self, speed: float) -> float:
        """Time from touch to parting of an elastic Hertz impact at `speed` (m/s), s (Johnson 1985, eq. 11.24)."""
        return 2.9432 * self.impact_depth(speed) / speed

    def impact_depth(self, speed: float) -> float:
        """Deepest penetration of such an impact, m (Johnson 1985, eq. 11.23)."""
        stiffness = self.info["scenario"]["contact_stiffness"]
        return (1.25 * self.reduced_mass * speed * speed / stiffness) ** 0.4

    def factor(self, time: float) -> float:
        """How many times slower than life a film runs at `time` (s): a power of two.

        It rises as the touch comes near, so that the impact itself gets FRAMES_PER_IMPACT frames, and falls with the
        time since: a contact that the coupling then presses on for a hundred impact times is not stretched as much.
        """
        state = self.at(time)
        begun = int(np.searchsorted(self.touches, time, side="right"))
        touching = begun > 0 and time < self.partings[begun - 1]
        interval = 1.0 / (FRAME_RATE * (CONTACT_FACTOR if touching else FLIGHT_FACTOR))
        if self.ended and time >= self.events.end:
            interval = max(interval, (self.now - self.events.end) / SETTLING_FRAMES)
        away, speed = math.inf, 1.0
        if begun:
            touch = self.at(float(self.touches[begun - 1]))
            away, speed = time - touch.time, touch.closing
        if not touching and state.closing > SLOWEST_IMPACT and -state.penetration / state.closing < away:
            away, speed = -state.penetration / state.closing, state.closing
        finest = self.impact_time(max(speed, SLOWEST_IMPACT)) / FRAMES_PER_IMPACT
        interval = min(interval, max(away / FRAMES_PER_FOLD, finest))
        slower = 1.0 / (FRAME_RATE * max(interval, 1.0 / (FRAME_RATE * LARGEST_FACTOR)))
        return max(2.0 ** math.ceil(math.log2(slower) - 1e-9), SMALLEST_FACTOR)

    def film(self, after: float) -> Iterator[tuple[float, float]]:
        """Yield instants (s) after `after` for frames, each with its factor.

        What is left of a step for less than a frame comes with the next; but some frame comes of any step, and the
        last one of an episode shows how it ended.
        """
        time, factor = after, self.factor(after)
        while time + 1.0 / (FRAME_RATE * factor) <= self.now:
            time += 1.0 / (FRAME_RATE * factor)
            yield time, factor
            factor = self.factor(time)
        if time < self.now and (self.ended or time == after):
            yield self.now, factor
