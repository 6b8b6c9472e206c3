"""Simulate an arm with all its joints (paper, eq. 10), as a reference for the table along a line.

    M(q) q'' + c(q, q') = D (q_m' - q') + K (q_m - q) - J^T F

Joints of stiffness K and damping D connect the motors, at the angles q_m, with the links, at the angles q. The motors
follow the line of the approach, exactly or by a servo. Tool and object move along this line. F is the force of the
coupling on the tool or, if the coupling is rigid, of the tool on the object. MuJoCo computes the mass matrix M, the
flange's Jacobian J, and c, the weight and Coriolis forces. SciPy integrates the equations.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from impact_gym.motion import Motion, Trapezoid
from impact_gym.physics.dissipation import damping_factor
from impact_gym.robot.arm import Arm
from impact_gym.robot.equations import MOST_EVALUATIONS, Equations, Path, Servo, Unfinished
from impact_gym.robot.line_table import Array, LineTable
from impact_gym.scene import Scene
from impact_gym.support.validation import flag, number, one_of

__all__ = ["Blow", "Servo", "simulate"]

MOST_CONTACTS = 200


@dataclass(frozen=True)
class Blow:
    """Results of an approach simulated with all joints."""

    object_velocity: float  # m/s, at the end of the run
    touch_time: float | None  # s, time of the first touch; None: the object is not touched
    impact_velocity: float | None  # m/s, of the tool at the first touch; None: no touch
    peak_force: float  # N, largest contact force
    contact_time: float | None  # s, duration of the first contact; None: there was none, or it has not ended
    impulse: float  # N s, on the object
    contact_count: int
    sideways: float  # m, largest distance of the flange from the line during contacts
    status: str  # "ok", or why the run ended early


def simulate(
    arm: Arm, line: LineTable, scene: Scene, motion: Trapezoid | Motion, *, duration: float,
    gravity: bool = False, servo: Servo | None = None, rtol: float = 1e-8, most_evaluations: int = MOST_EVALUATIONS,
) -> Blow:  # fmt: skip
    """Simulate `arm` with all its joints while it moves along the `line`.

    Args:
        arm: the arm that `line` describes.
        line: the line, and the motors' angles along it.
        scene: a scene without robot, friction or "fixed" dissipation; the contact's two exponents are equal.
        motion: motion of the motors along the line.
        duration: length of the run, s.
        gravity: whether gravity acts and, at the start, deflects the joints.
        servo: the servo by which the motors follow the line; None: the motors follow the line exactly.
        rtol: relative tolerance of the integration, 1e-12 to 1e-3.
        most_evaluations: number of evaluations of the equations after which the run ends early.
    """
    for field, value, kinds in (
        ("arm", arm, (Arm,)), ("line", line, (LineTable,)), ("scene", scene, (Scene,)),
        ("motion", motion, (Trapezoid, Motion)), ("servo", servo, (Servo, type(None))),
    ):  # fmt: skip
        one_of(field, value, *kinds)
    flag("gravity", gravity)
    number("duration", duration, "s", above=0)
    number("rtol", rtol, "-", at_least=1e-12, at_most=1e-3)
    number("most_evaluations", most_evaluations, "-", at_least=1)
    law, distance = scene.contact, scene.object.distance
    if scene.robot is not None or scene.object.friction or law.reference_velocity:
        raise ValueError('leave out scene.robot, object.friction and dissipation "fixed" with an arm')
    if law.stiffness_exponent != law.damping_exponent:
        raise ValueError("contact.damping_exponent must equal contact.stiffness_exponent with an arm")
    if not distance <= line.position[-1]:
        raise ValueError(f"object.distance is {distance!r} m, but the line ends after {line.position[-1]:.4g} m")
    if arm.joints != line.joints or np.abs(arm.flange(line.joint_angles[0])[0] - line.start).max() > 1e-6:
        raise ValueError("line must be of this arm: same joint names, and joint_angles[0] puts the flange at start")
    if servo is not None and not (arm.rotors > 0).all():
        raise ValueError("with a servo, rotor_inertia of the arm must be above 0 kg m^2 for every joint")
    return _run(Equations(arm, line, scene, Path(motion), gravity, servo, int(most_evaluations)), duration, rtol)


def _run(equations: Equations, duration: float, rtol: float) -> Blow:
    arm, path, servo, law = equations.arm, equations.path, equations.servo, equations.scene.contact
    y, t, touching, status, impact = equations.first, 0.0, False, "ok", None
    touches, parted, peak, sideways = list[float](), list[float](), 0.0, 0.0
    due = 0.0 if servo else math.inf  # s, time of the servo's next sample
    late = deque[tuple[float, Array]]()  # future torques, each with the time (s) from which they act
    try:
        while t < duration:
            if servo and t >= due:
                late.append((t + servo.delay, equations.sample(t, y)))
                due = t + servo.period
            while late and t >= late[0][0]:
                equations.torque = late.popleft()[1]
            changes = [change for change in path.times if change > t]
            until = min(duration, *changes, due, late[0][0] if late else math.inf)
            found = equations.piece(t, until, y, touching, rtol)
            if not found.success:
                raise Unfinished(f"the integration failed: {found.message}")
            if touching:
                times = np.linspace(found.t[0], found.t[-1], 4 * len(found.t) + 1)
                states = found.sol(times).T
                force = CubicSpline(times, [equations.contact(*equations.penetration(each)) for each in states])
                peak = max(peak, *force(times), *force(force.derivative().roots(extrapolate=False)))
                travelled = [arm.flange(each[: arm.count])[0] - equations.start for each in states[::4]]
                sideways = max(sideways, float(np.linalg.norm(np.cross(travelled, equations.u), axis=1).max()))
            t, y = float(found.t[-1]), found.y[:, -1]
            fired = next((kind for kind, times in enumerate(found.t_events) if times.size), None)
            if fired == 1:
                raise Unfinished(f"the motion leaves the line at {t:.4g} s")
            if fired == 2:
                path.brake(t)
            elif fired == 0 and touching:
                parted.append(t)
                touching, y[-5] = False, y[-3] - 1e-15
            elif fired == 0:
                closing = equations.penetration(y)[1]
                factor = damping_factor(law.dissipation, law.restitution)
                touching, equations.damping = True, factor * law.stiffness / max(closing, 1e-9)
                impact = impact if touches else closing + float(y[-2])
                touches.append(t)
                if len(touches) > MOST_CONTACTS:
                    raise Unfinished(f"more than {MOST_CONTACTS} contacts")
    except Unfinished as reason:
        status = str(reason)
    return Blow(
        object_velocity=float(y[-2]), touch_time=touches[0] if touches else None, impact_velocity=impact,
        peak_force=float(peak), contact_time=parted[0] - touches[0] if parted else None, impulse=float(y[-1]),
        contact_count=len(touches), sideways=sideways, status=status,
    )  # fmt: skip
