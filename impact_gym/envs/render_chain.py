"""The chain to scale, seen by a camera that keeps tool and object in view: flange, coupling, tool, object.

Positions and what changes them are to scale; the bodies' own sizes are chosen by us, since the model has none, but the
object is a ball of 1500 kg/m^3 and a bistable mechanism has its own measures.
"""

import math
from typing import NamedTuple

from impact_gym.envs import render_canvas as look
from impact_gym.envs.render_canvas import Box, Canvas
from impact_gym.envs.render_coupling import CLEARANCE, Camera, bistable, spring, spring_damper
from impact_gym.envs.render_history import History, State
from impact_gym.scene import Bistable, SpringDamper
from impact_gym.task import Task

PANEL: Box = (0.0, 64.0, float(look.WIDTH), 208.0)
CLOSE_UP: Box = (look.WIDTH - 174.0, 310.0, 160.0, 158.0)

TOOL_LENGTH, TOOL_HEIGHT = 0.024, 0.018  # m
FLANGE_LENGTH, FLANGE_HEIGHT = 0.016, 0.024  # m
BAR = 0.004  # m, thickness of a rigid coupling
BASE_LENGTH, ROBOT_LENGTH = 0.008, 0.03  # m, of the imposed motion's mark and of the robot's spring
OBJECT_SHOWN = 0.06  # m, of the object behind its face
MARGIN = 0.006  # m
DENSITY, LARGEST_RADIUS = 1500.0, 0.5  # kg/m^3, m
NAME, SMALL = 17, 15  # pixels, sizes of text
LARGEST_SPAN = 3.0  # m; an object further off leaves the picture


class Places(NamedTuple):
    """Where the bodies are, m."""

    base: float  # front of the mark of the imposed motion
    flange_back: float
    flange_front: float
    tool_back: float
    tool_front: float
    object_front: float


def rest_length(task: Task) -> float:
    """Return how far behind the tool the flange is drawn when nothing is deflected, m.

    A soft spring is drawn longer, so that braking from full speed has room.
    """
    coupling = task.coupling
    if isinstance(coupling, SpringDamper):
        return 0.04 + 1.25 * math.sqrt(task.tool_mass / coupling.stiffness)
    if isinstance(coupling, Bistable):
        return 2.0 * (coupling.front_stop - coupling.rear_stop) + 3.0 * CLEARANCE
    return 0.04


def places(task: Task, state: State) -> Places:
    """Return where the bodies are drawn."""
    behind = TOOL_LENGTH + rest_length(task)
    front = state.flange_position - behind
    return Places(
        state.command_position - behind - FLANGE_LENGTH - ROBOT_LENGTH,
        front - FLANGE_LENGTH,
        front,
        state.tool_position - TOOL_LENGTH,
        state.tool_position,
        state.object_position,
    )


def camera(task: Task, state: State) -> Camera:
    """Return the camera for a state; it moves and zooms as smoothly as the bodies move, for it has no memory."""
    at = places(task, state)
    back = at.flange_back if task.robot is None else min(at.flange_back, at.base - BASE_LENGTH)
    left = min(back, at.tool_back) - MARGIN
    right = max(at.object_front + OBJECT_SHOWN, at.tool_front + MARGIN)  # a tool may sink into a very soft object
    span = min(right - left, LARGEST_SPAN)
    scale, axis = PANEL[2] / span, PANEL[1] + 0.48 * PANEL[3]
    if isinstance(task.coupling, Bistable):
        axis = PANEL[1] + 0.64 * PANEL[3]
        closest = (0.64 * PANEL[3] - 10.0) / task.coupling.height  # the pivot must fit in
        if scale > closest:
            left -= 0.5 * (PANEL[2] / closest - span)
            scale = closest
    return Camera(left, scale, axis)


def draw(canvas: Canvas, history: History, state: State) -> None:
    """Draw the panel of the chain."""
    task = history.task
    view, at = camera(task, state), places(task, state)
    canvas.rectangle(PANEL, look.PANEL)
    _ruler(canvas, view)
    with canvas.clipped(PANEL):
        radius = object_radius(history)
        canvas.circle((view.x(at.object_front + radius), view.axis), radius * view.scale, look.OBJECT)
        if task.robot is not None:
            view.block(canvas, at.base - BASE_LENGTH, at.base, FLANGE_HEIGHT, look.FAINT)
            ends = (view.x(at.base), view.axis), (view.x(at.flange_back), view.axis)
            spring(canvas, *ends, 0.1 * FLANGE_HEIGHT * view.scale, look.FAINT, 6)
        if isinstance(task.coupling, SpringDamper):
            spring_damper(canvas, view, at.flange_front, at.tool_back, 0.5 * TOOL_HEIGHT, rest_length(task))
        elif isinstance(task.coupling, Bistable):
            bistable(canvas, view, at.flange_front, at.tool_back, task.coupling)
        else:
            view.block(canvas, at.flange_front, at.tool_back, BAR, look.FLANGE)
        view.block(canvas, at.flange_back, at.flange_front, FLANGE_HEIGHT, look.FLANGE)
        view.block(canvas, at.tool_back, at.tool_front, TOOL_HEIGHT, look.TOOL)
        _press(canvas, view, history, state)
    _names(canvas, task, view, at, history)
    _close_up(canvas, history, state)


