"""The chain to scale, seen by a camera that keeps tool and object in view: flange, coupling, tool, object.

Positions and displacements are to scale. The model has no sizes of bodies, so these are chosen here; the object is a
ball of 1500 kg/m^3, and a bistable mechanism has its own dimensions.
"""

import math
from typing import NamedTuple

from impact_gym.render.canvas import COUPLING, FAINT, FLANGE, FORCE, INK, OBJECT, PAPER, TOOL, WIDTH, Box, Canvas, Point
from impact_gym.render.canvas import PANEL as BACKGROUND
from impact_gym.render.film import History, State
from impact_gym.scene import Bistable, SpringDamper
from impact_gym.task import Task

PANEL: Box = (0.0, 64.0, float(WIDTH), 208.0)
CLOSE_UP: Box = (WIDTH - 174.0, 310.0, 160.0, 158.0)

TOOL_LENGTH, TOOL_HEIGHT = 0.024, 0.018  # m
FLANGE_LENGTH, FLANGE_HEIGHT = 0.016, 0.024  # m
BAR = 0.004  # m, thickness of a rigid coupling
CLEARANCE = 0.004  # m, half the length of a bistable slider, and the thickness of its stops
SHORTEST_SPRING = 0.002  # m, drawn where the tool has passed the flange
BASE_LENGTH, ROBOT_LENGTH = 0.008, 0.03  # m, of the block at the imposed motion and of the robot's spring
OBJECT_SHOWN = 0.06  # m, of the object behind its face
MARGIN = 0.006  # m
DENSITY, LARGEST_RADIUS = 1500.0, 0.5  # kg/m^3, m
NAME, SMALL = 17, 15  # pixels, sizes of text
LARGEST_SPAN = 3.0  # m; an object farther away is outside the picture


class Camera(NamedTuple):
    """Where a position lies in the picture."""

    left: float  # m, at the left edge
    scale: float  # pixels per m
    axis: float  # pixels from above, of the line along which all bodies move

    def x(self, position: float) -> float:
        """Return the column of `position` (m), pixels."""
        return (position - self.left) * self.scale

    def block(self, canvas: Canvas, back: float, front: float, height: float, colour: str) -> None:
        """Draw a block from `back` to `front` across the line, all in m."""
        tall = height * self.scale
        canvas.rectangle((self.x(back), self.axis - 0.5 * tall, self.x(front) - self.x(back), tall), colour)


def rest_length(task: Task) -> float:
    """Return how far behind the tool the flange is drawn at no deflection, m; a soft spring has room for braking."""
    coupling = task.coupling
    if isinstance(coupling, SpringDamper):
        return 0.04 + 1.25 * math.sqrt(task.tool_mass / coupling.stiffness)
    if isinstance(coupling, Bistable):
        return 2.0 * (coupling.front_stop - coupling.rear_stop) + 3.0 * CLEARANCE
    return 0.04


def object_radius(mass: float) -> float:
    """Return the radius (m) of the ball that is drawn for an object of this mass (kg)."""
    return min(math.cbrt(0.75 * mass / (math.pi * DENSITY)), LARGEST_RADIUS)


def camera(task: Task, state: State) -> Camera:
    """Return the camera for a state; it has no memory, so it moves and zooms as smoothly as the bodies move."""
    behind = TOOL_LENGTH + rest_length(task) + FLANGE_LENGTH
    back = min(state.flange_position - behind, state.tool_position - TOOL_LENGTH)
    if task.robot is not None:
        back = min(back, state.command_position - behind - ROBOT_LENGTH - BASE_LENGTH)
    left = back - MARGIN
    right = max(state.object_position + OBJECT_SHOWN, state.tool_position + MARGIN)  # a tool may sink into the object
    span = min(right - left, LARGEST_SPAN)
    scale, axis = PANEL[2] / span, PANEL[1] + 0.48 * PANEL[3]
    if isinstance(task.coupling, Bistable):
        axis = PANEL[1] + 0.64 * PANEL[3]
        largest = (0.64 * PANEL[3] - 10.0) / task.coupling.height  # at which the pivot is still inside
        if scale > largest:
            left -= 0.5 * (PANEL[2] / largest - span)
            scale = largest
    return Camera(left, scale, axis)


