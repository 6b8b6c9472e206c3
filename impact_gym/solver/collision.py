"""One contact in its own scales: what its equations of motion read, and where it began."""

from typing import NamedTuple

from impact_gym.kernel import inner_kernel
from impact_gym.physics import contact
from impact_gym.physics.coupling import Law
from impact_gym.solver.state import Array, Chain

ROOT, RATE, TIME, IMPULSE, DEFLECTION, DEFLECTION_RATE, DEFLECTION_INTEGRAL = range(7)
"""Places in the scaled state: z, w, t, impulse, y, y', integral of y; a rigid coupling has the first four, a chain
without a closed form (`solver.chained`) its own from the sixth on."""


class Collision(NamedTuple):
    """Coefficients of the scaled equations, constant while the flange's acceleration is."""

    contact: contact.Force  # the law of the force
    flange_push: float  # flange acceleration over v / t0
    frequency: float  # omega t0
    damping_ratio: float
    tool_share: float  # reduced mass over tool mass
    threshold: float  # alarm threshold over F0


class Origin(NamedTuple):
    """Where an integration starts, in physical units: what the scaled state is relative to."""

    time: float  # s
    flange_position: float  # m
    flange_velocity: float  # m/s
    acceleration: float  # m/s^2, of the flange
    impulse: float  # N s, of the contact so far
    deflection_integral: float  # m s, likewise
    pull_impulse: float  # N s, likewise
    joined: float  # N s, likewise


@inner_kernel
def origin(chain: Chain, acceleration: float) -> Origin:
    """Return the origin of an integration that starts at the state of `chain`."""
    return Origin(
        chain.time,
        chain.flange_position,
        chain.flange_velocity,
        acceleration,
        chain.impulse,
        chain.deflection_integral,
        chain.pull_impulse,
        chain.joined,
    )


@inner_kernel
def load_common(chain: Chain, scales: contact.Scales, state: Array) -> None:
    """Write penetration, rate, time and impulse of `chain` into the scaled `state`."""
    state[ROOT] = (max(chain.penetration, 0.0) / scales.length) ** 0.5
    state[RATE] = chain.penetration_rate / scales.velocity
    state[TIME] = 0.0
    state[IMPULSE] = 0.0


@inner_kernel
def store_clock(chain: Chain, base: Origin, scales: contact.Scales, state: Array) -> None:
    """Write time, imposed motion and penetration rate of the scaled `state` back into `chain`."""
    elapsed = state[TIME] * scales.time
    chain.time = base.time + elapsed
    chain.flange_position = base.flange_position + elapsed * (base.flange_velocity + 0.5 * base.acceleration * elapsed)
    chain.flange_velocity = base.flange_velocity + base.acceleration * elapsed
    chain.penetration_rate = state[RATE] * scales.velocity


@inner_kernel
def store_common(chain: Chain, base: Origin, scales: contact.Scales, state: Array) -> None:
    """Write what every scaled `state` of a contact has back into `chain`."""
    store_clock(chain, base, scales, state)
    chain.penetration = state[ROOT] * state[ROOT] * scales.length
    chain.impulse = base.impulse + state[IMPULSE] * scales.force * scales.time


@inner_kernel
def tool_gain(law: Law, chain: Chain) -> float:
    """Momentum that the tool has gained in the contact under way, N s."""
    return law.tool_mass * (chain.flange_velocity + chain.deflection_rate - chain.start_tool_velocity)
