"""Draw robot, coupling, tool, gap and object, as a fixed camera sees them.

Positions and displacements are to scale. Simulated bodies have no size, so sizes are chosen here. The object is a ball
of density DENSITY, but never larger than LARGEST_RADIUS. A bistable mechanism is drawn with its simulated dimensions.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from impact_gym.render.canvas import HEIGHT, WIDTH, Canvas, Point
from impact_gym.render.film import History, State
from impact_gym.render.palette import FAINT, FLANGE, FORCE, GRID, INK, OBJECT, PAPER, TOOL
from impact_gym.render.palette import PANEL as BACKGROUND
from impact_gym.task import Task

TOOL_LENGTH, TOOL_HEIGHT = 0.034, 0.03  # m
FLANGE_LENGTH, FLANGE_HEIGHT = 0.016, 0.052  # m
BAR = 0.006  # m, thickness of a rigid coupling
CLEARANCE = 0.004  # m, half the length of a bistable slider, and the thickness of its front stop
SHORTEST_SPRING = 0.002  # m, the coupling's spring is drawn at least this long, even if the tool has passed the flange
BASE_LENGTH, ROBOT_LENGTH = 0.008, 0.03  # m, lengths of the block with the imposed motion, and of the robot's spring
ROOM = 0.2  # m, space shown behind the object
MARGIN = 0.02  # m, least space shown to the left of the chain at the start
DENSITY, LARGEST_RADIUS = 1500.0, 0.5  # kg/m^3 and m, of the ball that is drawn for the object
TOP, BOTTOM = 190.0, 416.0  # pixels, upper and lower edge of the area with the chain
TEXT, SMALL = 30, 24  # pixels, sizes of text; legible in a picture of half the size
LARGEST_SPAN = 3.0  # m, largest part of the line of motion that a picture shows
RULER, DISTANCE = 34.0, 56.0  # pixels, heights kept for the ruler below the ground and for the text above the bodies
SHOWN_PUSH = 5e-4  # m; if the object has moved less than this, its displacement is shown only during a contact


class Camera(NamedTuple):
    """Maps positions in m to pixels of the picture."""

    left: float  # m, position at the left edge
    scale: float  # pixels per m
    axis: float  # pixels from the upper edge to the line along which all bodies move
    ground: float  # pixels from the upper edge to the ground

    def x(self, position: float) -> float:
        """Return the horizontal coordinate, in pixels, of `position` (m)."""
        return (position - self.left) * self.scale

    def block(self, canvas: Canvas, back: float, front: float, height: float, colour: str) -> None:
        """Draw a block from `back` to `front`, centred on the line of motion; lengths in m."""
        tall = height * self.scale
        canvas.rectangle((self.x(back), self.axis - 0.5 * tall, self.x(front) - self.x(back), tall), colour)


def object_radius(mass: float) -> float:
    """Return the radius (m) of the ball drawn for an object of this mass (kg)."""
    return min(math.cbrt(0.75 * mass / (math.pi * DENSITY)), LARGEST_RADIUS)


def camera(history: History) -> Camera:
    """Return the camera of an episode: it shows the approach and ROOM behind the object, but at most LARGEST_SPAN."""
    task, scenario = history.task, history.info["scenario"]
    behind = TOOL_LENGTH + task.coupling.drawn_length(task.tool_mass) + FLANGE_LENGTH + MARGIN
    behind += 0.0 if task.robot is None else ROBOT_LENGTH + BASE_LENGTH
    radius = object_radius(scenario["object_mass"])
    span = min(behind + scenario["distance"] + 2.0 * radius + ROOM, LARGEST_SPAN)
    half = max(min(radius, 0.1), 0.5 * FLANGE_HEIGHT)
    scale = min(WIDTH / span, (BOTTOM - TOP - RULER - DISTANCE) / (2.0 * half))
    return Camera(-behind - 0.5 * (WIDTH / scale - span), scale, BOTTOM - RULER - half * scale, BOTTOM - RULER)


def draw(canvas: Canvas, history: History, state: State) -> None:
    """Draw the chain, the ground with a ruler, and the gap or the distance that the object was pushed."""
    task, home, view = history.task, history.info["scenario"]["distance"], camera(history)
    radius, tool_back = object_radius(history.info["scenario"]["object_mass"]), state.tool_position - TOOL_LENGTH
    front = state.flange_position - TOOL_LENGTH - task.coupling.drawn_length(task.tool_mass)
    back, base = front - FLANGE_LENGTH, state.command_position - state.flange_position + front
    base -= FLANGE_LENGTH + ROBOT_LENGTH
    canvas.rectangle((0.0, TOP, WIDTH, BOTTOM - TOP), BACKGROUND)
    if state.object_position - home > SHOWN_PUSH:
        canvas.circle((view.x(home + radius), view.axis), radius * view.scale, PAPER)
    canvas.circle((view.x(state.object_position + radius), view.axis), radius * view.scale, OBJECT)
    if task.robot is None:
        view.block(canvas, view.left, back, 0.4 * FLANGE_HEIGHT, GRID)
    else:
        view.block(canvas, view.left, base - BASE_LENGTH, 0.4 * FLANGE_HEIGHT, GRID)
        view.block(canvas, base - BASE_LENGTH, base, FLANGE_HEIGHT, FAINT)
        ends = (view.x(base), view.axis), (view.x(back), view.axis)
        _spring(canvas, *ends, 0.1 * FLANGE_HEIGHT * view.scale, FAINT, 6)
    if task.coupling.drawing not in DRAWINGS:
        kind = type(task.coupling).__name__
        raise ValueError(
            f"there is no picture of the coupling {kind}: add its `drawing` to DRAWINGS in render/chain.py"
        )
    DRAWINGS[task.coupling.drawing](canvas, view, front, tool_back, task)
    view.block(canvas, back, front, FLANGE_HEIGHT, FLANGE)
    view.block(canvas, tool_back, state.tool_position, TOOL_HEIGHT, TOOL)
    if state.contact_force > 0.0:
        _force(canvas, view, state, radius)
    canvas.rectangle((0.0, 0.0, WIDTH, TOP), PAPER)  # hides what was drawn above the area
    canvas.rectangle((0.0, BOTTOM, WIDTH, HEIGHT - BOTTOM), PAPER)
    _ruler(canvas, view)
    _distance(canvas, view, state, home)


def length(metres: float) -> str:
    """Return a length as a text with its unit."""
    return f"{1e3 * metres:.1f} mm" if abs(metres) < 0.01 else f"{1e2 * metres:.1f} cm"


def _distance(canvas: Canvas, view: Camera, state: State, home: float) -> None:
    """Draw the gap, or the distance that the object was pushed, as a line with its length."""
    pushed = state.object_position - home
    begin, end, words = state.tool_position, state.object_position, "gap"
    if pushed > SHOWN_PUSH or state.penetration >= 0.0:
        begin, end, words = home, state.object_position, "pushed"
    y = 2.0 * view.axis - view.ground - 14.0
    ends = [min(max(view.x(place), 2.0), WIDTH - 2.0) for place in (begin, end)]
    canvas.lines([(ends[0], y), (ends[1], y)], INK, 2.0)
    for x in ends:
        canvas.lines([(x, y - 7.0), (x, y + 7.0)], INK, 2.0)
    middle = min(max(0.5 * sum(ends), 90.0), WIDTH - 110.0)
    canvas.text(f"{words} {length(end - begin)}", (middle, y - 20.0), TEXT, INK, "center")


def _ruler(canvas: Canvas, view: Camera) -> None:
    longest = 150.0 / view.scale
    decade = 10.0 ** math.floor(math.log10(longest))
    step = max(size * decade for size in (1.0, 2.0, 5.0) if size * decade <= longest * (1.0 + 1e-9))
    canvas.lines([(0.0, view.ground), (WIDTH, view.ground)], FAINT, 1.5)
    for mark in range(math.ceil(view.left / step), math.floor((view.left + WIDTH / view.scale) / step) + 1):
        x = view.x(mark * step)
        canvas.lines([(x, view.ground), (x, view.ground + 7.0)], FAINT, 1.5)
        if 40.0 < x < WIDTH - 40.0:
            words = f"{1e2 * mark * step:.4g}" + ("" if mark else " cm")
            canvas.text(words, (x, view.ground + 20.0), SMALL, FAINT, "center")


def _force(canvas: Canvas, view: Camera, state: State, radius: float) -> None:
    """Draw the flattened part of the ball, and the force on the ball as an arrow of logarithmic length."""
    face, depth = view.x(state.tool_position), max(state.penetration, 0.0)
    chord = math.sqrt(max(depth * (2.0 * radius - depth), 0.0))
    half = max(min(chord, 0.5 * TOOL_HEIGHT) * view.scale, 2.0)
    canvas.rectangle((face - 1.0, view.axis - half, 3.0, 2.0 * half), FORCE)
    tip = face + 14.0 + 34.0 * math.log10(1.0 + 10.0 * state.contact_force)
    canvas.lines([(face, view.axis), (tip - 8.0, view.axis)], PAPER, 4.0)
    canvas.polygon([(tip - 10.0, view.axis - 7.0), (tip, view.axis), (tip - 10.0, view.axis + 7.0)], PAPER)


def _spring(canvas: Canvas, start: Point, end: Point, amplitude: float, colour: str, coils: int) -> None:
    """Draw a coil spring from `start` to `end`; `amplitude` in pixels."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = max(math.hypot(dx, dy), 1e-9)
    points = [start]
    for turn in range(2 * coils):
        part = 0.06 + 0.88 * (turn + 0.5) / (2 * coils)
        side = (amplitude if turn % 2 else -amplitude) / length
        points.append((start[0] + part * dx - side * dy, start[1] + part * dy + side * dx))
    canvas.lines([*points, end], colour, 2.0)


