"""The slider of a mechanism inside a step: which stop pushes, and when it passes the alignment.

Laws without a mechanism have no slider, which is known when a kernel is compiled.
"""

from impact_gym.kernel import by_type, inner_kernel
from impact_gym.physics import coupling
from impact_gym.physics.coupling import (
    FREE,
    FRONT,
    REAR,
    Law,
    Mechanism,
    MechanismLaw,
    RigidLaw,
    RobotLaw,
    Spring,
    SpringDamperLaw,
    VaryingLaw,
)
from impact_gym.solver.chained import OFFSET, OFFSET_RATE, Flight, Piece
from impact_gym.solver.collision import DEFLECTION, DEFLECTION_RATE
from impact_gym.solver.state import Array, Chain

NEVER = -1.0


@inner_kernel
def _false(of: Law) -> bool:
    return False


@inner_kernel
def _true(of: Law) -> bool:
    return True


_has_stops = by_type({Spring: _false, Mechanism: _true})


@inner_kernel
def _coupling_has_stops(law: RobotLaw) -> bool:
    stops: bool = _has_stops(law.coupling)
    return stops


_law_has_stops = by_type({MechanismLaw: _true, RobotLaw: _coupling_has_stops, VaryingLaw: _false})


@inner_kernel
def _flight_has_stops(flight: Flight) -> bool:
    stops: bool = _law_has_stops(flight.law)
    return stops


exists = by_type(
    {
        RigidLaw: _false,
        SpringDamperLaw: _false,
        MechanismLaw: _true,
        RobotLaw: _coupling_has_stops,
        VaryingLaw: _false,
        Flight: _flight_has_stops,
    }
)
"""Whether there is a slider."""


@inner_kernel
def _never(law: Law, now: Piece, state: Array) -> float:
    return NEVER


@inner_kernel
def _spring_alignment(spring: Spring, side: int, stretch: float) -> float:
    return NEVER


@inner_kernel
def _mechanism_alignment(mechanism: Mechanism, side: int, stretch: float) -> float:
    return -side * (mechanism.rest + stretch)


@inner_kernel
def _no_stop(spring: Spring) -> tuple[float, float]:
    return 0.0, 0.0


@inner_kernel
def _mechanism_stop(mechanism: Mechanism) -> tuple[float, float]:
    return mechanism.stop_stiffness, mechanism.stop_damping


_stop = by_type({Spring: _no_stop, Mechanism: _mechanism_stop})
_alignment = by_type({Spring: _spring_alignment, Mechanism: _mechanism_alignment})


@inner_kernel
def _switch(law: MechanismLaw | RobotLaw, now: Piece, state: Array) -> float:
    stretch = (state[DEFLECTION] - state[OFFSET]) * now.units.length
    stretch_rate = (state[DEFLECTION_RATE] - state[OFFSET_RATE]) * now.units.velocity
    switch: float = coupling.switch(law.coupling, now.pressed, stretch, stretch_rate)
    return switch


@inner_kernel
def _passing(law: MechanismLaw | RobotLaw, now: Piece, state: Array) -> float:
    passing: float = _alignment(law.coupling, now.side, (state[DEFLECTION] - state[OFFSET]) * now.units.length)
    return passing


_law_switch = by_type({MechanismLaw: _switch, RobotLaw: _switch, VaryingLaw: _never})
_law_passing = by_type({MechanismLaw: _passing, RobotLaw: _passing, VaryingLaw: _never})


@inner_kernel
def _flight_switch(flight: Flight, now: Piece, state: Array) -> float:
    switch: float = _law_switch(flight.law, now, state)
    return switch


@inner_kernel
def _flight_passing(flight: Flight, now: Piece, state: Array) -> float:
    passing: float = _law_passing(flight.law, now, state)
    return passing


_NONE = {RigidLaw: _never, SpringDamperLaw: _never, VaryingLaw: _never}
switch = by_type({**_NONE, MechanismLaw: _switch, RobotLaw: _switch, Flight: _flight_switch})
"""Positive, N, once another stop pushes than before."""
passing = by_type({**_NONE, MechanismLaw: _passing, RobotLaw: _passing, Flight: _flight_passing})
"""Positive, m, once the slider has passed the alignment."""