def object_radius(history: History) -> float:
    """Return the radius of the ball that is drawn, m."""
    mass: float = history.info["scenario"]["object_mass"]
    return min(math.cbrt(0.75 * mass / (math.pi * DENSITY)), LARGEST_RADIUS)


def _press(canvas: Canvas, view: Camera, history: History, state: State) -> None:
    """Draw where the ball is flattened, and an arrow for the force on it, its length logarithmic."""
    if state.contact_force <= 0.0:
        return
    face = view.x(state.tool_position)
    depth = max(state.penetration, 0.0)
    chord = math.sqrt(max(depth * (2.0 * object_radius(history) - depth), 0.0))
    half = max(min(chord, 0.5 * TOOL_HEIGHT) * view.scale, 2.0)
    canvas.rectangle((face - 1.0, view.axis - half, 3.0, 2.0 * half), look.FORCE)
    tip = face + 14.0 + 34.0 * math.log10(1.0 + 10.0 * state.contact_force)
    canvas.lines([(face, view.axis), (tip - 8.0, view.axis)], look.PAPER, 4.0)
    canvas.polygon([(tip - 10.0, view.axis - 7.0), (tip, view.axis), (tip - 10.0, view.axis + 7.0)], look.PAPER)


def _names(canvas: Canvas, task: Task, view: Camera, at: Places, history: History) -> None:
    flange, tool = (view.axis + 0.5 * height * view.scale + 10.0 for height in (FLANGE_HEIGHT, TOOL_HEIGHT))
    canvas.text("flange", (view.x(0.5 * (at.flange_back + at.flange_front)), flange), NAME, look.FLANGE, "center")
    canvas.text("tool", (view.x(0.5 * (at.tool_back + at.tool_front)), tool), NAME, look.TOOL, "center")
    if task.robot is not None:
        canvas.text("robot", (view.x(at.base + 0.5 * ROBOT_LENGTH), tool), NAME, look.FAINT, "center")
    middle = min(view.x(at.object_front + object_radius(history)), look.WIDTH - 40.0)
    canvas.text("object", (middle, view.axis + 28.0), NAME, look.PAPER, "center")


def _ruler(canvas: Canvas, view: Camera) -> None:
    """Draw the ground with a mark every round distance, and a bar that says how long one is."""
    ground = PANEL[1] + PANEL[3] + 6.0
    length = round_length(110.0 / view.scale)
    canvas.lines([(0.0, ground), (look.WIDTH, ground)], look.FAINT, 1.0)
    for mark in range(math.ceil(view.left / length), math.floor((view.left + look.WIDTH / view.scale) / length) + 1):
        x = view.x(mark * length)
        canvas.lines([(x, ground - 4.0), (x, ground + 4.0)], look.FAINT, 1.0)
        if 210.0 < x < look.WIDTH - 30.0:
            canvas.text(f"{1e3 * mark * length:.4g} mm", (x, ground + 13.0), SMALL, look.FAINT, "center")
    canvas.rectangle((14.0, ground + 11.0, length * view.scale, 4.0), look.INK)
    canvas.text(f"{1e3 * length:.4g} mm", (20.0 + length * view.scale, ground + 13.0), SMALL)


def _close_up(canvas: Canvas, history: History, state: State) -> None:
    """Draw the faces enlarged, as far as the hardest impact that can be commanded would press them."""
    left, top, width, height = CLOSE_UP
    scale = 0.4 * width / min(max(history.impact_depth(history.task.velocity_range[1]), 1e-9), 1.0)
    face, middle = left + 0.4 * width, top + 0.5 * height
    radius = object_radius(history) * scale
    with canvas.clipped(CLOSE_UP):
        canvas.rectangle(CLOSE_UP, look.PANEL)
        rows = [0.5 * height * step / 12.0 for step in range(-12, 13)]
        rim = [(face + radius - math.sqrt(max(radius * radius - y * y, 0.0)), middle + y) for y in rows]
        rear = face + radius if radius < 0.5 * height else left + width
        canvas.polygon([*rim, (rear, rim[-1][1]), (rear, rim[0][1])], look.OBJECT)
        tool = face + state.penetration * scale
        if tool > left:
            canvas.rectangle((left, top, tool - left, height), look.TOOL)
        if state.penetration > 0.0:
            canvas.dashes((face, top), (face, top + height), look.PAPER)
    canvas.frame(CLOSE_UP, look.FAINT)
    length = round_length(0.3 * width / scale)
    below = top + height + 12.0
    canvas.rectangle((left, below - 2.0, length * scale, 4.0), look.INK)
    canvas.text(f"{1e3 * length:.3g} mm", (left + 6.0 + length * scale, below), SMALL)
    canvas.text("faces, enlarged", (left + width, below), SMALL, look.FAINT, "midright")
    if state.penetration > 0.0:
        pressed = f"pressed {1e3 * state.penetration:.2f} mm"
        canvas.text(pressed, (left + width - 6.0, top + 10.0), SMALL, look.PAPER, "midright")


def round_length(longest: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten, m, that is not above `longest`."""
    decade = 10.0 ** math.floor(math.log10(longest))
    return max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= longest * (1.0 + 1e-9))
