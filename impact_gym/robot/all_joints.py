"""Simulate an arm with all its joints (paper, eq. 10), as a reference for the simpler table of an `Approach`.

    M(q) q'' + c(q, q') = D (q_m' - q') + K (q_m - q) - J' F

Elastic joints connect the motors, at the angles q_m, with the links, at the angles q. The motors follow the line,
exactly or by a servo. Tool and object move along the line; F is the contact law of the scene, or the coupling's force.
MuJoCo computes M, J and the bias c, and SciPy integrates. Neither MuJoCo's contacts and integrator nor the compiled
solver of this package are used, so that the results are independent of them.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from impact_gym.motion import Motion, Trapezoid
from impact_gym.physics.dissipation import damping_factor
from impact_gym.robot.approach import Approach, Array
from impact_gym.robot.arm import Arm
from impact_gym.robot.drive import Path, Servo
from impact_gym.robot.equations import MOST_EVALUATIONS, Equations, Unfinished
from impact_gym.scene import Scene, SpringDamper
from impact_gym.validation import flag, number, one_of

__all__ = ["Blow", "Servo", "simulate"]

MOST_CONTACTS = 200


@dataclass(frozen=True)
class Blow:
    """Results of an approach that was simulated with all joints."""

    object_velocity: float  # m/s, V_p
    touch_time: float | None  # s, time of the first touch; None: the object is not touched
    impact_velocity: float | None  # m/s, of the tool at the first touch
    peak_force: float  # N
    contact_time: float | None  # s, duration of the first contact; None: it has not ended
    impulse: float  # N s, on the object
    contact_count: int
    sideways: float  # m, largest distance of the flange from the line during contacts
    turn: float  # rad, largest rotation of the flange during contacts, relative to the first touch
    status: str  # "ok", or why the run ended early


def simulate(
    arm: Arm, approach: Approach, scene: Scene, motion: Trapezoid | Motion, *, duration: float,
    coriolis: bool = True, gravity: bool = False, servo: Servo | None = None, rtol: float = 1e-8,
    most_evaluations: int = MOST_EVALUATIONS,
) -> Blow:  # fmt: skip
    """Simulate an approach of `arm` with all its joints along the line of `approach`; `scene.robot` must be None.

    Args:
        arm: the arm that `approach` describes.
        approach: the line, and the motors' angles along it.
        scene: tool, object, contact and coupling. The object must have no friction, and the contact equal exponents.
        motion: motion of the motors along the line.
        duration: length of the run, s.
        coriolis: whether centrifugal and Coriolis forces act.
        gravity: whether gravity acts; it then also deflects the joints at the start.
        servo: the servo by which the motors follow the line; None: they follow it exactly.
        rtol: relative tolerance of the integration, 1e-12 to 1e-3.
        most_evaluations: number of evaluations of the equations after which the run stops with a status.

    Raises:
        ValueError: the scene has something that is not modelled here, or the line ends before the object.
    """
    for field, value, kinds in (
        ("arm", arm, (Arm,)), ("approach", approach, (Approach,)), ("scene", scene, (Scene,)),
        ("motion", motion, (Trapezoid, Motion)), ("servo", servo, (Servo, type(None))),
    ):  # fmt: skip
        one_of(field, value, *kinds)
    for field, given in (("coriolis", coriolis), ("gravity", gravity)):
        flag(field, given)
    number("duration", duration, "s", above=0)
    number("rtol", rtol, "-", at_least=1e-12, at_most=1e-3)
    number("most_evaluations", most_evaluations, "-", at_least=1)
    law, distance = scene.contact, scene.object.distance
    stroke = isinstance(scene.coupling, SpringDamper) and scene.coupling.stroke
    if scene.robot is not None or scene.object.friction or law.reference_velocity or stroke:
        raise ValueError("scene.robot, object.friction, a fixed dissipation and coupling.stroke must be left out here")
    if law.stiffness_exponent != law.damping_exponent:
        raise ValueError("contact.damping_exponent must equal contact.stiffness_exponent here")
    if not distance <= approach.position[-1]:
        raise ValueError(f"object.distance is {distance!r} m, but the line ends after {approach.position[-1]:.4g} m")
    if arm.joints != approach.joints or np.abs(arm.flange(approach.joint_angles[0])[0] - approach.start).max() > 1e-6:
        raise ValueError("approach must be of this arm: its first joint angles do not put the flange at its start")
    if servo is not None and not (arm.rotors > 0).all():
        raise ValueError("a servo needs the arm's rotor_inertia, in kg m^2, above 0")
    path = Path(motion)
    equations = Equations(
        arm, approach, scene, path, coriolis=coriolis, gravity=gravity, servo=servo, most_evaluations=most_evaluations
    )
    if servo is not None:
        found = [equations.arm.mass_matrix(approach.joint_angles[row]) for row in (0, len(approach.position) // 2, -1)]
        growth = max(servo.growth(M, arm.stiffness, arm.damping, arm.rotors) for M in found)
        if not growth < 1.0:
            twice = servo.period * math.log(2.0) / math.log(growth) if growth > 1.0 else math.inf
            return _run(equations, 0.0, rtol, f"the servo is not stable: an error doubles in {twice:.3g} s")
    return _run(equations, duration, rtol, "ok")


def _run(equations: Equations, duration: float, rtol: float, status: str) -> Blow:
    """Integrate from event to event; return the result, with this `status` unless the run ends early."""
    scene, path, servo, touching, t = equations.scene, equations.path, equations.servo, False, 0.0
    y, d = equations.begin(scene.object.distance), damping_factor(scene.contact.dissipation, scene.contact.restitution)
    touches, parted, impact, rotation, undetected = list[float](), list[float](), None, np.eye(3), True
    peak = sideways = turn = 0.0
    due = 0.0 if servo else math.inf  # s, time of the servo's next sample
    late = deque[tuple[float, Array]]()  # times at which commanded torques will begin to act, and these torques
    try:
        while t < duration:
            if servo and t >= due:
                late.append((t + servo.delay, equations.sample(t, y)))
                due = t + servo.period
            while late and t >= late[0][0]:
                equations.torque = late.popleft()[1]
            changes = [piece[0] for piece in path.pieces if piece[0] > t]
            until = min(duration, *changes, due, late[0][0] if late else math.inf)
            found = equations.piece(t, until, y, touching, undetected and path.threshold < math.inf, rtol)
            if not found.success:
                raise Unfinished(f"the integration failed: {found.message}")
            if touching:
                states = [found.sol(s) for s in np.linspace(found.t[0], found.t[-1], 4 * len(found.t) + 1)]
                peak = max(peak, _highest([equations.contact(*equations.penetration(each)) for each in states]))
                away, turned = zip(*(equations.deviation(each, rotation) for each in states[::4]), strict=True)
                sideways, turn = max(sideways, *away), max(turn, *turned)
            t, y = float(found.t[-1]), found.y[:, -1]
            fired = next((kind for kind, times in enumerate(found.t_events) if times.size), None)
            if fired == 1:
                raise Unfinished(f"the motion leaves the line at {t:.4g} s")
            if fired == 2:
                path.brake(t)
                undetected = False
            elif fired == 0 and touching:
                parted.append(t)
                touching, y[-5] = False, y[-3] - 1e-15
            elif fired == 0:
                closing = equations.penetration(y)[1]
                touching, equations.damping = True, d * scene.contact.stiffness / max(closing, 1e-9)
                if not touches:
                    impact, rotation = closing + float(y[-2]), equations.arm.flange(y[: equations.n])[1]
                touches.append(t)
                if len(touches) > MOST_CONTACTS:
                    raise Unfinished(f"more than {MOST_CONTACTS} contacts")
    except Unfinished as reason:
        status = str(reason)
    return Blow(
        object_velocity=float(y[-2]), touch_time=touches[0] if touches else None, impact_velocity=impact,
        peak_force=peak, contact_time=parted[0] - touches[0] if parted else None, impulse=float(y[-1]),
        contact_count=len(touches), sideways=sideways, turn=turn, status=status,
    )  # fmt: skip


def _highest(forces: list[float]) -> float:
    """Return the maximum of a curve at evenly spaced points: by a parabola through the largest and its neighbours."""
    top = int(np.argmax(forces))
    if not 0 < top < len(forces) - 1:
        return forces[top]
    left, middle, right = forces[top - 1 : top + 2]
    bend = left - 2.0 * middle + right
    return middle - 0.125 * (right - left) ** 2 / bend if bend < 0.0 else middle
