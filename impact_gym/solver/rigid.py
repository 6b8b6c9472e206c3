"""A tool fixed to the flange: flight is a parabola, and a contact moves the object alone (paper, Fig. 4a)."""

import math

from impact_gym.kernel import kernel
from impact_gym.physics import contact
from impact_gym.physics.coupling import RigidLaw
from impact_gym.solver.collision import IMPULSE, RATE, ROOT, TIME, Collision, Origin, load_common, store_common
from impact_gym.solver.parabola import gap_closes
from impact_gym.solver.state import Array, Bodies, Chain


@kernel
def width(law: RigidLaw) -> int:
    """Length of the scaled state."""
    return 4


@kernel
def reduced_mass(law: RigidLaw, object_mass: float, chain: Chain) -> float:
    """Mass of the relative motion: the flange is imposed, as if infinitely heavy."""
    return object_mass


@kernel
def collision(
    law: RigidLaw, bodies: Bodies, chain: Chain, acceleration: float, threshold: float, scales: contact.Scales
) -> Collision:
    """Return the coefficients of the scaled equations."""
    push = acceleration * scales.time / scales.velocity
    return Collision(bodies.contact, push, 0.0, 0.0, 0.0, threshold / scales.force)


@kernel
def load(law: RigidLaw, chain: Chain, scales: contact.Scales, state: Array) -> None:
    """Write `chain` into the scaled `state`."""
    load_common(chain, scales, state)


@kernel
def rate(law: RigidLaw, collision: Collision, state: Array, out: Array) -> None:
    """d(state)/ds of a contact (paper, eq. 6, second line)."""
    z = state[ROOT]
    w = state[RATE]
    f = contact.force(collision.contact, z, w)
    out[ROOT] = 0.5 * w
    out[RATE] = z * (collision.flange_push - f)
    out[TIME] = z
    out[IMPULSE] = z * f


@kernel
def store(law: RigidLaw, chain: Chain, base: Origin, scales: contact.Scales, state: Array) -> None:
    """Write the scaled `state` back into `chain`."""
    store_common(chain, base, scales, state)


@kernel
def drift(law: RigidLaw, chain: Chain, acceleration: float, time: float) -> None:
    """Move `chain` through `time` (s) of flight, exactly."""
    gap_rate = chain.penetration_rate
    chain.penetration += time * (gap_rate + 0.5 * acceleration * time)
    chain.penetration_rate = gap_rate + acceleration * time
    chain.flange_position += time * (chain.flange_velocity + 0.5 * acceleration * time)
    chain.flange_velocity += acceleration * time
    chain.time += time


@kernel
def touch_time(law: RigidLaw, chain: Chain, acceleration: float, horizon: float) -> float:
    """Time (s) until tool and object touch, inf if not within `horizon`."""
    time = gap_closes(-chain.penetration, chain.penetration_rate, acceleration)
    return time if time <= horizon else math.inf


@kernel
def cannot_touch(law: RigidLaw, chain: Chain) -> bool:
    """True if, with the flange at rest for good, tool and object can never touch again."""
    return chain.penetration_rate <= 0.0


@kernel
def coupling_impulse(law: RigidLaw, chain: Chain) -> float:
    """Impulse of the flange on the tool over the contact under way, N s."""
    return law.tool_mass * (chain.flange_velocity - chain.start_tool_velocity) + chain.impulse


@kernel
def coupling_force(law: RigidLaw, chain: Chain, acceleration: float, contact_force: float) -> float:
    """Force of the flange on the tool, N."""
    return law.tool_mass * acceleration + contact_force


@kernel
def round_off(law: RigidLaw, chain: Chain, target: float) -> None:
    """Give the flange the velocity (m/s) that a ramp ends with but for rounding; the object must not feel it."""
    chain.penetration_rate += target - chain.flange_velocity
    chain.flange_velocity = target
