"""Velocities and contact force over the last moments, with what the alarm does marked in both."""

import math

import numpy as np
from numpy.typing import NDArray

from impact_gym.envs import render_canvas as look
from impact_gym.envs.render_canvas import Box, Canvas
from impact_gym.envs.render_history import History, State

LEFT, RIGHT = 58.0, look.WIDTH - 190.0
VELOCITY: Box = (LEFT, 310.0, RIGHT - LEFT, 90.0)
FORCE: Box = (LEFT, 410.0, RIGHT - LEFT, 76.0)
WINDOW, AHEAD = 0.3, 0.03  # s, how much time a strip shows, and how much of it is still to come
LOWEST_FORCE, HIGHEST_FORCE = 0.1, 100.0  # N, ends of the logarithmic scale; the upper one moves up by decades
SMALL = 15  # pixels, size of figures
LIGHT_CONTACT, LIGHT_DELAY = "#E3F1EC", "#F7CF78"
DELAY_BAND = 8.0  # pixels


class Axes:
    """A strip: where a time and a value lie in the picture."""

    def __init__(self, box: Box, start: float, low: float, high: float) -> None:
        """Show times from `start` (s) and values from `low` to `high` in `box`."""
        self.left, self.top, self.width, self.height = box
        self.start, self.low, self.high = start, low, high

    def x(self, time: float) -> float:
        """Return the column of a time, kept inside the strip."""
        return self.left + self.width * min(max((time - self.start) / WINDOW, 0.0), 1.0)

    def y(self, value: float) -> float:
        """Return the row of a value, kept inside the strip."""
        return self.top + self.height * (1.0 - min(max((value - self.low) / (self.high - self.low), 0.0), 1.0))


def draw(canvas: Canvas, history: History, state: State) -> None:
    """Draw both strips up to the time of `state`."""
    start = max(state.time + AHEAD - WINDOW, 0.0)
    seen = slice(
        max(int(np.searchsorted(history.time, start)) - 1, 0),
        int(np.searchsorted(history.time, state.time, side="right")),
    )
    _velocities(canvas, history, state, start, seen)
    _force(canvas, history, state, start, seen)


def _velocities(canvas: Canvas, history: History, state: State, start: float, seen: slice) -> None:
    names = {"object_velocity": look.OBJECT, "tool_velocity": look.TOOL, "flange_velocity": look.FLANGE}
    so_far = [history.columns[name][: seen.stop] for name in names]
    high = max(history.task.velocity_range[1], *(math.ceil(2.0 * float(column.max())) / 2.0 for column in so_far)) + 0.1
    low = min(history.task.velocity_range[0], *(math.floor(2.0 * float(column.min())) / 2.0 for column in so_far)) - 0.1
    axes = Axes(VELOCITY, start, low, high)
    spacing = math.ceil((high - low) / 5.0)
    _ground(canvas, axes, history, state, "velocity (m/s)")
    for mark in range(math.ceil(low / spacing), math.floor(high / spacing) + 1):
        _mark(canvas, axes, mark * spacing, f"{mark * spacing}")
    for name, colour in names.items():
        _curve(canvas, axes, history, state, seen, name, colour)


def _force(canvas: Canvas, history: History, state: State, start: float, seen: slice) -> None:
    peak = max(float(history.columns["contact_force"][: seen.stop].max()), state.contact_force, HIGHEST_FORCE)
    top = math.ceil(math.log10(peak))
    axes = Axes(FORCE, start, math.log10(LOWEST_FORCE), float(top))
    _ground(canvas, axes, history, state, "contact force (N)")
    for decade in range(round(axes.low), top + 1, math.ceil((top + 1) / 5.0)):
        _mark(canvas, axes, float(decade), f"{10.0**decade:g}")
    threshold = axes.y(math.log10(history.threshold))
    canvas.dashes((axes.left, threshold), (axes.left + axes.width, threshold), look.WARNING)
    _curve(canvas, axes, history, state, seen, "contact_force", look.FORCE, logarithmic=True)
    for time in range(math.ceil(start * 20.0), math.floor((start + WINDOW) * 20.0) + 1):
        canvas.text(f"{time / 20.0:.2f} s", (axes.x(time / 20.0), axes.top + axes.height + 9.0), SMALL, look.FAINT,
                    "center")  # fmt: skip


def _ground(canvas: Canvas, axes: Axes, history: History, state: State, title: str) -> None:
    """Draw what lies under the curves: contacts, the reaction delay, the grid of time, the alarm."""
    bottom = axes.top + axes.height
    canvas.rectangle((axes.left, axes.top, axes.width, axes.height), look.PAPER)
    with canvas.clipped((axes.left, axes.top, axes.width, axes.height)):
        for touch, parting in zip(history.touches, history.partings, strict=True):
            if touch < state.time and parting > axes.start:
                _span(canvas, axes, touch, min(parting, state.time), LIGHT_CONTACT, axes.height)
        if history.detection <= state.time and history.alarm > axes.start:
            _span(canvas, axes, history.detection, min(history.alarm, state.time), LIGHT_DELAY, DELAY_BAND)
        for time in range(math.ceil(axes.start * 20.0), math.floor((axes.start + WINDOW) * 20.0) + 1):
            canvas.lines([(axes.x(time / 20.0), axes.top), (axes.x(time / 20.0), bottom)], look.GRID, 0.5)
        for instant, colour in ((history.detection, look.WARNING), (history.alarm, look.ALARM)):
            if axes.start < instant <= state.time:
                canvas.lines([(axes.x(instant), axes.top), (axes.x(instant), bottom)], colour, 1.5)
        now = axes.x(state.time)
        canvas.lines([(now, axes.top), (now, bottom)], look.FAINT, 1.0)
    canvas.text(title, (axes.left + 6.0, axes.top + 9.0), SMALL, look.FAINT)


def _span(canvas: Canvas, axes: Axes, begin: float, end: float, colour: str, height: float) -> None:
    canvas.rectangle((axes.x(begin), axes.top, axes.x(end) - axes.x(begin), height), colour)


def _mark(canvas: Canvas, axes: Axes, value: float, label: str) -> None:
    y = axes.y(value)
    canvas.lines([(axes.left, y), (axes.left + axes.width, y)], look.GRID, 0.5)
    canvas.text(label, (axes.left - 6.0, y), SMALL, look.FAINT, "midright")


def _curve(
    canvas: Canvas,
    axes: Axes,
    history: History,
    state: State,
    seen: slice,
    name: str,
    colour: str,
    logarithmic: bool = False,
) -> None:
    """Draw the trace up to the time of `state` and the value at it."""
    times = np.append(history.time[seen], state.time)
    values: NDArray[np.float64] = np.append(history.columns[name][seen], getattr(state, name))
    if logarithmic:
        values = np.log10(np.maximum(values, LOWEST_FORCE))
    with canvas.clipped((axes.left, axes.top, axes.width, axes.height + 1.0)):
        points = [(axes.x(time), axes.y(value)) for time, value in zip(times.tolist(), values.tolist(), strict=True)]
        canvas.lines(points, colour, 1.5)
    canvas.circle(points[-1], 3.0, colour)
