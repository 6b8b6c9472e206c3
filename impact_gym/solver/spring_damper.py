"""A tool behind a spring and damper: flight in closed form, the first touch isolated between extrema of the gap."""

import math
from typing import NamedTuple

from impact_gym.kernel import kernel
from impact_gym.physics import budget, contact
from impact_gym.physics.coupling import SpringDamperLaw, free_decay, relative_force
from impact_gym.solver.collision import (
    DEFLECTION,
    DEFLECTION_INTEGRAL,
    DEFLECTION_RATE,
    IMPULSE,
    RATE,
    ROOT,
    TIME,
    Collision,
    Origin,
    load_common,
    store_common,
)
from impact_gym.solver.parabola import gap_closes
from impact_gym.solver.state import Array, Bodies, Chain


@kernel
def width(law: SpringDamperLaw) -> int:
    """Length of the scaled state, with a place to spare that makes it a power of two."""
    return 8


@kernel
def reduced_mass(law: SpringDamperLaw, object_mass: float, chain: Chain) -> float:
    """Mass of the relative motion, kg."""
    return law.tool_mass * object_mass / (law.tool_mass + object_mass)


@kernel
def collision(
    law: SpringDamperLaw, bodies: Bodies, chain: Chain, acceleration: float, threshold: float, scales: contact.Scales
) -> Collision:
    """Return the coefficients of the scaled equations."""
    return Collision(
        bodies.contact,
        acceleration * scales.time / scales.velocity,
        law.frequency * scales.time,
        law.damping_ratio,
        bodies.object_mass / (law.tool_mass + bodies.object_mass),
        threshold / scales.force,
    )


@kernel
def load(law: SpringDamperLaw, chain: Chain, scales: contact.Scales, state: Array) -> None:
    """Write `chain` into the scaled `state`."""
    load_common(chain, scales, state)
    state[DEFLECTION] = chain.deflection / scales.length
    state[DEFLECTION_RATE] = chain.deflection_rate / scales.velocity
    state[DEFLECTION_INTEGRAL] = 0.0


@kernel
def rate(law: SpringDamperLaw, collision: Collision, state: Array, out: Array) -> None:
    """d(state)/ds of a contact (paper, eq. 17-18)."""
    z = state[ROOT]
    w = state[RATE]
    f = contact.force(collision.contact, z, w)
    pull = relative_force(collision.frequency, collision.damping_ratio, state[DEFLECTION], state[DEFLECTION_RATE])
    out[ROOT] = 0.5 * w
    out[RATE] = z * (pull - f)
    out[TIME] = z
    out[IMPULSE] = z * f
    out[DEFLECTION] = z * state[DEFLECTION_RATE]
    out[DEFLECTION_RATE] = z * (pull - collision.tool_share * f - collision.flange_push)
    out[DEFLECTION_INTEGRAL] = z * state[DEFLECTION]


@kernel
def store(law: SpringDamperLaw, chain: Chain, base: Origin, scales: contact.Scales, state: Array) -> None:
    """Write the scaled `state` back into `chain`."""
    store_common(chain, base, scales, state)
    chain.deflection = state[DEFLECTION] * scales.length
    chain.deflection_rate = state[DEFLECTION_RATE] * scales.velocity
    chain.deflection_integral = base.deflection_integral + state[DEFLECTION_INTEGRAL] * scales.length * scales.time


@kernel
def drift(law: SpringDamperLaw, chain: Chain, acceleration: float, time: float) -> None:
    """Move `chain` through `time` (s) of flight, exactly."""
    rest = -acceleration / (law.frequency * law.frequency)
    z, z_dot = free_decay(law.frequency, law.damping_ratio, chain.deflection - rest, chain.deflection_rate, time)
    object_velocity = chain.flange_velocity + chain.deflection_rate - chain.penetration_rate
    flange_travel = time * (chain.flange_velocity + 0.5 * acceleration * time)
    chain.penetration += flange_travel + (z + rest - chain.deflection) - object_velocity * time
    chain.deflection = z + rest
    chain.deflection_rate = z_dot
    chain.flange_position += flange_travel
    chain.flange_velocity += acceleration * time
    chain.penetration_rate = chain.flange_velocity + z_dot - object_velocity
    chain.time += time


class Flight(NamedTuple):
    """The gap as a function of time: penetration(t) = start + z(t) - z(0) + closing t + a t^2 / 2."""

    frequency: float  # rad/s
    damping_ratio: float
    position: float  # m, z(0) = y + a / omega^2
    velocity: float  # m/s, z'(0)
    start: float  # m, penetration at t = 0, not positive
    closing: float  # m/s, flange velocity less object velocity
    acceleration: float  # m/s^2, of the flange


@kernel
def gap_derivatives(flight: Flight, time: float) -> tuple[float, float, float, float, float]:
    """Return the penetration at `time` and its first four derivatives."""
    w2 = flight.frequency * flight.frequency
    c = 2.0 * flight.damping_ratio * flight.frequency
    z, z1 = free_decay(flight.frequency, flight.damping_ratio, flight.position, flight.velocity, time)
    z2 = -w2 * z - c * z1
    z3 = -w2 * z1 - c * z2
    z4 = -w2 * z2 - c * z3
    gap = flight.start + (z - flight.position) + time * (flight.closing + 0.5 * flight.acceleration * time)
    return gap, z1 + flight.closing + flight.acceleration * time, z2 + flight.acceleration, z3, z4


