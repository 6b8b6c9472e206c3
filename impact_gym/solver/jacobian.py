"""Derivatives of the scaled equations of motion by the scaled state, row by row as `coupled.rate` writes the rates."""

from typing import NamedTuple

from impact_gym.kernel import by_type, inner_kernel
from impact_gym.physics import contact, coupling, robot
from impact_gym.physics.coupling import MechanismLaw, RigidLaw, RobotLaw, SpringDamperLaw, VaryingLaw
from impact_gym.solver.chained import (
    COUPLING_IMPULSE,
    JOINED,
    OFFSET,
    OFFSET_RATE,
    ChainedLaw,
    Flight,
    Motion,
    Piece,
    flight_width,
    motion,
    width,
)
from impact_gym.solver.collision import (
    DEFLECTION,
    DEFLECTION_INTEGRAL,
    DEFLECTION_RATE,
    IMPULSE,
    RATE,
    ROOT,
    TIME,
    Collision,
)
from impact_gym.solver.state import Array


@inner_kernel
def _clear(n: int, out: Array) -> None:
    for row in range(n):
        for column in range(n):
            out[row, column] = 0.0


@inner_kernel
def _shared(now: Collision | Piece, z: float, w: float, out: Array) -> tuple[float, float, float]:
    """Write the rows of z, t and the impulse in a contact; return the force and its derivatives by z and w."""
    f = contact.force(now.contact, z, w)
    f_z, f_w = contact.force_gradient(now.contact, z, w)
    out[ROOT, RATE] = 0.5
    out[TIME, ROOT] = 1.0
    out[IMPULSE, ROOT] = f + z * f_z
    out[IMPULSE, RATE] = z * f_w
    return f, f_z, f_w


@inner_kernel
def rigid(law: RigidLaw, now: Collision, state: Array, out: Array) -> None:
    """Of `solver.rigid.rate`."""
    z, w = state[ROOT], state[RATE]
    _clear(4, out)
    f, f_z, f_w = _shared(now, z, w, out)
    out[RATE, ROOT] = now.flange_push - f - z * f_z
    out[RATE, RATE] = -z * f_w


@inner_kernel
def spring_damper(law: SpringDamperLaw, now: Collision, state: Array, out: Array) -> None:
    """Of `solver.spring_damper.rate`."""
    z, w, y, y_dot = state[ROOT], state[RATE], state[DEFLECTION], state[DEFLECTION_RATE]
    _clear(8, out)
    f, f_z, f_w = _shared(now, z, w, out)
    pull = coupling.relative_force(now.frequency, now.damping_ratio, y, y_dot)
    pull_y, pull_y_dot = -now.frequency * now.frequency, -2.0 * now.damping_ratio * now.frequency
    out[RATE, ROOT] = pull - f - z * f_z
    out[RATE, RATE] = -z * f_w
    out[DEFLECTION, ROOT] = y_dot
    out[DEFLECTION, DEFLECTION_RATE] = z
    out[DEFLECTION_RATE, ROOT] = pull - now.flange_push - now.tool_share * (f + z * f_z)
    out[DEFLECTION_RATE, RATE] = -now.tool_share * z * f_w
    for row in (RATE, DEFLECTION_RATE):
        out[row, DEFLECTION] = z * pull_y
        out[row, DEFLECTION_RATE] = z * pull_y_dot
    out[DEFLECTION_INTEGRAL, ROOT] = y
    out[DEFLECTION_INTEGRAL, DEFLECTION] = z


class Gradient(NamedTuple):
    """Derivatives of one entry of `chained.Motion`."""

    y: float  # by the deflection, per m
    y_dot: float  # by its rate, s/m
    q: float  # by the flange offset, per m
    q_dot: float  # by its rate, s/m
    time: float  # by time, per s
    push: float  # by the contact force, per N


