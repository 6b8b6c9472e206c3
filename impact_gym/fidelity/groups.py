"""The dimensionless groups from which the error of each reduction is predicted; all are 0 where it costs nothing.

Every group is a relative change of V_p in its own limit, worked out to its power in that limit; how large it is at
most is what the calibration adds (constants.json). Reductions and what they take:

    closed    the contact replaced by an instantaneous impact       Situation
    robot     compliance of the robot dropped                       Situation and Swing
    frozen    parameters of a RobotTable kept as at the impact      Situation, Swing and Drift
    stops     stops of a mechanism softened                         Situation and the new stiffness

A group is here only if the predictions grow by more than a few per cent without it.
"""

import math

from impact_gym.fidelity.situation import HELD, Situation
from impact_gym.fidelity.swing import Drift, Swing
from impact_gym.scene import Bistable, Rigid, SpringDamper

Groups = dict[str, float]

CAUSES = {
    "after": "change of the robot during the contact",
    "again": "possible second contact",
    "brake": "brake during the contact",
    "corner": "swing that the ramp leaves in the robot",
    "estimate": "swing and recoil of the robot",
    "impact": "swing of the robot at the impact",
    "impulse": "impulse of the coupling",
    "late brake": "brake during the contact",
    "lift": "ramp that lifts the slider off its stop",
    "parts": "impulse of the coupling",
    "period": "longer period of tool and robot in series",
    "phase": "phase of the robot's swing",
    "preload": "preload of the stop",
    "pressed": "stop pressed during the contact",
    "ramp": "ramp during the contact",
    "recoil": "recoil of the robot",
    "slow": "slow stop",
    "spring": "turn of the coupling's spring during the contact",
    "swing": "swing of the robot",
}
"""What each group stands for, in words."""

SHORT = 6.0  # rad: a contact shorter than this on the robot's vibration is a blow to its mass, a longer one a push
MOST = 5.0  # of the coupling's impulse over that of the impact: beyond, its recoil is no estimate

LIFTING = (HELD, 0.8)  # of the preload taken by the ramp: the slider may leave its stop, by overshoot
LIFTED = (0.9, 1.05)  # likewise: it does leave it, and how far depends on everything


def closed(now: Situation) -> Groups:
    """Groups of the instantaneous impact: what ramp, brake and coupling do during the contact (paper, eq. 20-22)."""
    brake = now.late_brake * now.early
    if isinstance(now.scene.coupling, Rigid):
        return {"brake": brake, "late brake": now.late_brake, "ramp": now.ramped}
    m_t, m_p = now.scene.tool.mass, now.scene.object.mass
    share = m_t * now.contact.duration / ((m_t + m_p) * now.velocities[1])
    groups = {"impulse": abs(now.push) * share, "brake": brake, "again": now.again}
    if now.mass is None:
        return groups | {"lift": _step(now.lift, *LIFTING)}
    turn = now.mass.frequency * now.contact.duration
    loss = now.share * (1.0 + now.contact.restitution)
    return groups | {"parts": now.work * share, "spring": turn**2 * loss}


def robot(now: Situation, swing: Swing, drift: Drift | None = None) -> Groups:
    """Groups of a rigid robot: its swing at the impact, its recoil, what the brake stirs up, and a table's `drift`."""
    if isinstance(now.scene.coupling, SpringDamper):
        return _grown(now, _behind(now, swing, swing.amplitude) | _joined(now, swing))
    x = swing.frequency * now.contact.duration
    recoil = now.scene.object.mass / swing.mass
    groups = {"brake": min(now.braked, 1.0) * swing.corner}
    if drift is not None:
        groups["phase"] = drift.phase * swing.scale
    moved = swing.amplitude * swing.scale
    if isinstance(now.scene.coupling, Rigid):
        lost = 1.0 - now.contact.restitution  # the estimate is that for an elastic contact
        groups |= {
            "estimate": swing.estimate,
            "recoil": recoil * lost / (1.0 + x / (2.0 * SHORT)),
            "swing": moved * lost * min(x, 1.0) / (1.0 + (x / SHORT) ** 2),
        }
    else:
        groups |= {
            "impact": swing.impact,
            "swing": moved,
            "recoil": recoil * min(now.load, 1.0) / (1.0 + x / SHORT),
            "again": now.again,
            "lift": _step(now.lift, *LIFTED),
        }
    return _grown(now, groups)


