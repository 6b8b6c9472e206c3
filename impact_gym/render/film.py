"""The state of an episode at any instant, and the instants of a slow-motion film."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from gymnasium.wrappers import RecordVideo

from impact_gym.outcome import Trace
from impact_gym.quantities import HORIZON
from impact_gym.task.episodes import EpisodeState
from impact_gym.task.task import Task

FRAME_RATE = 30  # 1/s, frames per second of a film
FLIGHT_FACTOR = 8  # slow-motion factor far from contacts; smaller if the horizon is longer than HORIZON
SHORTEST, LONGEST = 6.0, 10.0  # s, shortest and longest film
CONTACT_FACTOR = 32  # smallest slow-motion factor while tool and object touch, before the episode ends
LARGEST_FACTOR = 1024  # largest slow-motion factor
SMALLEST_FACTOR = 0.25  # smallest slow-motion factor, for a long simulation after the episode's end
FRAMES_PER_IMPACT = 16  # about the number of frames of an elastic Hertz impact
FRAMES_PER_FOLD = 6  # near a touch, frames are about (time to or since the touch) / FRAMES_PER_FOLD apart
SETTLING_FRAMES = 45  # intended maximum of frames after an episode's end; impacts, rounding and factor limits add some
SLOWEST_IMPACT = 1e-3  # m/s; the film of a slower impact has the slow-motion factor of an impact at this speed


class State(NamedTuple):
    """The state of flange, tool and object at one instant, in SI units; names as in `Trace`."""

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

    @property
    def penetration(self) -> float:
        """Depth of the tool's face in the undeformed object, m; without contact, minus the gap."""
        return self.tool_position - self.object_position

    @property
    def closing(self) -> float:
        """Time derivative of `penetration`, m/s."""
        return self.tool_velocity - self.object_velocity


class History:
    """An episode up to now, from the simulator's trace."""

    def __init__(self, trace: Trace, info: dict[str, Any], task: Task, events: EpisodeState, ended: bool) -> None:
        """Read the trace; if `ended`, the trace includes the simulation after the episode's end."""
        self.info, self.events, self.ended = info, events, ended
        if ended and events.alarm > events.end:  # the controller does not get this alarm
            self.events = events._replace(alarm=math.inf)
        self.task = task = task.at(info["record"])
        at_rest = {name: 0.0 for name in State._fields} | {"object_position": info["scenario"]["distance"]}
        rows = np.vstack([list(at_rest.values()), np.column_stack([getattr(trace, name) for name in at_rest])])
        rows = rows[np.isfinite(rows).all(axis=1)]  # a simulation can overflow
        self.columns = dict(zip(at_rest, np.ascontiguousarray(rows.T), strict=True))
        self.time = self.columns["time"]
        self.now = float(self.time[-1])
        object_mass = info["scenario"]["object_mass"]
        imposed = task.coupling.fixed and task.robot is None
        self.reduced_mass = object_mass if imposed else 1.0 / (1.0 / task.tool_mass + 1.0 / object_mass)
        touching = self.columns["tool_position"] - self.columns["object_position"] > 0.0
        edges = np.diff(touching.astype(np.int8), prepend=0)
        self.touches = self.time[np.maximum(np.flatnonzero(edges > 0) - 1, 0)]
        partings = self.time[np.flatnonzero(edges < 0)]
        self.partings = np.append(partings, math.inf)[: len(self.touches)]

    def at(self, time: float) -> State:
        """Return the state at `time` (s), interpolated linearly between points of the trace."""
        return State(*(float(np.interp(time, self.time, column)) for column in self.columns.values()))

    def factor(self, time: float) -> float:
        """Return the factor, a power of two, by which the film is slower than real time at `time` (s).

        The factor rises before a touch, so that an impact has about FRAMES_PER_IMPACT frames. From the touch on the
        factor falls, even during the contact, because a coupling can prolong the contact.
        """
        state = self.at(time)
        begun = int(np.searchsorted(self.touches, time, side="right"))
        touching = begun > 0 and time < self.partings[begun - 1]
        flight = min(max(FLIGHT_FACTOR * HORIZON / self.task.horizon, 1.0), FLIGHT_FACTOR)
        interval = 1.0 / (FRAME_RATE * (CONTACT_FACTOR if touching else flight))
        if self.ended and time >= self.events.end:
            interval = max(interval, (self.now - self.events.end) / SETTLING_FRAMES)
        away, speed = math.inf, 1.0
        if begun:
            touch = self.at(float(self.touches[begun - 1]))
            away, speed = time - touch.time, touch.closing
        if not touching and state.closing > SLOWEST_IMPACT and -state.penetration / state.closing < away:
            away, speed = -state.penetration / state.closing, state.closing
        speed = max(speed, SLOWEST_IMPACT)
        # depth and duration of an elastic Hertz impact at this speed: Johnson 1985, eq. 11.23 and 11.24
        depth = (1.25 * self.reduced_mass * speed * speed / self.info["scenario"]["contact_stiffness"]) ** 0.4
        finest = 2.9432 * depth / speed / FRAMES_PER_IMPACT
        interval = min(interval, max(away / FRAMES_PER_FOLD, finest))
        slower = 1.0 / (FRAME_RATE * max(interval, 1.0 / (FRAME_RATE * LARGEST_FACTOR)))
        return max(2.0 ** math.ceil(math.log2(slower) - 1e-9), SMALLEST_FACTOR)

    def film(self, after: float) -> Iterator[tuple[float, float]]:
        """Yield the instants (s) of the frames after the instant `after`, each with its factor.

        The time left after the last frame of a control step belongs to the first frame of the next step. Each step has
        at least one frame, and the last frame of an episode shows its last instant.
        """
        time, factor = after, self.factor(after)
        while time + 1.0 / (FRAME_RATE * factor) <= self.now:
            time += 1.0 / (FRAME_RATE * factor)
            yield time, factor
            factor = self.factor(time)
        if time < self.now and (self.ended or time == after):
            yield self.now, factor


class SlowMotionVideo(RecordVideo[Any, Any]):
    """A `RecordVideo` that records all pictures of each step; Gymnasium's class records only the last picture.

    Use it like `RecordVideo`, on an environment made with `render_mode="rgb_array_list"`. The film of an episode lasts
    SHORTEST to LONGEST seconds: a longer film loses pictures evenly, and a shorter film repeats its last picture. The
    class needs moviepy, from the extra `render`.

    Example:
        >>> env = gym.make("ImpactApproach-v0", render_mode="rgb_array_list")
        >>> env = SlowMotionVideo(env, "films", episode_trigger=lambda episode: True)
        >>> # play episodes as usual, then env.close(); films/rl-video-episode-0.mp4 is the first
    """

    def _capture_frame(self) -> None:
        frames: Any = self.env.render()
        self.recorded_frames += frames if isinstance(frames, list) else [frames]

    def stop_recording(self) -> None:
        """Save the film of the recorded pictures."""
        frames, rate = self.recorded_frames, self.frames_per_sec
        if frames:
            kept = np.linspace(0, len(frames) - 1, min(len(frames), round(LONGEST * rate))).round().astype(int)
            missing = max(round(SHORTEST * rate) - len(kept), 0)
            self.recorded_frames = [frames[place] for place in kept] + frames[-1:] * missing
        super().stop_recording()  # type: ignore[no-untyped-call]  # Gymnasium leaves it untyped