def _rigid(canvas: Canvas, view: Camera, front: float, back: float, _: Task) -> None:
    """Draw a bar from the flange's `front` to the tool's `back`."""
    view.block(canvas, front, back, BAR, FLANGE)


def _spring_damper(canvas: Canvas, view: Camera, front: float, back: float, task: Task) -> None:
    """Draw a spring and a damper from the flange's `front` to the tool's `back`."""
    rest = task.coupling.drawn_length(task.tool_mass)
    half, end = 0.5 * TOOL_HEIGHT * view.scale, max(back, front + SHORTEST_SPRING)
    above, below, reach = view.axis - 0.5 * half, view.axis + 0.5 * half, 0.25 * half
    _spring(canvas, (view.x(front), above), (view.x(end), above), 0.35 * half, INK, 9)
    mouth = min(front + 0.5 * rest, end)
    piston = view.x(min(max(end - 0.6 * rest, front + 0.001), mouth))
    opening, bottom = view.x(mouth), view.x(front)
    cylinder = [(opening, below - reach), (bottom, below - reach), (bottom, below + reach), (opening, below + reach)]
    canvas.lines(cylinder, FAINT, 1.5)
    canvas.lines([(piston, below), (view.x(end), below)], FAINT, 2.0)
    canvas.lines([(piston, below - 0.8 * reach), (piston, below + 0.8 * reach)], FAINT, 2.5)


