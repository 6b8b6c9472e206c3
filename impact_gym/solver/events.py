"""Events inside a contact step: what each one is a zero of, and the step length that ends exactly on it."""

from impact_gym.kernel import inner_kernel
from impact_gym.physics import contact
from impact_gym.physics.coupling import Law
from impact_gym.solver import slider, stepper
from impact_gym.solver.chained import Flight, Piece
from impact_gym.solver.collision import RATE, ROOT, TIME, Collision
from impact_gym.solver.dop853 import STAGES, STATE, TRIAL
from impact_gym.solver.state import Array

SHORTEST_STEP = 1e-10
"""Of a step that starts on an event and ends beyond it; below this it is taken to happen at once."""

NONE, SEPARATION, HORIZON, SWITCH, PASSAGE, CLAMP, PEAK, THRESHOLD, TOUCH, TURN, BEND = range(11)
"""Kinds, in the order in which a step is searched: each search looks only at what the one before left of the step.

SEPARATION: a root z that has passed zero does not come back (dt = z ds runs backwards there), so none is missed.
CLAMP: the force reaches or leaves zero with the surfaces in touch, where it has a kink.
PEAK: the force stops rising; with it, the force is monotone in every step, so THRESHOLD is seen by its ends.
SWITCH, PASSAGE: of the slider of a mechanism, see `solver.slider`.
TOUCH, TURN, BEND: of a flight, the first place of whose state is the penetration: it, its rate, or the change of that
passes zero.
"""


@inner_kernel
def value(
    kind: int, law: Law | Flight, collision: Collision | Piece, horizon: float, state: Array, rate: Array
) -> float:
    """Signed distance from event `kind`; each changes sign where its event is."""
    z: float = state[ROOT]
    w: float = state[RATE]
    time: float = state[TIME]
    if kind == SEPARATION:
        return -z
    if kind == HORIZON:
        return time - horizon
    if kind == SWITCH:
        switch: float = slider.switch(law, collision, state)
        return switch
    if kind == PASSAGE:
        passing: float = slider.passing(law, collision, state)
        return passing
    if kind == TOUCH:
        return z
    if kind == TURN:
        return w
    if kind == BEND:
        bend: float = rate[RATE]
        return bend
    if kind == CLAMP:
        grip: float = contact.grip(collision.contact, z, w)
        return grip
    if kind == PEAK:
        return -contact.force_slope(collision.contact, z, w, rate[RATE])
    return contact.force(collision.contact, z, w) - collision.threshold


@inner_kernel
def slope(kind: int, collision: Collision | Piece, state: Array, rate: Array) -> float:
    """d(value)/ds; zero where no formula is at hand, which leaves bisection and secants."""
    z: float = state[ROOT]
    z_slope: float = rate[ROOT]
    w_slope: float = rate[RATE]
    time_slope: float = rate[TIME]
    if kind == SEPARATION:
        return -z_slope
    if kind == HORIZON:
        return time_slope
    if kind == CLAMP:
        return contact.grip_slope(collision.contact, z, state[RATE], w_slope)
    if kind == TOUCH:
        return z_slope
    if kind == TURN:
        return w_slope
    if kind == THRESHOLD:
        force_slope: float = contact.force_slope(collision.contact, z, state[RATE], w_slope)
        return force_slope * contact.slope_scale(collision.contact, z)
    return 0.0


@inner_kernel
def starts_on(kind: int, law: Law | Flight, collision: Collision | Piece, horizon: float, work: Array) -> bool:
    """True if the step, which ends beyond event `kind`, also starts on it but for rounding.

    A stop that has just let go, or a contact that has just ended, may recur in the very next step: its first zero is
    then the one behind, and a shorter step tells them apart.
    """
    start = value(kind, law, collision, horizon, work[STATE], work[0])
    return start > -1e-9 * value(kind, law, collision, horizon, work[TRIAL], work[STAGES - 1])


@inner_kernel
def slider_recurs(law: Law | Flight, collision: Piece, horizon: float, work: Array) -> bool:
    """True if the last attempt starts on an event of the slider and ends beyond it."""
    if slider.switch(law, collision, work[TRIAL]) > 0.0 and starts_on(SWITCH, law, collision, horizon, work):
        return True
    return slider.passing(law, collision, work[TRIAL]) > 0.0 and starts_on(PASSAGE, law, collision, horizon, work)


@inner_kernel
def cubic_zero(start: float, start_slope: float, end: float, end_slope: float) -> float:
    """Guess the zero in (0, 1) of the cubic with these values, of opposite signs, and slopes at 0 and 1."""
    t = start / (start - end)
    for _ in range(4):
        square, cube = t * t, t * t * t
        f = start * (1.0 - 3.0 * square + 2.0 * cube) + end * (3.0 * square - 2.0 * cube)
        f += start_slope * (t - 2.0 * square + cube) + end_slope * (cube - square)
        tangent = 6.0 * (end - start) * (t - square)
        tangent += start_slope * (1.0 - 4.0 * t + 3.0 * square) + end_slope * (3.0 * square - 2.0 * t)
        if tangent == 0.0:
            break
        t -= f / tangent
    return t


@inner_kernel
def land(
    kind: int, method: int, law: Law | Flight, collision: Collision | Piece, horizon: float, work: Array, h: float
) -> float:
    """Shorten the last attempt, of length `h`, so that it ends on event `kind`; return its new length.

    Newton's method on the step length itself, every iterate a full step of the integrator, begun at the zero of the
    cubic through both ends and held inside the bracket [0, h] by its secant (Illinois): what is found is a zero of the
    computed motion, not of an interpolant. The peak is wanted for its height, which does not feel small errors of its
    place, and has no slope at hand: it is found by secants alone.
    """
    low = 0.0
    low_value = value(kind, law, collision, horizon, work[STATE], work[0])
    high = h
    high_value = value(kind, law, collision, horizon, work[TRIAL], work[STAGES - 1])
    if low_value == 0.0 or (low_value > 0.0) == (high_value > 0.0):  # by rounding: the step starts on an event
        low_value = -high_value * 1e-300
    following = low
    if kind not in (PEAK, SWITCH, PASSAGE, BEND):
        low_slope = slope(kind, collision, work[STATE], work[0])
        high_slope = slope(kind, collision, work[TRIAL], work[STAGES - 1])
        following = h * cubic_zero(low_value, h * low_slope, high_value, h * high_slope)
    newton = False
    at = h
    side = 0
    for _ in range(60):
        precision = 1e-7  # of a step of Newton's method: the next would be its square
        if not newton or not low < following < high:
            precision = 1e-5 if kind == PEAK else 1e-14
        if not low < following < high:
            following = (low * high_value - high * low_value) / (high_value - low_value)
        if not low < following < high:
            following = 0.5 * (low + high)
        moved = abs(following - at)
        at = following
        stepper.attempt(method, law, collision, work, at)
        at_value = value(kind, law, collision, horizon, work[TRIAL], work[STAGES - 1])
        if moved <= precision * h or at_value == 0.0:
            break
        if (at_value > 0.0) == (high_value > 0.0):
            high, high_value = at, at_value
            low_value *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, low_value = at, at_value
            high_value *= 0.5 if side < 0 else 1.0
            side = -1
        tangent = slope(kind, collision, work[TRIAL], work[STAGES - 1])
        newton = tangent != 0.0
        following = at - at_value / tangent if newton else low
    return at