def draw(canvas: Canvas, history: History, state: State) -> None:
    """Draw the panel of the chain and the close-up of the faces."""
    task, view = history.task, camera(history.task, state)
    radius, tool_back = object_radius(history.info["scenario"]["object_mass"]), state.tool_position - TOOL_LENGTH
    front = state.flange_position - TOOL_LENGTH - rest_length(task)
    back, base = front - FLANGE_LENGTH, state.command_position - state.flange_position + front
    base -= FLANGE_LENGTH + ROBOT_LENGTH
    canvas.rectangle(PANEL, BACKGROUND)
    _ruler(canvas, view)
    with canvas.clipped(PANEL):
        canvas.circle((view.x(state.object_position + radius), view.axis), radius * view.scale, OBJECT)
        if task.robot is not None:
            view.block(canvas, base - BASE_LENGTH, base, FLANGE_HEIGHT, FAINT)
            ends = (view.x(base), view.axis), (view.x(back), view.axis)
            _spring(canvas, *ends, 0.1 * FLANGE_HEIGHT * view.scale, FAINT, 6)
        if isinstance(task.coupling, SpringDamper):
            _spring_damper(canvas, view, front, tool_back, rest_length(task))
        elif isinstance(task.coupling, Bistable):
            _bistable(canvas, view, front, tool_back, task.coupling)
        else:
            view.block(canvas, front, tool_back, BAR, FLANGE)
        view.block(canvas, back, front, FLANGE_HEIGHT, FLANGE)
        view.block(canvas, tool_back, state.tool_position, TOOL_HEIGHT, TOOL)
        if state.contact_force > 0.0:
            _force(canvas, view, state, radius)
    below_flange, below_tool = (view.axis + 0.5 * height * view.scale + 10.0 for height in (FLANGE_HEIGHT, TOOL_HEIGHT))
    canvas.text("flange", (view.x(0.5 * (back + front)), below_flange), NAME, FLANGE, "center")
    canvas.text("tool", (view.x(0.5 * (tool_back + state.tool_position)), below_tool), NAME, TOOL, "center")
    if task.robot is not None:
        canvas.text("robot", (view.x(base + 0.5 * ROBOT_LENGTH), below_tool), NAME, FAINT, "center")
    middle = min(view.x(state.object_position + radius), WIDTH - 40.0)
    canvas.text("object", (middle, view.axis + 28.0), NAME, PAPER, "center")
    _close_up(canvas, history, state, radius)


def _ruler(canvas: Canvas, view: Camera) -> None:
    """Draw the ground with a mark every round distance, and a bar of that length with its figure."""
    ground = PANEL[1] + PANEL[3] + 6.0
    length = round_length(110.0 / view.scale)
    canvas.lines([(0.0, ground), (WIDTH, ground)], FAINT, 1.0)
    for mark in range(math.ceil(view.left / length), math.floor((view.left + WIDTH / view.scale) / length) + 1):
        x = view.x(mark * length)
        canvas.lines([(x, ground - 4.0), (x, ground + 4.0)], FAINT, 1.0)
        if 210.0 < x < WIDTH - 30.0:
            canvas.text(f"{1e3 * mark * length:.4g} mm", (x, ground + 13.0), SMALL, FAINT, "center")
    canvas.rectangle((14.0, ground + 11.0, length * view.scale, 4.0), INK)
    canvas.text(f"{1e3 * length:.4g} mm", (20.0 + length * view.scale, ground + 13.0), SMALL)


def _force(canvas: Canvas, view: Camera, state: State, radius: float) -> None:
    """Draw the flattened part of the ball, and an arrow for the force on it, its length logarithmic."""
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


def _spring_damper(canvas: Canvas, view: Camera, front: float, back: float, rest: float) -> None:
    """Draw a spring above a damper from the flange's `front` to the tool's `back`; `rest` is the relaxed length, m."""
    half, end = 0.5 * TOOL_HEIGHT * view.scale, max(back, front + SHORTEST_SPRING)
    above, below, reach = view.axis - 0.5 * half, view.axis + 0.5 * half, 0.25 * half
    _spring(canvas, (view.x(front), above), (view.x(end), above), 0.35 * half, COUPLING, 9)
    mouth = min(front + 0.5 * rest, end)
    piston = view.x(min(max(end - 0.6 * rest, front + 0.001), mouth))
    opening, bottom = view.x(mouth), view.x(front)
    cylinder = [(opening, below - reach), (bottom, below - reach), (bottom, below + reach), (opening, below + reach)]
    canvas.lines(cylinder, FAINT, 1.5)
    canvas.lines([(piston, below), (view.x(end), below)], FAINT, 2.0)
    canvas.lines([(piston, below - 0.8 * reach), (piston, below + 0.8 * reach)], FAINT, 2.5)


