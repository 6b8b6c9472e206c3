"""Velocities and contact force over the last moments, with touches, force detection and alarm marked in both."""

import math

import numpy as np

from impact_gym.render.canvas import ALARM, FAINT, FLANGE, GRID, OBJECT, PAPER, TOOL, WARNING, WIDTH, Box, Canvas
from impact_gym.render.canvas import FORCE as GREEN
from impact_gym.render.film import History, State

LEFT, RIGHT = 58.0, WIDTH - 190.0
VELOCITY: Box = (LEFT, 310.0, RIGHT - LEFT, 90.0)
FORCE: Box = (LEFT, 410.0, RIGHT - LEFT, 76.0)
WINDOW, AHEAD = 0.3, 0.03  # s, length of a strip in time, and the part of it that is still to come
LOWEST_FORCE, HIGHEST_FORCE = 0.1, 100.0  # N, ends of the logarithmic scale; the upper one moves up by decades
SMALL = 15  # pixels, size of figures
LIGHT_CONTACT, LIGHT_DELAY = "#E3F1EC", "#F7CF78"
DELAY_BAND = 8.0  # pixels


class Strip:
    """A strip of the picture up to the time of `state`, and where a time and a value lie in it."""

    def __init__(
        self, canvas: Canvas, history: History, state: State, box: Box, low: float, high: float, title: str
    ) -> None:
        """Draw the background in `box`, of values from `low` to `high`: contacts, reaction delay, time, alarm."""
        self.canvas, self.history, self.state = canvas, history, state
        self.left, self.top, self.width, self.height = self.box = box
        self.low, self.high, now = low, high, state.time
        self.start = max(now + AHEAD - WINDOW, 0.0)  # s
        self.times = [k / 20.0 for k in range(math.ceil(self.start * 20.0), math.floor((self.start + WINDOW) * 20) + 1)]
        events, by_switch = history.events, history.task.alarm == "force" and history.events.alarm < math.inf
        canvas.rectangle(box, PAPER)
        with canvas.clipped(box):
            for touch, parting in zip(history.touches, history.partings, strict=True):
                if touch < now and parting > self.start:
                    self._span(touch, min(parting, now), LIGHT_CONTACT, self.height)
            if by_switch and events.detection <= now and events.alarm > self.start:
                self._span(events.detection, min(events.alarm, now), LIGHT_DELAY, DELAY_BAND)
            for time in self.times:
                self._instant(time, GRID, 0.5)
            for instant, colour in ((events.detection, WARNING), (events.alarm, ALARM)):
                if self.start < instant <= now:
                    self._instant(instant, colour, 1.5)
            self._instant(now, FAINT, 1.0)
        canvas.text(title, (self.left + 6.0, self.top + 9.0), SMALL, FAINT)

    def x(self, time: float) -> float:
        """Return the column of a time, kept inside the strip."""
        return self.left + self.width * min(max((time - self.start) / WINDOW, 0.0), 1.0)

    def y(self, value: float) -> float:
        """Return the row of a value, kept inside the strip."""
        return self.top + self.height * (1.0 - min(max((value - self.low) / (self.high - self.low), 0.0), 1.0))

    def _span(self, begin: float, end: float, colour: str, height: float) -> None:
        self.canvas.rectangle((self.x(begin), self.top, self.x(end) - self.x(begin), height), colour)

    def _instant(self, time: float, colour: str, width: float) -> None:
        self.canvas.lines([(self.x(time), self.top), (self.x(time), self.top + self.height)], colour, width)

    def mark(self, value: float, label: str) -> None:
        """Draw a line of the grid at a value."""
        y = self.y(value)
        self.canvas.lines([(self.left, y), (self.left + self.width, y)], GRID, 0.5)
        self.canvas.text(label, (self.left - 6.0, y), SMALL, FAINT, "midright")

    def curve(self, name: str, colour: str, logarithmic: bool = False) -> None:
        """Draw the trace up to the time of the state, and a dot at its end."""
        first = max(int(np.searchsorted(self.history.time, self.start)) - 1, 0)
        seen = slice(first, self.history.seen(self.state.time))
        times = np.append(self.history.time[seen], self.state.time)
        values = np.append(self.history.columns[name][seen], getattr(self.state, name))
        if logarithmic:
            values = np.log10(np.maximum(values, LOWEST_FORCE))
        points = [(self.x(time), self.y(value)) for time, value in zip(times.tolist(), values.tolist(), strict=True)]
        with self.canvas.clipped((self.left, self.top, self.width, self.height + 1.0)):
            self.canvas.lines(points, colour, 1.5)
        self.canvas.circle(points[-1], 3.0, colour)


def draw(canvas: Canvas, history: History, state: State) -> None:
    """Draw both strips up to the time of `state`."""
    names = {"object_velocity": OBJECT, "tool_velocity": TOOL, "flange_velocity": FLANGE}
    so_far = [history.columns[name][: history.seen(state.time)] for name in names]
    high = max(history.task.velocity_range[1], *(math.ceil(2.0 * float(column.max())) / 2.0 for column in so_far)) + 0.1
    low = min(history.task.velocity_range[0], *(math.floor(2.0 * float(column.min())) / 2.0 for column in so_far)) - 0.1
    strip = Strip(canvas, history, state, VELOCITY, low, high, "velocity (m/s)")
    spacing = math.ceil((high - low) / 5.0)
    for mark in range(math.ceil(low / spacing), math.floor(high / spacing) + 1):
        strip.mark(mark * spacing, f"{mark * spacing}")
    for name, colour in names.items():
        strip.curve(name, colour)

    top = math.ceil(math.log10(max(history.peak_force(state), HIGHEST_FORCE)))
    strip = Strip(canvas, history, state, FORCE, math.log10(LOWEST_FORCE), float(top), "contact force (N)")
    for decade in range(round(strip.low), top + 1, math.ceil((top + 1) / 5.0)):
        strip.mark(float(decade), f"{10.0**decade:g}")
    threshold = strip.y(math.log10(history.threshold))
    canvas.dashes((strip.left, threshold), (strip.left + strip.width, threshold), WARNING)
    strip.curve("contact_force", GREEN, logarithmic=True)
    for time in strip.times:
        canvas.text(f"{time:.2f} s", (strip.x(time), strip.top + strip.height + 9.0), SMALL, FAINT, "center")