def _bistable(canvas: Canvas, view: Camera, front: float, back: float, task: Task) -> None:
    """Draw to scale the slider, its front stop, and the spring from the slider to a pivot on the flange."""
    mechanism = task.coupling
    alignment = front + CLEARANCE - mechanism.rear_stop
    rod = mechanism.front_stop - mechanism.rear_stop + 2.0 * CLEARANCE  # so long that the tool stays off the front stop
    slider = (view.x(back - rod), view.axis)
    pivot = (view.x(alignment), view.axis - mechanism.height * view.scale)
    thick = CLEARANCE * view.scale
    stop = view.x(alignment + mechanism.front_stop + CLEARANCE)
    canvas.lines([(view.x(front), view.axis), (view.x(front), pivot[1]), pivot], FLANGE, 4.0)
    canvas.lines([(view.x(front), view.axis + 1.5 * thick), (stop + thick, view.axis + 1.5 * thick)], FLANGE, 2.0)
    canvas.rectangle((stop, view.axis - 1.5 * thick, thick, 3.0 * thick), FLANGE)
    canvas.rectangle((slider[0], view.axis - 0.3 * thick, view.x(back) - slider[0], 0.6 * thick), TOOL)
    canvas.rectangle((slider[0] - thick, view.axis - thick, 2.0 * thick, 2.0 * thick), TOOL)
    _spring(canvas, pivot, slider, 0.6 * thick, INK, 7)


DRAWINGS: Mapping[str, Callable[[Canvas, Camera, float, float, Task], None]] = {
    "rigid": _rigid, "spring": _spring_damper, "bistable": _bistable,
}  # fmt: skip
"""Functions that draw a coupling from the flange's front to the tool's back (m), by `Coupling.drawing`."""
