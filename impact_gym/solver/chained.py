"""Equations of motion of the chains without a closed form: a mechanism, a compliant robot, or both.

They are integrated in flight as in contact. Forces are computed in SI units and scaled at the border.
"""

import math
from typing import NamedTuple

from impact_gym.kernel import by_type, inner_kernel
from impact_gym.physics import contact, coupling, robot
from impact_gym.physics.coupling import Law, MechanismLaw, RobotLaw, VaryingLaw
from impact_gym.solver.collision import (
    DEFLECTION,
    DEFLECTION_RATE,
    IMPULSE,
    RATE,
    ROOT,
    TIME,
    Origin,
    load_common,
    store_clock,
    store_common,
)
from impact_gym.solver.parabola import gap_closes
from impact_gym.solver.state import Array, Bodies, Chain

ChainedLaw = MechanismLaw | RobotLaw | VaryingLaw

COUPLING_IMPULSE, JOINED, OFFSET, OFFSET_RATE = 6, 7, 8, 9
"""Further places: impulse of the coupling, momentum of the mass that has joined, flange offset and its rate."""


class Piece(NamedTuple):
    """What the equations of motion read during one smooth piece of a contact or of a flight."""

    contact: contact.Force
    threshold: float  # alarm threshold over F0
    object_mass: float  # kg
    units: contact.Scales
    acceleration: float  # m/s^2, of the imposed motion
    position: float  # m, of the imposed motion where the piece starts
    velocity: float  # m/s, likewise
    pressed: int  # which stop pushes
    side: int  # of the alignment the slider is on, 1 in front
    place: int  # interval of the robot's parameters


class Motion(NamedTuple):
    """Accelerations, and the forces behind them."""

    tool: float  # m/s^2, of the tool from the imposed motion
    flange: float  # m/s^2, of the flange from the imposed motion
    pull: float  # N, of the coupling on the tool
    joined: float  # N, momentum per second of the mass that joins the moving part


@inner_kernel
def mechanism_motion(law: MechanismLaw, now: Piece, x_r: float, v_r: float, state: Array, push: float) -> Motion:
    """Tool and object under a mechanism on a rigid robot (paper, eq. 17 with 23); `push` (N) is the contact's."""
    y, y_dot = state[DEFLECTION] * now.units.length, state[DEFLECTION_RATE] * now.units.velocity
    T = coupling.mechanism_pull(law.coupling, now.pressed, y, y_dot)
    return Motion((T - push) / law.tool_mass - now.acceleration, 0.0, T, 0.0)


@inner_kernel
def robot_motion(law: RobotLaw, now: Piece, x_r: float, v_r: float, state: Array, push: float) -> Motion:
    """Flange, tool and object in a row (paper, eq. 16 with the force of eq. 17 or 23 on both its sides)."""
    y, y_dot = state[DEFLECTION] * now.units.length, state[DEFLECTION_RATE] * now.units.velocity
    q, q_dot = state[OFFSET] * now.units.length, state[OFFSET_RATE] * now.units.velocity
    T = coupling.pull(law.coupling, now.pressed, y - q, y_dot - q_dot)
    m_r, k_r, c_r = robot.within(law.robot, now.place, x_r)
    flange = (-k_r * q - c_r * q_dot - T) / m_r - now.acceleration
    return Motion((T - push) / law.tool_mass - now.acceleration, flange, T, 0.0)


@inner_kernel
def varying_motion(law: VaryingLaw, now: Piece, x_r: float, v_r: float, state: Array, push: float) -> Motion:
    """Robot and tool as one mass (paper, eq. 8) whose parameters follow the imposed motion (eq. 16)."""
    y, y_dot = state[DEFLECTION] * now.units.length, state[DEFLECTION_RATE] * now.units.velocity
    m_r, k_r, c_r = robot.varying_within(law.robot, now.place, x_r)
    T = -k_r * y - c_r * y_dot
    tool = (T - push) / (m_r + law.tool_mass) - now.acceleration
    m_x = robot.varying_within_slopes(law.robot, now.place, x_r).mass
    return Motion(tool, 0.0, T, m_x * v_r * (v_r + y_dot))


