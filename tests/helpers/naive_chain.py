"""A second reading of the equations, as plain as can be: absolute coordinates, SI units, clamps by `max`.

Nothing is cut but contacts, the alarm and the corners of the commanded velocity; LSODA and short steps do the rest.
"""

from math import hypot, inf, sqrt
from types import SimpleNamespace

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq


def naive(scene, motion, duration, closures, longest_step=1e-4):
    """Of a chain on a robot: velocities and positions at `duration`, the alarm, and the slider's alignments."""
    tool, body, law, coupling, robot = scene.tool.mass, scene.object.mass, scene.contact, scene.coupling, scene.robot
    m, n = getattr(law, "stiffness_exponent", 1.5), getattr(law, "damping_exponent", 1.5)
    d = closures[getattr(law, "dissipation", "hu-guo")](law.restitution)
    brake, a, v = motion.brake, motion.acceleration, motion.speed
    is_bistable, is_rigid = hasattr(coupling, "height"), not hasattr(coupling, "stiffness")
    alarm, chi, start = inf, 0.0, 0.0
    places = getattr(robot, "position", np.array([0.0, 1.0, 2.0, 3.0]))
    robot_table = CubicSpline(
        places, np.array([0 * places + x for x in (robot.mass, robot.stiffness, robot.damping)]).T
    )

    def spring_force(x):
        length = hypot(coupling.height, x)
        return coupling.stiffness * (coupling.free_length - length) * x / length

    if is_bistable:
        k_s, front, rear = coupling.stop_stiffness, coupling.front_stop, coupling.rear_stop
        c_s = 2 * coupling.stop_damping_ratio * sqrt(k_s * tool)
        start = brentq(lambda x: spring_force(x) - k_s * (x - front), front, coupling.free_length, xtol=1e-17)

    def command(t):
        x_r, v_r = (a * t**2 / 2, a * t) if t < v / a else (v * t - v**2 / (2 * a), v)
        braking = min(max(0.0, t - alarm - brake.delay), v / brake.deceleration)
        if braking:
            x_r = v * (alarm + brake.delay + braking) - v**2 / (2 * a) - brake.deceleration * braking**2 / 2
        return x_r, v_r - brake.deceleration * braking

    def contact_force(y):
        delta, delta_dot = y[2] - y[4], y[3] - y[5]
        return max(0.0, law.stiffness * delta**m + chi * delta**n * delta_dot) if delta > 0 else 0.0

    def coupling_force(x, x_dot):
        if not is_bistable:
            return -coupling.stiffness * x - 2 * coupling.damping_ratio * sqrt(coupling.stiffness * tool) * x_dot
        x += start
        from_front = max(0.0, k_s * (x - front) + c_s * x_dot) if x > front else 0.0
        from_rear = max(0.0, k_s * (rear - x) - c_s * x_dot) if x < rear else 0.0
        return spring_force(x) - from_front + from_rear

    def rates(t, y):
        x_f, v_f, x_t, v_t, _, v_p = y
        x_r, v_r = command(t)
        m_r, k_r, c_r = robot_table(np.clip(x_r, places[0], places[-1]))
        drive, contact = k_r * (x_r - x_f) + c_r * (v_r - v_f), contact_force(y)
        if is_rigid:
            flange = tool_acceleration = (drive - contact) / (m_r + tool)
        else:
            force = coupling_force(x_t - x_f, v_t - v_f)
            flange, tool_acceleration = (drive - force) / m_r, (force - contact) / tool
        return [v_f, flange, v_t, tool_acceleration, v_p, contact / body]

    def faces(_, y):
        return y[2] - y[4]

    def felt(_, y):
        return contact_force(y) - brake.threshold if alarm == inf else -1.0

    def aligned(_, y):
        return start + y[2] - y[0]

    faces.terminal = felt.terminal = True
    felt.direction = 1
    t, y, touching, crossings = 0.0, np.array([0.0, 0.0, 0.0, 0.0, scene.object.distance, 0.0]), False, []
    while t < duration:
        faces.direction = -1 if touching else 1
        corners = (v / a, alarm + brake.delay, alarm + brake.delay + v / brake.deceleration, duration)
        end = min(s for s in corners if s > t + 1e-14)
        events = [faces, felt, *([aligned] if is_bistable else [])]
        run = solve_ivp(rates, (t, end), y, "LSODA", events=events, rtol=1e-11, atol=1e-13, max_step=longest_step)
        t, y = run.t[-1], run.y[:, -1].copy()
        crossings += [when for found in run.t_events[2:] for when in found]
        if run.t_events[0].size:
            touching = not touching
            y[2] = np.nextafter(y[4], np.inf if touching else -np.inf)
            if touching:
                v_in = y[3] - y[5]
                tool_side = tool + (robot_table(np.clip(command(t)[0], places[0], places[-1]))[0] if is_rigid else 0.0)
                reduced = tool_side * body / (tool_side + body)
                delta0 = (reduced * v_in**2 / law.stiffness) ** (1 / (m + 1))
                chi = d * law.stiffness * delta0 ** (m - n) / v_in
                if alarm == inf and contact_force(y) > brake.threshold:
                    alarm = t
        elif run.status == 1:
            alarm = t
    return SimpleNamespace(object_velocity=y[5], tool_velocity=y[3], object_position=y[4],
                           detection_time=alarm, snap_through=tuple(crossings))  # fmt: skip