NOTHING = Gradient(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@inner_kernel
def mechanism_gradients(
    law: MechanismLaw, now: Piece, x_r: float, v_r: float, state: Array, push: float
) -> tuple[Gradient, Gradient, Gradient, Gradient]:
    """Of `chained.mechanism_motion`."""
    k, c = coupling.pull_slopes(law.coupling, now.pressed, state[DEFLECTION] * now.units.length)
    m_t = law.tool_mass
    tool = Gradient(k / m_t, c / m_t, 0.0, 0.0, 0.0, -1.0 / m_t)
    return tool, NOTHING, Gradient(k, c, 0.0, 0.0, 0.0, 0.0), NOTHING


@inner_kernel
def robot_gradients(
    law: RobotLaw, now: Piece, x_r: float, v_r: float, state: Array, push: float
) -> tuple[Gradient, Gradient, Gradient, Gradient]:
    """Of `chained.robot_motion`."""
    q, q_dot = state[OFFSET] * now.units.length, state[OFFSET_RATE] * now.units.velocity
    y, y_dot = state[DEFLECTION] * now.units.length, state[DEFLECTION_RATE] * now.units.velocity
    k, c = coupling.pull_slopes(law.coupling, now.pressed, y - q)
    T = coupling.pull(law.coupling, now.pressed, y - q, y_dot - q_dot)
    m_t = law.tool_mass
    m_r, k_r, c_r = robot.within(law.robot, now.place, x_r)
    m_x, k_x, c_x = robot.within_slopes(law.robot, now.place, x_r)
    force = -k_r * q - c_r * q_dot - T
    drift = (-k_x * q - c_x * q_dot) / m_r - force * m_x / (m_r * m_r)
    tool = Gradient(k / m_t, c / m_t, -k / m_t, -c / m_t, 0.0, -1.0 / m_t)
    flange = Gradient(-k / m_r, -c / m_r, (k - k_r) / m_r, (c - c_r) / m_r, drift * v_r, 0.0)
    return tool, flange, Gradient(k, c, -k, -c, 0.0, 0.0), NOTHING


@inner_kernel
def varying_gradients(
    law: VaryingLaw, now: Piece, x_r: float, v_r: float, state: Array, push: float
) -> tuple[Gradient, Gradient, Gradient, Gradient]:
    """Of `chained.varying_motion`."""
    y, y_dot = state[DEFLECTION] * now.units.length, state[DEFLECTION_RATE] * now.units.velocity
    m_r, k_r, c_r = robot.varying_within(law.robot, now.place, x_r)
    m_x, k_x, c_x = robot.varying_within_slopes(law.robot, now.place, x_r)
    m = m_r + law.tool_mass
    T = -k_r * y - c_r * y_dot
    T_time = (-k_x * y - c_x * y_dot) * v_r
    tool_time = T_time / m - (T - push) * m_x * v_r / (m * m)
    bend = robot.mass_bend(law.robot, now.place, x_r)
    joined_time = bend * v_r * v_r * (v_r + y_dot) + m_x * now.acceleration * (2.0 * v_r + y_dot)
    return (
        Gradient(-k_r / m, -c_r / m, 0.0, 0.0, tool_time, -1.0 / m),
        NOTHING,
        Gradient(-k_r, -c_r, 0.0, 0.0, T_time, 0.0),
        Gradient(0.0, m_x * v_r, 0.0, 0.0, joined_time, 0.0),
    )


gradients = by_type({MechanismLaw: mechanism_gradients, RobotLaw: robot_gradients, VaryingLaw: varying_gradients})
"""Gradients of the entries of `chained.Motion`: tool, flange, pull, joined."""


@inner_kernel
def _row(row: int, now: Piece, part: Gradient, per: float, out: Array) -> None:
    """Write one row but for the columns of z and w; `per` is the scaled rate for one unit of what `part` is of."""
    out[row, DEFLECTION] = per * part.y * now.units.length
    out[row, DEFLECTION_RATE] = per * part.y_dot * now.units.velocity
    out[row, OFFSET] = per * part.q * now.units.length
    out[row, OFFSET_RATE] = per * part.q_dot * now.units.velocity
    out[row, TIME] = per * part.time * now.units.time


@inner_kernel
def _chain_rows(
    law: ChainedLaw, now: Piece, state: Array, push: float, pace: float, out: Array
) -> tuple[Motion, float]:
    """Write the rows of `chained.fill` but for the columns of z and w; return the motion and d(tool)/d(push)."""
    units = now.units
    t = state[TIME] * units.time
    x_r = now.position + t * (now.velocity + 0.5 * now.acceleration * t)
    v_r = now.velocity + now.acceleration * t
    tool, flange, pull, joined = gradients(law, now, x_r, v_r, state, push)
    per_velocity = pace * units.time / units.velocity
    _row(RATE, now, tool, per_velocity, out)
    _row(DEFLECTION_RATE, now, tool, per_velocity, out)
    _row(OFFSET_RATE, now, flange, per_velocity, out)
    _row(COUPLING_IMPULSE, now, pull, pace / units.force, out)
    _row(JOINED, now, joined, pace / units.force, out)
    out[DEFLECTION, DEFLECTION_RATE] = pace
    out[OFFSET, OFFSET_RATE] = pace
    return motion(law, now, x_r, v_r, state, push), tool.push


@inner_kernel
def chained(law: ChainedLaw, now: Piece, state: Array, out: Array) -> None:
    """Of `solver.chained.rate`."""
    units = now.units
    z, w = state[ROOT], state[RATE]
    _clear(width(law), out)
    f, f_z, f_w = _shared(now, z, w, out)
    push = f * units.force
    move, per_newton = _chain_rows(law, now, state, push, z, out)
    per_velocity = units.time / units.velocity
    tool_push = per_velocity * per_newton * units.force
    gap_push = tool_push - per_velocity * units.force / now.object_mass
    out[RATE, ROOT] = per_velocity * (move.tool + now.acceleration - push / now.object_mass) + z * gap_push * f_z
    out[RATE, RATE] = z * gap_push * f_w
    out[DEFLECTION, ROOT] = state[DEFLECTION_RATE]
    out[DEFLECTION_RATE, ROOT] = per_velocity * move.tool + z * tool_push * f_z
    out[DEFLECTION_RATE, RATE] = z * tool_push * f_w
    out[COUPLING_IMPULSE, ROOT] = move.pull / units.force
    out[JOINED, ROOT] = move.joined / units.force
    out[OFFSET, ROOT] = state[OFFSET_RATE]
    out[OFFSET_RATE, ROOT] = per_velocity * move.flange


@inner_kernel
def flight(flight: Flight, now: Piece, state: Array, out: Array) -> None:
    """Of `solver.chained.flight_rate`."""
    _clear(flight_width(flight), out)
    _chain_rows(flight.law, now, state, 0.0, 1.0, out)
    out[ROOT, RATE] = 1.0


fill = by_type(
    {
        RigidLaw: rigid,
        SpringDamperLaw: spring_damper,
        MechanismLaw: chained,
        RobotLaw: chained,
        VaryingLaw: chained,
        Flight: flight,
    }
)
"""Write d(rate)/d(state) into the first rows of `out`."""