@inner_kernel
def _extremum(start: float, start_slope: float, end: float, end_slope: float) -> tuple[float, float]:
    """Place in (0, 1) and value of the extremum of a cubic, given at 0 and 1; place 1 if its slope keeps its sign."""
    if start_slope * end_slope >= 0.0:
        return 1.0, end
    # start + start_slope t + a t^2 + b t^3; the slope has one zero between ends of opposite signs
    a = 3.0 * (end - start) - 2.0 * start_slope - end_slope
    b = start_slope + end_slope - 2.0 * (end - start)
    root = (a * a - 3.0 * b * start_slope) ** 0.5
    for t in (-start_slope / (a + root), -start_slope / (a - root)):
        if 0.0 < t < 1.0:
            return t, start + t * (start_slope + t * (a + t * b))
    return 1.0, end


@inner_kernel
def _turn(
    law: MechanismLaw | RobotLaw,
    now: Piece,
    state: Array,
    rate: Array,
    trial: Array,
    trial_rate: Array,
    h: float,
) -> float:
    start, start_slope = state[DEFLECTION] - state[OFFSET], h * (rate[DEFLECTION] - rate[OFFSET])
    end, end_slope = trial[DEFLECTION] - trial[OFFSET], h * (trial_rate[DEFLECTION] - trial_rate[OFFSET])
    if now.pressed == FREE:
        t, farthest = _extremum(start, start_slope, end, end_slope)
        farthest *= now.units.length
        reaches_stop = coupling.switch(law.coupling, FREE, farthest, 0.0) > 0.0
        return t if reaches_stop or _alignment(law.coupling, now.side, farthest) > 0.0 else 1.0
    # the force that the stop would pull with, in its slopes: a stop that lets go and pushes again within the step
    k, c = _stop(law.coupling)
    towards = -now.pressed
    start_bend = h * (rate[DEFLECTION_RATE] - rate[OFFSET_RATE])
    end_bend = h * (trial_rate[DEFLECTION_RATE] - trial_rate[OFFSET_RATE])
    t, pull = _extremum(
        _switch(law, now, state),
        towards * (k * now.units.length * start_slope + c * now.units.velocity * start_bend),
        _switch(law, now, trial),
        towards * (k * now.units.length * end_slope + c * now.units.velocity * end_bend),
    )
    return t if pull > 0.0 else 1.0


@inner_kernel
def _no_turn(law: Law, now: Piece, state: Array, rate: Array, trial: Array, trial_rate: Array, h: float) -> float:
    return 1.0


_law_turn = by_type({MechanismLaw: _turn, RobotLaw: _turn, VaryingLaw: _no_turn})


@inner_kernel
def _flight_turn(
    flight: Flight, now: Piece, state: Array, rate: Array, trial: Array, trial_rate: Array, h: float
) -> float:
    share: float = _law_turn(flight.law, now, state, rate, trial, trial_rate, h)
    return share


turn = by_type(
    {
        RigidLaw: _no_turn,
        SpringDamperLaw: _no_turn,
        MechanismLaw: _turn,
        RobotLaw: _turn,
        VaryingLaw: _no_turn,
        Flight: _flight_turn,
    }
)
"""Share of a step of length h at which an event is seen that both its ends hide; 1 if there is none.

The slider may go to a free stop, or through the alignment, and back; a stop may let go and push again. Where it turns
is read off the cubic through both ends.
"""


@inner_kernel
def switch_stop(chain: Chain) -> None:
    """Let go of the stop that pushed, or let that one push which the slider has moved into."""
    if chain.pressed != FREE:
        chain.pressed = FREE
    else:
        chain.pressed = FRONT if chain.side > 0 else REAR


@inner_kernel
def record_passage(chain: Chain, snaps: Array) -> None:
    """Note that the slider has passed the alignment now."""
    chain.side = -chain.side
    row = chain.snaps
    chain.snaps += 1
    if row < snaps.shape[0]:
        snaps[row] = chain.time