def _bistable(canvas: Canvas, view: Camera, front: float, back: float, mechanism: Bistable) -> None:
    """Draw the slider between its stops, the spring and its pivot on the flange's arm, to scale in both directions."""
    alignment = front + CLEARANCE - mechanism.rear_stop
    rod = mechanism.front_stop - mechanism.rear_stop + 2.0 * CLEARANCE  # so long that the tool clears the front stop
    slider = (view.x(back - rod), view.axis)
    pivot = (view.x(alignment), view.axis - mechanism.height * view.scale)
    thick = CLEARANCE * view.scale
    stop = view.x(alignment + mechanism.front_stop + CLEARANCE)
    sill = view.axis + 2.0 * thick
    arm = view.x(front - 0.5 * CLEARANCE)
    canvas.lines([(arm, view.axis), (arm, pivot[1]), pivot], FLANGE, 4.0)
    canvas.rectangle((view.x(front), sill, stop + thick - view.x(front), 0.5 * thick), FLANGE)
    canvas.rectangle((stop, view.axis - 1.5 * thick, thick, thick), FLANGE)
    canvas.rectangle((stop, view.axis + 0.5 * thick, thick, 2.0 * thick), FLANGE)
    canvas.dashes((pivot[0], pivot[1]), (pivot[0], sill), FAINT)
    canvas.rectangle((slider[0], view.axis - 0.3 * thick, view.x(back) - slider[0], 0.6 * thick), TOOL)
    canvas.rectangle((slider[0] - thick, view.axis - thick, 2.0 * thick, 2.0 * thick), TOOL)
    _spring(canvas, pivot, slider, 0.6 * thick, COUPLING, 7)
    for joint in (pivot, slider):
        canvas.circle(joint, 4.0, FLANGE)
        canvas.circle(joint, 2.0, PAPER)


def _close_up(canvas: Canvas, history: History, state: State, radius: float) -> None:
    """Draw the faces enlarged, such that the hardest impact that can be commanded still fits."""
    left, top, width, height = CLOSE_UP
    scale = 0.4 * width / min(max(history.impact_depth(history.task.velocity_range[1]), 1e-9), 1.0)
    face, middle, radius = left + 0.4 * width, top + 0.5 * height, radius * scale
    with canvas.clipped(CLOSE_UP):
        canvas.rectangle(CLOSE_UP, BACKGROUND)
        rows = [0.5 * height * step / 12.0 for step in range(-12, 13)]
        rim = [(face + radius - math.sqrt(max(radius * radius - y * y, 0.0)), middle + y) for y in rows]
        rear = face + radius if radius < 0.5 * height else left + width
        canvas.polygon([*rim, (rear, rim[-1][1]), (rear, rim[0][1])], OBJECT)
        tool = face + state.penetration * scale
        if tool > left:
            canvas.rectangle((left, top, tool - left, height), TOOL)
        if state.penetration > 0.0:
            canvas.dashes((face, top), (face, top + height), PAPER)
            pressed = f"pressed {1e3 * state.penetration:.2f} mm"
            canvas.text(pressed, (left + width - 6.0, top + 10.0), SMALL, PAPER, "midright")
    right, bottom = left + width, top + height
    canvas.lines([(left, top), (right, top), (right, bottom), (left, bottom), (left, top)], FAINT, 1.0)
    length = round_length(0.3 * width / scale)
    below = bottom + 12.0
    canvas.rectangle((left, below - 2.0, length * scale, 4.0), INK)
    canvas.text(f"{1e3 * length:.3g} mm", (left + 6.0 + length * scale, below), SMALL)
    canvas.text("faces, enlarged", (right, below), SMALL, FAINT, "midright")


def round_length(longest: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten, m, that is not above `longest`."""
    decade = 10.0 ** math.floor(math.log10(longest))
    return max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= longest * (1.0 + 1e-9))
