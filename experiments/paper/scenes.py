"""The scenes of the paper's sections 2 and 4; what the paper does not print is in docs/provenance.md."""

import impact_gym as ig

TOOL_MASS = 0.125  # kg
OBJECT_MASS = 0.25  # kg
DISTANCE = 0.2505  # m, identified: first contact at 0.313 s
MOTION = ig.Trapezoid(speed=1.0, acceleration=8.0, brake=ig.Brake(threshold=1.0, delay=0.016, deceleration=8.0))
DURATION = 1.5  # s


def rigid(stiffness: float, restitution: float, object_mass: float = OBJECT_MASS) -> ig.Scene:
    """Tool fixed to a rigid robot; `stiffness` of the contact in N/m^1.5."""
    return ig.Scene(
        tool=ig.Tool(TOOL_MASS),
        object=ig.Object(object_mass, DISTANCE),
        contact=ig.Contact(stiffness, restitution),
    )


def decoupled(stiffness: float, restitution: float, coupling_stiffness: float) -> ig.Scene:
    """Tool behind a critically damped spring of `coupling_stiffness` (N/m)."""
    return ig.Scene(
        tool=ig.Tool(TOOL_MASS),
        object=ig.Object(OBJECT_MASS, DISTANCE),
        contact=ig.Contact(stiffness, restitution),
        coupling=ig.SpringDamper(coupling_stiffness, damping_ratio=1.0),
    )
