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
    """Velocities and positions at `duration`, when the alarm came and when the slider passed its alignment."""
    tool, body, law, coupling, robot = scene.tool.mass, scene.object.mass, scene.contact, scene.coupling, scene.robot
    m, n = getattr(law, "stiffness_exponent", 1.5), getattr(law, "damping_exponent", 1.5)
    d = closures[getattr(law, "dissipation", "hu-guo")](law.restitution)
    brake, a, v = motion.brake, motion.acceleration, motion.speed
    is_bistable, is_rigid = hasattr(coupling, "height"), not hasattr(coupling, "stiffness")
    alarm, chi = inf, 0.0

    if hasattr(robot, "position"):
        table = CubicSpline(robot.position, np.c_[robot.mass, robot.stiffness, robot.damping])
    if is_bistable:
        c_s = 2 * coupling.stop_damping_ratio * sqrt(coupling.stop_stiffness * tool)

        def spring_force(x):
            length = hypot(coupling.height, x)
            return coupling.stiffness * (coupling.free_length - length) * x / length

        start = brentq(
            lambda x: spring_force(x) - coupling.stop_stiffness * (x - coupling.front_stop),
            coupling.front_stop,
            coupling.free_length,
            xtol=1e-17,
        )

    def command(t):
        x_r, v_r = (a * t**2 / 2, a * t) if t < v / a else (v * t - v**2 / (2 * a), v)
        braking = min(max(0.0, t - alarm - brake.delay), v / brake.deceleration)
        if braking:
            x_r = v * (alarm + brake.delay + braking) - v**2 / (2 * a) - brake.deceleration * braking**2 / 2
        return x_r, v_r - brake.deceleration * braking

    def robot_at(x_r):
        if hasattr(robot, "position"):
            return table(np.clip(x_r, robot.position[0], robot.position[-1]))
        return robot.mass, robot.stiffness, robot.damping

    def contact_force(y):
        delta, delta_dot = y[2] - y[4], y[3] - y[5]
        return max(0.0, law.stiffness * delta**m + chi * delta**n * delta_dot) if delta > 0 else 0.0

    def coupling_force(x, x_dot):
        if not is_bistable:
            return -coupling.stiffness * x - 2 * coupling.damping_ratio * sqrt(coupling.stiffness * tool) * x_dot
        x += start
        force = spring_force(x)
        if x > coupling.front_stop:
            force -= max(0.0, coupling.stop_stiffness * (x - coupling.front_stop) + c_s * x_dot)
        if x < coupling.rear_stop:
            force += max(0.0, coupling.stop_stiffness * (coupling.rear_stop - x) - c_s * x_dot)
        return force

    def rates(t, y):
        x_r, v_r = command(t)
        x_f, v_f, x_t, v_t, _, v_p = y if robot is not None else (x_r, v_r, *y[2:])
        contact = contact_force(y)
        flange = tool_acceleration = 0.0
        if robot is not None:
            m_r, k_r, c_r = robot_at(x_r)
            drive = k_r * (x_r - x_f) + c_r * (v_r - v_f)
        if is_rigid:
            flange = tool_acceleration = (drive - contact) / (m_r + tool)
        else:
            force = coupling_force(x_t - x_f, v_t - v_f)
            tool_acceleration = (force - contact) / tool
            flange = (drive - force) / m_r if robot is not None else 0.0
        return [v_f, flange, v_t, tool_acceleration, v_p, contact / body]

    t, y, touching, crossings = 0.0, np.array([0.0, 0.0, 0.0, 0.0, scene.object.distance, 0.0]), False, []
    while t < duration:

        def faces(_, y):
            return y[2] - y[4]

        def felt(_, y):
            return contact_force(y) - brake.threshold

        faces.terminal = felt.terminal = True
        faces.direction, felt.direction = (-1 if touching else 1), 1
        corners = (v / a, alarm + brake.delay, alarm + brake.delay + v / brake.deceleration, duration)
        watched = [faces, felt] if touching and alarm == inf else [faces]
        end = min(s for s in corners if s > t + 1e-14)
        run = solve_ivp(rates, (t, end), y, "LSODA", events=watched, rtol=1e-11, atol=1e-13, max_step=longest_step)
        t, y = run.t[-1], run.y[:, -1].copy()
        if is_bistable:
            flange = run.y[0] if robot is not None else np.array([command(s)[0] for s in run.t])
            x = start + run.y[2] - flange
            for i in np.flatnonzero(x[1:] * x[:-1] < 0):
                crossings.append(run.t[i] + (run.t[i + 1] - run.t[i]) * x[i] / (x[i] - x[i + 1]))
        if run.t_events[0].size:
            touching = not touching
            y[2] = np.nextafter(y[4], np.inf if touching else -np.inf)
            if touching:
                v_in = y[3] - y[5]
                tool_side = tool if not is_rigid else tool + robot_at(command(t)[0])[0]
                reduced = tool_side * body / (tool_side + body)
                delta0 = (reduced * v_in**2 / law.stiffness) ** (1 / (m + 1))
                chi = d * law.stiffness * delta0 ** (m - n) / v_in
                if alarm == inf and contact_force(y) > brake.threshold:
                    alarm = t
        elif run.status == 1:
            alarm = t
    return SimpleNamespace(
        object_velocity=y[5],
        tool_velocity=y[3],
        object_position=y[4],
        detection_time=alarm,
        snap_through=tuple(crossings),
    )
