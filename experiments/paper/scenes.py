"""The scenes of the paper's sections 2 to 5; what the paper does not print is in docs/provenance.md."""

import impact_gym as ig

TOOL_MASS = 0.125  # kg
OBJECT_MASS = 0.25  # kg
DISTANCE = 0.2505  # m, identified: first contact at 0.313 s
MOTION = ig.Trapezoid(speed=1.0, acceleration=8.0, brake=ig.Brake(threshold=1.0, delay=0.016, deceleration=8.0))
DURATION = 1.5  # s
ROBOT = ig.Robot(mass=5.225, stiffness=1.9e5, damping=50.4)  # mass printed, the others identified: `hidden_values`
MECHANISM = ig.Bistable()  # H, L0 and k printed, front stop identified
HOLD = TOOL_MASS * MOTION.acceleration  # N, what keeps the tool on its front stop while the robot accelerates
LINEAR = ig.SpringDamper(stiffness=50.0, damping_ratio=1.0)  # what Fig. 23 compares it with


def held(
    coupling: ig.Bistable | ig.SpringDamper | ig.Rigid,
    stiffness: float,
    restitution: float,
    distance: float = DISTANCE,
) -> ig.Scene:
    """Return the scene with the tool on a coupling, rigid robot; `stiffness` of the contact in N/m^1.5."""
    return ig.Scene(
        ig.Tool(TOOL_MASS), ig.Object(OBJECT_MASS, distance), ig.Contact(stiffness, restitution), coupling=coupling
    )


def decoupled(
    stiffness: float,
    restitution: float,
    coupling_stiffness: float,
    damping_ratio: float = 1.0,
    distance: float = DISTANCE,
) -> ig.Scene:
    """Return the scene with the tool behind a spring of `coupling_stiffness` (N/m), if not said critically damped."""
    return held(ig.SpringDamper(coupling_stiffness, damping_ratio), stiffness, restitution, distance)


def on_robot(
    robot: ig.Robot | ig.RobotTable | None,
    stiffness: float,
    restitution: float,
    object_mass: float = OBJECT_MASS,
    distance: float = DISTANCE,
) -> ig.Scene:
    """Return the scene with the tool fixed to a compliant robot, or to a rigid one if that is None (section 3.2)."""
    return ig.Scene(
        ig.Tool(TOOL_MASS), ig.Object(object_mass, distance), ig.Contact(stiffness, restitution), robot=robot
    )


def rigid(stiffness: float, restitution: float, object_mass: float = OBJECT_MASS) -> ig.Scene:
    """Return the scene with the tool fixed to a rigid robot."""
    return on_robot(None, stiffness, restitution, object_mass)