motion = by_type({MechanismLaw: mechanism_motion, RobotLaw: robot_motion, VaryingLaw: varying_motion})
"""Accelerations of a chain at imposed position x_r (m) and velocity v_r (m/s), from a scaled state."""


@inner_kernel
def fill(law: ChainedLaw, now: Piece, state: Array, out: Array, pace: float, f: float) -> None:
    """Write the rates of all but the first place: d/ds with dt = `pace` ds, under the scaled contact force `f`."""
    units = now.units
    t = state[TIME] * units.time
    x_r = now.position + t * (now.velocity + 0.5 * now.acceleration * t)
    push = f * units.force
    move = motion(law, now, x_r, now.velocity + now.acceleration * t, state, push)
    per_velocity = pace * units.time / units.velocity
    out[RATE] = per_velocity * (move.tool + now.acceleration - push / now.object_mass)
    out[TIME] = pace
    out[IMPULSE] = pace * f
    out[DEFLECTION] = pace * state[DEFLECTION_RATE]
    out[DEFLECTION_RATE] = per_velocity * move.tool
    out[COUPLING_IMPULSE] = pace * move.pull / units.force
    out[JOINED] = pace * move.joined / units.force
    out[OFFSET] = pace * state[OFFSET_RATE]
    out[OFFSET_RATE] = per_velocity * move.flange


@inner_kernel
def width(law: ChainedLaw) -> int:
    """Length of the scaled state, with places to spare that make it a multiple of four."""
    return 12


@inner_kernel
def rate(law: ChainedLaw, now: Piece, state: Array, out: Array) -> None:
    """d(state)/ds of a contact."""
    out[ROOT] = 0.5 * state[RATE]
    fill(law, now, state, out, state[ROOT], contact.force(now.contact, state[ROOT], state[RATE]))


class Flight(NamedTuple):
    """Wraps a law while its tool flies: the first place of the state is then the penetration, negative."""

    law: ChainedLaw


@inner_kernel
def flight_width(flight: Flight) -> int:
    """Length of the scaled state."""
    return 12


@inner_kernel
def flight_rate(flight: Flight, now: Piece, state: Array, out: Array) -> None:
    """d(state)/dt of a flight."""
    out[ROOT] = state[RATE]
    fill(flight.law, now, state, out, 1.0, 0.0)


@inner_kernel
def varying_mass(law: VaryingLaw, position: float) -> float:
    """Mass of robot and tool at an imposed `position` (m), kg."""
    return law.tool_mass + robot.varying_at(law.robot, position).mass


@inner_kernel
def tool_reduced_mass(law: MechanismLaw | RobotLaw, object_mass: float, chain: Chain) -> float:
    """Mass of the relative motion, kg."""
    return law.tool_mass * object_mass / (law.tool_mass + object_mass)


@inner_kernel
def varying_reduced_mass(law: VaryingLaw, object_mass: float, chain: Chain) -> float:
    """Mass of the relative motion where the contact under way began, kg."""
    moving = varying_mass(law, chain.start_flange_position)
    return moving * object_mass / (moving + object_mass)


@inner_kernel
def no_place(law: MechanismLaw, chain: Chain, acceleration: float) -> int:
    """A rigid robot has no parameters."""
    return 0


@inner_kernel
def robot_place(law: RobotLaw | VaryingLaw, chain: Chain, acceleration: float) -> int:
    """Interval of the robot's parameters that the imposed motion is in or enters now."""
    direction = chain.flange_velocity if chain.flange_velocity != 0.0 else acceleration
    interval: int = robot.place(law.robot, chain.flange_position, direction)
    return interval


place = by_type({MechanismLaw: no_place, RobotLaw: robot_place, VaryingLaw: robot_place})
"""Interval of the robot's parameters, constant in a smooth piece."""


@inner_kernel
def collision(
    law: ChainedLaw,
    bodies: Bodies,
    chain: Chain,
    acceleration: float,
    threshold: float,
    scales: contact.Scales,
) -> Piece:
    """Return what the equations of motion read from here on."""
    return Piece(
        bodies.contact,
        threshold / scales.force,
        bodies.object_mass,
        scales,
        acceleration,
        chain.flange_position,
        chain.flange_velocity,
        chain.pressed,
        chain.side,
        place(law, chain, acceleration),
    )


