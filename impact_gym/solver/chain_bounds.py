"""What a chain without a closed form can still do, and has done: frequencies, reach, forces, momentum."""

import math
from typing import NamedTuple

import numpy as np

from impact_gym.kernel import by_type, inner_kernel
from impact_gym.physics import contact, coupling, robot
from impact_gym.physics.coupling import MechanismLaw, RobotLaw, VaryingLaw
from impact_gym.solver.chained import OFFSET, OFFSET_RATE, ChainedLaw, Piece, load_chain, motion, place, varying_mass
from impact_gym.solver.collision import DEFLECTION, DEFLECTION_RATE, RATE, ROOT, TIME
from impact_gym.solver.state import Array, Chain


class Swing(NamedTuple):
    """How a chain moves about its imposed motion."""

    energy: float  # J, kinetic and elastic
    floor: float  # J, the least there can be on this side of an alignment
    barrier: float  # J, the least it takes to get to the other, inf if there is none
    tool_mass: float  # kg, of what touches
    mass: float  # kg, of all that swings


@inner_kernel
def mechanism_frequency(law: MechanismLaw, chain: Chain) -> float:
    """Highest angular frequency but for the stops, rad/s."""
    return math.sqrt(coupling.mechanism_stiffness_bound(law.coupling) / law.tool_mass)


@inner_kernel
def robot_frequency(law: RobotLaw, chain: Chain) -> float:
    """A bound on the angular frequencies but for the stops, rad/s."""
    flange = robot.at(law.robot, chain.flange_position).mass
    tied: float = coupling.stiffness_bound(law.coupling) * (1.0 / law.tool_mass + 1.0 / flange)
    return math.sqrt(robot.stiffest(law.robot) + tied)


@inner_kernel
def varying_frequency(law: VaryingLaw, chain: Chain) -> float:
    """A bound on the angular frequency, rad/s."""
    return math.sqrt(robot.stiffest_varying(law.robot))


highest_frequency = by_type(
    {MechanismLaw: mechanism_frequency, RobotLaw: robot_frequency, VaryingLaw: varying_frequency}
)
"""A bound on the angular frequencies of a chain but for stops, rad/s."""


@inner_kernel
def mechanism_reach(law: MechanismLaw, chain: Chain) -> float:
    """Largest deflection to come, m, while the imposed motion rests and there is no contact."""
    kinetic = 0.5 * law.tool_mass * chain.deflection_rate**2
    return coupling.mechanism_reach(law.coupling, chain.deflection, kinetic)


@inner_kernel
def robot_reach(law: RobotLaw, chain: Chain) -> float:
    """Largest deflection to come, m, while the imposed motion rests and there is no contact."""
    m_r, k_r, _ = robot.at(law.robot, chain.flange_position)
    stretch = chain.deflection - chain.flange_offset
    outside = 0.5 * (m_r * chain.flange_offset_rate**2 + k_r * chain.flange_offset**2)
    outside += 0.5 * law.tool_mass * chain.deflection_rate**2
    farthest: float = coupling.reach(law.coupling, stretch, outside)
    return farthest + math.sqrt(2.0 * (outside + coupling.stored(law.coupling, stretch)) / k_r)


@inner_kernel
def varying_reach(law: VaryingLaw, chain: Chain) -> float:
    """Largest deflection to come, m, while the imposed motion rests and there is no contact."""
    m_r, k_r, _ = robot.varying_at(law.robot, chain.flange_position)
    return math.hypot(chain.deflection, chain.deflection_rate * math.sqrt((m_r + law.tool_mass) / k_r))


reach = by_type({MechanismLaw: mechanism_reach, RobotLaw: robot_reach, VaryingLaw: varying_reach})
"""Largest deflection to come, m."""


@inner_kernel
def mechanism_swing(law: MechanismLaw, now: Piece, x_r: float, state: Array) -> Swing:
    """Of the tool, seen from the imposed motion."""
    y_dot = state[DEFLECTION_RATE] * now.units.velocity
    stored = coupling.mechanism_stored(law.coupling, state[DEFLECTION] * now.units.length)
    floor, barrier = coupling.mechanism_floor(law.coupling, now.side)
    return Swing(stored + 0.5 * law.tool_mass * y_dot**2, floor, barrier, law.tool_mass, law.tool_mass)


