"""What holds the tool, drawn from the flange's front to the tool's back: a bar, a spring and damper, a mechanism."""

import math
from typing import NamedTuple

from impact_gym.envs import render_canvas as look
from impact_gym.envs.render_canvas import Canvas, Colour, Point
from impact_gym.scene import Bistable

CLEARANCE = 0.004  # m, half a slider's length, and the thickness of a stop
COILS = 9
SHORTEST = 0.002  # m, what is left of a spring that the tool has run over


class Camera(NamedTuple):
    """Where a position lies in the picture."""

    left: float  # m, at the left edge
    scale: float  # pixels per m
    axis: float  # pixels from above, of the line along which all move

    def x(self, position: float) -> float:
        """Return the column of `position` (m), pixels."""
        return (position - self.left) * self.scale

    def block(self, canvas: Canvas, back: float, front: float, height: float, colour: Colour) -> None:
        """Draw a bar from `back` to `front` around the line, all in m."""
        tall = height * self.scale
        canvas.rectangle((self.x(back), self.axis - 0.5 * tall, self.x(front) - self.x(back), tall), colour)


def spring(canvas: Canvas, start: Point, end: Point, amplitude: float, colour: Colour, coils: int = COILS) -> None:
    """Draw a coil spring from `start` to `end`; `amplitude` in pixels."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = max(math.hypot(dx, dy), 1e-9)
    points = [start]
    for turn in range(2 * coils):
        part = 0.06 + 0.88 * (turn + 0.5) / (2 * coils)
        side = (amplitude if turn % 2 else -amplitude) / length
        points.append((start[0] + part * dx - side * dy, start[1] + part * dy + side * dx))
    canvas.lines([*points, end], colour, 2.0)


def spring_damper(canvas: Canvas, view: Camera, front: float, back: float, half: float, rest: float) -> None:
    """Draw a spring above a damper; `half` (m) is half the tool's height, `rest` (m) the relaxed length."""
    end = max(back, front + SHORTEST)
    above, below = view.axis - 0.5 * half * view.scale, view.axis + 0.5 * half * view.scale
    spring(canvas, (view.x(front), above), (view.x(end), above), 0.35 * half * view.scale, look.COUPLING)
    mouth = min(front + 0.5 * rest, end)
    piston = min(max(end - 0.6 * rest, front + 0.001), mouth)
    reach = 0.25 * half * view.scale
    opening, bottom = view.x(mouth), view.x(front)
    cylinder = [(opening, below - reach), (bottom, below - reach), (bottom, below + reach), (opening, below + reach)]
    canvas.lines(cylinder, look.FAINT, 1.5)
    canvas.lines([(view.x(piston), below), (view.x(end), below)], look.FAINT, 2.0)
    canvas.lines([(view.x(piston), below - 0.8 * reach), (view.x(piston), below + 0.8 * reach)], look.FAINT, 2.5)


def bistable(canvas: Canvas, view: Camera, front: float, back: float, mechanism: Bistable) -> None:
    """Draw the slider between its stops, the spring and its pivot on the flange's arm, to scale in both directions."""
    alignment = front + CLEARANCE - mechanism.rear_stop
    rod = mechanism.front_stop - mechanism.rear_stop + 2.0 * CLEARANCE  # so long that the tool clears the front stop
    slider = (view.x(back - rod), view.axis)
    pivot = (view.x(alignment), view.axis - mechanism.height * view.scale)
    thick = CLEARANCE * view.scale
    stop = view.x(alignment + mechanism.front_stop + CLEARANCE)
    sill = view.axis + 2.0 * thick
    arm = view.x(front - 0.5 * CLEARANCE)
    canvas.lines([(arm, view.axis), (arm, pivot[1]), pivot], look.FLANGE, 4.0)
    canvas.rectangle((view.x(front), sill, stop + thick - view.x(front), 0.5 * thick), look.FLANGE)
    canvas.rectangle((stop, view.axis - 1.5 * thick, thick, thick), look.FLANGE)
    canvas.rectangle((stop, view.axis + 0.5 * thick, thick, 2.0 * thick), look.FLANGE)
    canvas.dashes((pivot[0], pivot[1]), (pivot[0], sill), look.FAINT)
    canvas.rectangle((slider[0], view.axis - 0.3 * thick, view.x(back) - slider[0], 0.6 * thick), look.TOOL)
    canvas.rectangle((slider[0] - thick, view.axis - thick, 2.0 * thick, 2.0 * thick), look.TOOL)
    spring(canvas, pivot, slider, 0.6 * thick, look.COUPLING, 7)
    for joint in (pivot, slider):
        canvas.circle(joint, 4.0, look.FLANGE)
        canvas.circle(joint, 2.0, look.PAPER)