def frozen(now: Situation, swing: Swing, drift: Drift) -> Groups:
    """Groups of parameters kept as at the impact: the robot's swing comes with another phase, and drifts on."""
    change = min(drift.change, 1.0)
    if isinstance(now.scene.coupling, SpringDamper):
        joined = {name: change * value for name, value in _joined(now, swing).items()}
        return _grown(now, _behind(now, swing, drift.phase) | joined)
    x = swing.frequency * now.contact.duration
    recoil = now.scene.object.mass / swing.mass
    groups = {
        "phase": drift.phase * swing.scale / (1.0 + x / SHORT),
        "after": drift.during(now) * recoil / (1.0 + recoil),
        "brake": min(now.braked, 1.0) * swing.corner * change,
    }
    if isinstance(now.scene.coupling, Bistable):
        again = now.again * (min(drift.phase, 1.0) + change * swing.corner)
        groups |= {"again": again, "lift": _step(now.lift, *LIFTED) * change}
    return _grown(now, groups)


def stops(now: Situation, stiffness: float) -> Groups:
    """Groups of stops softened to `stiffness` (N/m): they give way under preload and whatever strikes them."""
    coupling = now.scene.coupling
    assert isinstance(coupling, Bistable)
    m_t = now.scene.tool.mass
    slow = min(1.0 / (math.sqrt(stiffness / m_t) * now.contact.time), 1.0)
    return _grown(
        now,
        {
            "preload": float(coupling.force(coupling.front_stop)) ** 2 / (stiffness * m_t * now.velocity**2),
            "pressed": min(now.phi, 1.0) * slow,
            "slow": slow**2,
            "again": now.again * slow,
            "lift": _step(now.lift, *LIFTED),
        },
    )


def _behind(now: Situation, swing: Swing, amplitude: float) -> Groups:
    """What of a swing of the flange, and of what its corners stir up, reaches a tool on a spring."""
    assert now.mass is not None
    r = now.mass.frequency / swing.frequency
    share = r * (2.0 * now.mass.damping_ratio + r)
    passed = share / (1.0 + share)  # of a fast vibration of its base; all of a slow one
    return {
        "swing": amplitude * passed,
        "corner": swing.corner * passed * now.left,
        "brake": min(now.braked, 1.0) * swing.corner * passed,
        "again": now.again * swing.corner * passed,
    }


def _joined(now: Situation, swing: Swing) -> Groups:
    """What a flange that gives way to the spring changes: its period, and the impulse it passes on."""
    coupling, mass = now.scene.coupling, now.mass
    assert mass is not None
    assert isinstance(coupling, SpringDamper)
    x = swing.frequency * now.contact.duration
    turn = mass.frequency * now.contact.duration
    felt = now.share * (1.0 + now.contact.restitution) * turn * (2.0 * mass.damping_ratio + turn)
    own = now.motion.acceleration / (mass.frequency * now.velocity) * now.left
    soft = coupling.stiffness / swing.stiffness
    return {
        "period": soft * (1.0 + mass.frequency * now.met.time) * own,
        "recoil": min(felt, MOST) * now.scene.tool.mass / swing.mass / (1.0 + (x / SHORT) ** 2),
    }


def _grown(now: Situation, groups: Groups) -> Groups:
    """The groups relative to the V_p that a brake during the contact leaves; see `closed`, "brake"."""
    return {name: value * (1.0 + now.late_brake) for name, value in groups.items()}


def _step(value: float, low: float, high: float) -> float:
    return min(max((value - low) / (high - low), 0.0), 1.0)