@inner_kernel
def robot_swing(law: RobotLaw, now: Piece, x_r: float, state: Array) -> Swing:
    """Of flange and tool, seen from the imposed motion."""
    m_r, k_r, _ = robot.within(law.robot, now.place, x_r)
    q, q_dot = state[OFFSET] * now.units.length, state[OFFSET_RATE] * now.units.velocity
    y_dot = state[DEFLECTION_RATE] * now.units.velocity
    energy = coupling.stored(law.coupling, state[DEFLECTION] * now.units.length - q)
    energy += 0.5 * (law.tool_mass * y_dot**2 + m_r * q_dot**2 + k_r * q**2)
    floor, barrier = coupling.floor(law.coupling, now.side)
    return Swing(energy, floor, barrier, law.tool_mass, law.tool_mass + m_r)


@inner_kernel
def varying_swing(law: VaryingLaw, now: Piece, x_r: float, state: Array) -> Swing:
    """Of robot and tool, seen from the imposed motion."""
    m_r, k_r, _ = robot.varying_within(law.robot, now.place, x_r)
    y, y_dot = state[DEFLECTION] * now.units.length, state[DEFLECTION_RATE] * now.units.velocity
    m = m_r + law.tool_mass
    return Swing(0.5 * (m * y_dot**2 + k_r * y**2), 0.0, math.inf, m, m)


swing = by_type({MechanismLaw: mechanism_swing, RobotLaw: robot_swing, VaryingLaw: varying_swing})
"""Energy of a chain at an imposed position (m), from a scaled state."""

TABLE = 2.0
"""Factor by which the change of a robot's parameters within one interval of its table may feed the swing."""


@inner_kernel
def longest_blind_step(law: ChainedLaw, now: Piece, state: Array, longest: float, shortest: float) -> float:
    """A step of a flight between `shortest` and `longest` (scaled) in which tool and object cannot touch.

    From the imposed motion, the tool is at most as fast as the energy E of the swing allows, of which the acceleration
    a feeds it at most |a| sqrt(2 E m) per second: sqrt(E) grows by at most |a| sqrt(m / 2) t. `shortest` is returned
    where nothing is known.
    """
    units = now.units
    t = state[TIME] * units.time
    x_r = now.position + t * (now.velocity + 0.5 * now.acceleration * t)
    energy, floor, barrier, tool_mass, mass = swing(law, now, x_r, state)
    closing = (state[RATE] - state[DEFLECTION_RATE]) * units.velocity
    gap = -state[ROOT] * units.length
    h = longest
    while h > shortest:
        span = h * units.time
        fed = math.sqrt(TABLE * max(energy - floor, 0.0)) + abs(now.acceleration) * math.sqrt(0.5 * mass) * span
        if floor + fed * fed >= barrier:  # and then there is more to gain on the other side
            fed = math.sqrt(TABLE * energy) + abs(now.acceleration) * math.sqrt(0.5 * mass) * span
        if span * (closing + abs(now.acceleration) * span + fed * math.sqrt(2.0 / tool_mass)) < gap:
            return h
        h *= 0.5
    return shortest


@inner_kernel
def cannot_touch(law: ChainedLaw, chain: Chain) -> bool:
    """True if, with the imposed motion at rest for good, tool and object can never touch again.

    The object does not come back, and the energy of the chain bounds how far the tool can swing out.
    """
    parting = chain.flange_velocity + chain.deflection_rate - chain.penetration_rate >= 0.0
    return parting and reach(law, chain) <= chain.deflection - chain.penetration


@inner_kernel
def coupling_impulse(law: ChainedLaw, chain: Chain) -> float:
    """Impulse on the tool of what holds it, over the contact under way, N s (paper, eq. 21)."""
    return chain.pull_impulse


@inner_kernel
def coupling_force(law: ChainedLaw, chain: Chain, acceleration: float, contact_force: float) -> float:
    """Force on the tool of what holds it, N."""
    state = np.empty(12)
    units = contact.Scales(1.0, 1.0, 1.0, 1.0)
    now = Piece(
        contact.Hertz(1.0, 0.0),
        0.0,
        1.0,
        units,
        acceleration,
        0.0,
        0.0,
        chain.pressed,
        chain.side,
        place(law, chain, acceleration),
    )
    load_chain(law, chain, units, state)
    force: float = motion(law, now, chain.flange_position, chain.flange_velocity, state, contact_force).pull
    return force


@inner_kernel
def varying_momentum(law: VaryingLaw, chain: Chain) -> float:
    """Momentum that robot and tool have gained in the contact, less what the mass that joined brought along, N s."""
    after = varying_mass(law, chain.flange_position) * (chain.flange_velocity + chain.deflection_rate)
    before = varying_mass(law, chain.start_flange_position) * chain.start_tool_velocity
    return after - before - chain.joined
