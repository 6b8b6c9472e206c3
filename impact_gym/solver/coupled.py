"""The choice among chains, made when a kernel is compiled: each name is one function, whatever holds the tool."""

from collections.abc import Callable
from typing import Any

from impact_gym.kernel import by_type
from impact_gym.physics.coupling import MechanismLaw, RigidLaw, RobotLaw, SpringDamperLaw, VaryingLaw
from impact_gym.solver import chain_bounds, chained, rigid, spring_damper
from impact_gym.solver.chained import Flight
from impact_gym.solver.collision import tool_gain

Kernel = Callable[..., Any]


def _choice(of_rigid: Kernel, of_spring: Kernel, of_chained: Kernel, **others: Kernel) -> dict[type, Kernel]:
    varying, flight = others.get("varying", of_chained), others.get("flight")
    choice = {
        RigidLaw: of_rigid,
        SpringDamperLaw: of_spring,
        MechanismLaw: of_chained,
        RobotLaw: of_chained,
        VaryingLaw: varying,
    }
    return choice if flight is None else {**choice, Flight: flight}


width = by_type(_choice(rigid.width, spring_damper.width, chained.width, flight=chained.flight_width))
reduced_mass = by_type(
    _choice(
        rigid.reduced_mass, spring_damper.reduced_mass, chained.tool_reduced_mass, varying=chained.varying_reduced_mass
    )
)
collision = by_type(_choice(rigid.collision, spring_damper.collision, chained.collision))
load = by_type(_choice(rigid.load, spring_damper.load, chained.load))
rate = by_type(_choice(rigid.rate, spring_damper.rate, chained.rate, flight=chained.flight_rate))
store = by_type(_choice(rigid.store, spring_damper.store, chained.store))
round_off = by_type(_choice(rigid.round_off, spring_damper.round_off, chained.round_off))
cannot_touch = by_type(_choice(rigid.cannot_touch, spring_damper.cannot_touch, chain_bounds.cannot_touch))
coupling_impulse = by_type(
    _choice(rigid.coupling_impulse, spring_damper.coupling_impulse, chain_bounds.coupling_impulse)
)
coupling_force = by_type(_choice(rigid.coupling_force, spring_damper.coupling_force, chain_bounds.coupling_force))
tool_momentum = by_type(
    _choice(tool_gain, tool_gain, tool_gain, varying=chain_bounds.varying_momentum),
)
smooth_until = by_type(
    {
        RigidLaw: chained.all_smooth,
        SpringDamperLaw: chained.all_smooth,
        MechanismLaw: chained.all_smooth,
        RobotLaw: chained.smooth_until,
        VaryingLaw: chained.smooth_until,
    }
)
drift = by_type({RigidLaw: rigid.drift, SpringDamperLaw: spring_damper.drift})
touch_time = by_type({RigidLaw: rigid.touch_time, SpringDamperLaw: spring_damper.touch_time})
