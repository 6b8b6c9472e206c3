"""Whether the tool comes back to the object after an instantaneous impact: the largest share of its way, a number.

The object moves on at a constant velocity. The tool is flown in closed form on a spring; on a mechanism it is bounded,
or followed between ideal stops in steps, where the bound does not tell.
"""

import math

import numpy as np

from impact_gym.fidelity.encounter import Array, Encounter, Mass
from impact_gym.motion import Trapezoid
from impact_gym.scene import Bistable

WATCHED = 2.0  # s, after the impact
INSTANTS = 160
SLIDER_WATCHED, SLIDER_STEP = 0.8, 2e-3  # s

Pieces = list[tuple[float, float]]


def commands(motion: Trapezoid, met: Encounter, brake_time: float) -> Pieces:
    """Accelerations (m/s^2) of the imposed motion after the impact, and how long (s) each lasts."""
    ramp = max(motion.speed - met.flange_velocity, 0.0) / motion.acceleration
    rising = min(ramp, brake_time)
    pieces = [(motion.acceleration, rising)]
    if math.isfinite(brake_time):
        speed = met.flange_velocity + motion.acceleration * rising
        pieces += [(0.0, max(brake_time - ramp, 0.0)), (-motion.deceleration, speed / motion.deceleration)]
    return [*(piece for piece in pieces if piece[1] > 0.0), (0.0, math.inf)]


def way(pieces: Pieces, met: Encounter, tool_velocity: float, mass: Mass | None, time: Array) -> Array:
    """Way (m) of a tool on `mass`, or on the flange, after it left the impact with `tool_velocity` (m/s)."""
    tool = np.full_like(time, -met.deflection if mass else 0.0)
    y, y_dot = met.deflection, tool_velocity - met.flange_velocity
    begun, position, velocity = 0.0, 0.0, met.flange_velocity
    for acceleration, lasts in pieces:
        inside = (time > begun) & (time <= begun + lasts)
        since = time[inside] - begun
        tool[inside] += position + velocity * since + 0.5 * acceleration * since**2
        if mass is not None:
            tool[inside] += mass.flown(y, y_dot, acceleration, since)[0]
        if math.isfinite(lasts):
            if mass is not None:
                y, y_dot = (float(value[0]) for value in mass.flown(y, y_dot, acceleration, np.array([lasts])))
            position += velocity * lasts + 0.5 * acceleration * lasts**2
            velocity += acceleration * lasts
            begun += lasts
    return tool


def pursuit(
    motion: Trapezoid,
    met: Encounter,
    brake_time: float,
    velocities: tuple[float, float],
    mass: Mass | None = None,
    push: float = math.inf,
) -> float:
    """Return the largest share of the object's way that the tool has gone at the same time: above 1 they meet again.

    Args:
        motion: imposed motion.
        met: the state at the impact.
        brake_time: when the brake begins after the impact, s; inf if it does not.
        velocities: of tool and object after the impact, m/s.
        mass: what holds the tool; None for the flange.
        push: largest acceleration (m/s^2) by a mechanism, whose front stop ends the tool's way: gives a bound.
    """
    time = WATCHED * np.linspace(0.0, 1.0, INSTANTS + 1)[1:] ** 3  # most of them soon after the impact
    tool = way(commands(motion, met, brake_time), met, velocities[0], mass, time)
    if math.isfinite(push):
        tool = np.minimum(tool, (velocities[0] + 0.5 * push * time) * time)
    return float(np.max(tool / (velocities[1] * time)))


def slider_pursuit(
    motion: Trapezoid,
    met: Encounter,
    brake_time: float,
    velocities: tuple[float, float],
    mechanism: Bistable,
    tool_mass: float,
) -> float:
    """Return what `pursuit` does for a tool on `mechanism`, whose stops let it neither through nor rebound.

    Semi-implicit Euler: a judgement, not a solution.
    """
    k, L0, H = mechanism.stiffness, mechanism.free_length, mechanism.height
    front, rear, h = mechanism.front_stop, mechanism.rear_stop, SLIDER_STEP
    pieces = iter(commands(motion, met, brake_time))
    acceleration, end = next(pieces)
    x, x_dot = front, velocities[0] - met.flange_velocity
    t, position, velocity, largest = 0.0, 0.0, met.flange_velocity, 0.0
    while t < SLIDER_WATCHED:
        t += h
        if t > end:
            acceleration, lasts = next(pieces)
            end += lasts
        position += (velocity + 0.5 * acceleration * h) * h
        velocity = max(velocity + acceleration * h, 0.0)
        L = math.hypot(H, x)
        x_dot += (k * (L0 - L) * x / (L * tool_mass) - acceleration) * h
        x += x_dot * h
        if x > front:
            x, x_dot = front, 0.0
        elif x < rear:
            x, x_dot = rear, 0.0
        largest = max(largest, (position + x - front) / (velocities[1] * t))
    return largest
