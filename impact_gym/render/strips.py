"""Plot the velocities of flange, tool and object over the last 0.3 s, and mark contacts, force detection and alarm."""

import math

import numpy as np

from impact_gym.render.canvas import Box, Canvas
from impact_gym.render.film import History, State
from impact_gym.render.palette import ALARM, FAINT, FLANGE, GRID, OBJECT, PANEL, TOOL, WARNING

WINDOW, AHEAD = 0.3, 0.03  # s, duration that the plot shows, and the part of it after the present time
SMALL = 24  # pixels, size of text
BODIES = {"flange_velocity": FLANGE, "tool_velocity": TOOL, "object_velocity": OBJECT}


def draw(canvas: Canvas, history: History, state: State, box: Box) -> None:
    """Draw the velocities up to the time of `state` in `box`, with names and units around it."""
    left, top, width, height = box
    start = max(state.time + AHEAD - WINDOW, 0.0)  # s
    first, end = np.searchsorted(history.time, start), np.searchsorted(history.time, state.time, side="right")
    seen = slice(max(int(first) - 1, 0), int(end))
    so_far = np.array([history.columns[name][: seen.stop] for name in BODIES])
    high = max(history.task.velocity_range[1], math.ceil(2.0 * float(so_far.max())) / 2.0) + 0.1
    low = min(0.0, math.floor(2.0 * float(so_far.min())) / 2.0) - 0.1

    def x(time: float) -> float:
        return left + width * min(max((time - start) / WINDOW, 0.0), 1.0)

    def y(velocity: float) -> float:
        return top + height * (high - velocity) / (high - low)

    canvas.rectangle(box, PANEL)
    for touch, parting in zip(history.touches, history.partings, strict=True):
        if touch < state.time and parting > start:
            canvas.rectangle((x(touch), top, x(min(parting, state.time)) - x(touch), height), GRID)
    spacing = math.ceil((high - low) / 3.0)
    for mark in range(math.ceil(low / spacing), math.floor(high / spacing) + 1):
        line = y(mark * spacing)
        canvas.lines([(left, line), (left + width, line)], FAINT, 0.5)
        canvas.text(f"{mark * spacing}", (left - 8.0, line), SMALL, FAINT, "midright")
    for instant, colour in ((history.events.detection, WARNING), (history.events.alarm, ALARM), (state.time, FAINT)):
        if start < instant <= state.time:
            canvas.lines([(x(instant), top), (x(instant), top + height)], colour, 1.5)
    times = np.append(history.time[seen], state.time)
    with canvas.clipped((left, top, width, height + 1.0)):
        for name, colour in BODIES.items():
            values = np.append(history.columns[name][seen], getattr(state, name))
            points = [(x(time), y(value)) for time, value in zip(times.tolist(), values.tolist(), strict=True)]
            canvas.lines(points, colour, 3.0)
            canvas.circle(points[-1], 5.0, colour)
    canvas.text("m/s", (left - 8.0, top - 16.0), SMALL, FAINT, "midright")
    for place, (name, colour) in enumerate(BODIES.items()):
        canvas.text(name.partition("_")[0], (left + 8.0 + 90.0 * place, top - 16.0), SMALL, colour)
    for k in range(math.ceil(start * 10.0), math.floor((start + WINDOW) * 10) + 1):
        if left + 20.0 < x(k / 10.0) < left + width - 20.0:
            canvas.text(f"{k / 10.0:.1f} s", (x(k / 10.0), top + height + 16.0), SMALL, FAINT, "center")
