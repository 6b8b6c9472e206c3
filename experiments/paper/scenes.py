"""The scenes of the paper's sections 2 to 5; what the paper does not print is in docs/provenance.md."""

import impact_gym as ig

TOOL_MASS = 0.125  # kg
OBJECT_MASS = 0.25  # kg
DISTANCE = 0.2505  # m, identified: first contact at 0.313 s
MOTION = ig.Trapezoid(speed=1.0, acceleration=8.0, brake=ig.Brake(threshold=1.0, delay=0.016, deceleration=8.0))
DURATION = 1.5  # s
ROBOT = ig.Robot(mass=5.225, stiffness=1.5e5, damping=53.75)  # mass printed, stiffness and damping identified
ROBOT_DISTANCE = 0.280  # m, identified: the impact falls on a local minimum of the tool's velocity
MECHANISM = ig.Bistable()  # H, L0 and k printed, front stop identified
LINEAR = ig.SpringDamper(stiffness=50.0, damping_ratio=1.0)  # what Fig. 23 compares it with


def rigid(stiffness: float, restitution: float, object_mass: float = OBJECT_MASS) -> ig.Scene:
    """Tool fixed to a rigid robot; `stiffness` of the contact in N/m^1.5."""
    return ig.Scene(
        tool=ig.Tool(TOOL_MASS),
        object=ig.Object(object_mass, DISTANCE),
        contact=ig.Contact(stiffness, restitution),
    )


def decoupled(
    stiffness: float,
    restitution: float,
    coupling_stiffness: float,
    damping_ratio: float = 1.0,
    distance: float = DISTANCE,
) -> ig.Scene:
    """Tool behind a spring of `coupling_stiffness` (N/m), critically damped unless said otherwise."""
    return ig.Scene(
        tool=ig.Tool(TOOL_MASS),
        object=ig.Object(OBJECT_MASS, distance),
        contact=ig.Contact(stiffness, restitution),
        coupling=ig.SpringDamper(coupling_stiffness, damping_ratio),
    )


def held(
    coupling: ig.Bistable | ig.SpringDamper, stiffness: float, restitution: float, distance: float = DISTANCE
) -> ig.Scene:
    """Tool on any coupling, rigid robot."""
    return ig.Scene(
        tool=ig.Tool(TOOL_MASS),
        object=ig.Object(OBJECT_MASS, distance),
        contact=ig.Contact(stiffness, restitution),
        coupling=coupling,
    )


def on_robot(
    robot: ig.Robot | ig.RobotTable | None,
    stiffness: float,
    restitution: float,
    object_mass: float = OBJECT_MASS,
    distance: float = ROBOT_DISTANCE,
) -> ig.Scene:
    """Tool fixed to a compliant robot, or to a rigid one if that is None (section 3.2)."""
    return ig.Scene(
        tool=ig.Tool(TOOL_MASS),
        object=ig.Object(object_mass, distance),
        contact=ig.Contact(stiffness, restitution),
        robot=robot,
    )