@inner_kernel
def load_chain(law: ChainedLaw, chain: Chain, scales: contact.Scales, state: Array) -> None:
    """Write all but the first four places of `chain` into the scaled `state`."""
    state[4:] = 0.0
    state[DEFLECTION] = chain.deflection / scales.length
    state[DEFLECTION_RATE] = chain.deflection_rate / scales.velocity
    state[OFFSET] = chain.flange_offset / scales.length
    state[OFFSET_RATE] = chain.flange_offset_rate / scales.velocity


@inner_kernel
def load(law: ChainedLaw, chain: Chain, scales: contact.Scales, state: Array) -> None:
    """Write `chain` into the scaled `state` of a contact."""
    load_common(chain, scales, state)
    load_chain(law, chain, scales, state)


@inner_kernel
def store_chain(law: ChainedLaw, chain: Chain, base: Origin, scales: contact.Scales, state: Array) -> None:
    """Write all but the first four places of the scaled `state` back into `chain`."""
    chain.deflection = state[DEFLECTION] * scales.length
    chain.deflection_rate = state[DEFLECTION_RATE] * scales.velocity
    chain.flange_offset = state[OFFSET] * scales.length
    chain.flange_offset_rate = state[OFFSET_RATE] * scales.velocity
    chain.pull_impulse = base.pull_impulse + state[COUPLING_IMPULSE] * scales.force * scales.time
    chain.joined = base.joined + state[JOINED] * scales.force * scales.time


@inner_kernel
def store(law: ChainedLaw, chain: Chain, base: Origin, scales: contact.Scales, state: Array) -> None:
    """Write the scaled `state` of a contact back into `chain`."""
    store_common(chain, base, scales, state)
    store_chain(law, chain, base, scales, state)


@inner_kernel
def load_flight(law: ChainedLaw, chain: Chain, scales: contact.Scales, state: Array) -> None:
    """Write `chain` into the scaled `state` of a flight."""
    state[ROOT] = min(chain.penetration, 0.0) / scales.length
    state[RATE] = chain.penetration_rate / scales.velocity
    state[TIME] = 0.0
    state[IMPULSE] = 0.0
    load_chain(law, chain, scales, state)


@inner_kernel
def store_flight(law: ChainedLaw, chain: Chain, base: Origin, scales: contact.Scales, state: Array) -> None:
    """Write the scaled `state` of a flight back into `chain`."""
    store_clock(chain, base, scales, state)
    chain.penetration = state[ROOT] * scales.length
    store_chain(law, chain, base, scales, state)


@inner_kernel
def all_smooth(law: Law, chain: Chain, acceleration: float, until: float) -> float:
    """The equations of motion are smooth all the way."""
    return until


@inner_kernel
def smooth_until(law: RobotLaw | VaryingLaw, chain: Chain, acceleration: float, until: float) -> float:
    """Time (s), `until` at the latest, up to which the robot's parameters are smooth functions of time."""
    low, high = robot.bounds(law.robot, robot_place(law, chain, acceleration))
    x_r, v_r = chain.flange_position, chain.flange_velocity
    ahead = gap_closes(high - x_r, v_r, acceleration) if high < math.inf else math.inf
    behind = gap_closes(x_r - low, -v_r, -acceleration) if low > -math.inf else math.inf
    return min(until, chain.time + min(ahead, behind))


@inner_kernel
def round_off(law: ChainedLaw, chain: Chain, target: float) -> None:
    """Give the imposed motion the velocity (m/s) that a ramp ends with but for rounding; nothing else must feel it."""
    shift = target - chain.flange_velocity
    chain.deflection_rate -= shift
    if has_flange(law):
        chain.flange_offset_rate -= shift
    chain.flange_velocity = target


@inner_kernel
def _flange(law: RobotLaw) -> bool:
    return True


@inner_kernel
def _no_flange(law: MechanismLaw | VaryingLaw) -> bool:
    return False


has_flange = by_type({MechanismLaw: _no_flange, RobotLaw: _flange, VaryingLaw: _no_flange})
"""Whether the flange is a mass of its own."""