@kernel
def monotone_zero(flight: Flight, order: int, low: float, high: float) -> float:
    """Zero of derivative `order` between `low` and `high`, where it is monotone and changes sign, to rounding.

    Newton's method, held inside the bracket by bisection.
    """
    rising = gap_derivatives(flight, high)[order] > 0.0
    time = 0.5 * (low + high)
    for _ in range(100):
        derivatives = gap_derivatives(flight, time)
        value = derivatives[order]
        if (value > 0.0) == rising:
            high = time
        else:
            low = time
        slope = derivatives[order + 1]
        following = time - value / slope if slope != 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - time) <= 4e-16 * high:
            return following
        time = following
    return time


@kernel
def inflection_time(flight: Flight, after: float) -> float:
    """First zero after `after` of the third derivative of the gap, itself a free decay; inf if there is none."""
    w = flight.frequency
    zeta = flight.damping_ratio
    _, _, _, p, q = gap_derivatives(flight, after)
    slope = q + zeta * w * p
    square = (1.0 - zeta) * (1.0 + zeta) * w * w
    if square > 0.0:
        damped = math.sqrt(square)
        phase = math.atan2(-p * damped, slope)
        if phase <= 1e-9:
            phase += math.pi
        if phase <= 1e-9:
            phase += math.pi
        return after + phase / damped
    if slope == 0.0:
        return math.inf
    ratio = -p / slope
    if ratio * w <= 1e-9:  # behind, or the zero that `after` stands on: there is no other
        return math.inf
    if square == 0.0:
        return after + ratio
    split = math.sqrt(-square)
    if ratio * split >= 1.0:
        return math.inf
    return after + math.atanh(ratio * split) / split


@kernel
def within_reach(flight: Flight, now: float) -> float:
    """First time from `now` on at which a bound allows a touch, inf if it never does.

    The free part loses energy, so it stays below r / omega with r^2 = z'^2 + omega^2 z^2: the gap cannot close before
    a tool that swings out so far at once would close it.
    """
    z, z1 = free_decay(flight.frequency, flight.damping_ratio, flight.position, flight.velocity, now)
    swing = math.hypot(z1 / flight.frequency, z) - z
    gap = -(flight.start + (z - flight.position) + now * (flight.closing + 0.5 * flight.acceleration * now))
    if gap <= swing:
        return now
    return now + gap_closes(gap - swing, flight.closing + flight.acceleration * now, flight.acceleration)


@kernel
def touch_time(law: SpringDamperLaw, chain: Chain, acceleration: float, horizon: float) -> float:
    """Time (s) until tool and object touch, inf if not within `horizon`; no touch is stepped over.

    Between two zeros of its third derivative the gap has at most one inflection, so at most two extrema, so at most
    three monotone pieces: each is tested by its ends.
    """
    w2 = law.frequency * law.frequency
    flight = Flight(
        law.frequency,
        law.damping_ratio,
        chain.deflection + acceleration / w2,
        chain.deflection_rate,
        min(chain.penetration, 0.0),
        chain.penetration_rate - chain.deflection_rate,
        acceleration,
    )
    low = within_reach(flight, 0.0)
    while low < horizon:
        high = min(inflection_time(flight, low), horizon)
        middle = high
        if (gap_derivatives(flight, low)[2] > 0.0) != (gap_derivatives(flight, high)[2] > 0.0):
            middle = monotone_zero(flight, 2, low, high)
        for piece in range(2):
            begin = low if piece == 0 else middle
            end = middle if piece == 0 else high
            if begin >= end:
                continue
            extremum = end
            if (gap_derivatives(flight, begin)[1] > 0.0) != (gap_derivatives(flight, end)[1] > 0.0):
                extremum = monotone_zero(flight, 1, begin, end)
            for half in range(2):
                left = begin if half == 0 else extremum
                right = extremum if half == 0 else end
                if not left < right or gap_derivatives(flight, 0.5 * (left + right))[1] <= 0.0:
                    continue  # opening: what looks like a touch after a contact has just ended is rounding
                if gap_derivatives(flight, right)[0] > 0.0:
                    if gap_derivatives(flight, left)[0] >= 0.0:
                        return left
                    return monotone_zero(flight, 0, left, right)
        low = within_reach(flight, high)
    return math.inf


@kernel
def cannot_touch(law: SpringDamperLaw, chain: Chain) -> bool:
    """True if, with the flange at rest for good, tool and object can never touch again.

    The object does not come back, and the tool's energy bounds how far it can swing out.
    """
    reach = math.hypot(chain.deflection, chain.deflection_rate / law.frequency)
    parting = chain.flange_velocity + chain.deflection_rate - chain.penetration_rate >= 0.0
    return parting and reach <= chain.deflection - chain.penetration


@kernel
def coupling_impulse(law: SpringDamperLaw, chain: Chain) -> float:
    """Impulse of spring and damper over the contact under way, N s (paper, eq. 21)."""
    change = chain.deflection - chain.start_deflection
    return budget.spring_damper_impulse(
        law.tool_mass, law.frequency, law.damping_ratio, chain.deflection_integral, change
    )


@kernel
def coupling_force(law: SpringDamperLaw, chain: Chain, acceleration: float, contact_force: float) -> float:
    """Force of spring and damper on the tool, N."""
    return law.tool_mass * relative_force(law.frequency, law.damping_ratio, chain.deflection, chain.deflection_rate)


@kernel
def round_off(law: SpringDamperLaw, chain: Chain, target: float) -> None:
    """Give the imposed motion the velocity (m/s) that a ramp ends with but for rounding; nothing else must feel it."""
    chain.deflection_rate -= target - chain.flange_velocity
    chain.flange_velocity = target
