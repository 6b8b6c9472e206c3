"""The scenes of the paper's sections 2 to 5. Numbers called identified are not in the paper, see docs/provenance.md."""

import impact_gym as ig
from impact_gym.couplings import Coupling

TOOL_MASS = 0.125  # kg
OBJECT_MASS = 0.25  # kg
HEAVY_MASS = 2.5  # kg, the object of Fig. 14
REDUCED_MASS = TOOL_MASS * OBJECT_MASS / (TOOL_MASS + OBJECT_MASS)  # kg
DISTANCE = 0.2505  # m, from tool to object; identified from Fig. 5, where the damping force changes sign at 0.321 s
THRESHOLD = 1.0  # N, contact force above which the robot brakes; printed in section 3.2
BRAKE = ig.Brake(threshold=THRESHOLD, delay=0.016, deceleration=8.0)
MOTION = ig.Trapezoid(speed=1.0, acceleration=8.0, brake=BRAKE)
CONSTANT_SPEED = ig.Trapezoid(MOTION.speed, MOTION.acceleration)  # without brake
DURATION = 1.5  # s, of a simulation
ROBOT = ig.Robot(mass=5.225, stiffness=1.9e5, damping=50.4)  # the mass is printed; stiffness and damping are identified
ROBOT_AND_TOOL = ROBOT.mass + TOOL_MASS  # kg, printed in section 3.2 as 5.35
BISTABLE = ig.Bistable()  # height H, free length L0 and stiffness k are printed; the front stop is identified
HOLD = TOOL_MASS * MOTION.acceleration  # N, holding force that a mechanism needs during the acceleration
LINEAR = ig.SpringDamper(stiffness=50.0, damping_ratio=1.0)  # spring that Fig. 23 compares with BISTABLE


def scene(
    contact_stiffness: float, restitution: float, coupling: Coupling | None = None,
    robot: ig.Robot | ig.RobotTable | None = None, *, object_mass: float = OBJECT_MASS, distance: float = DISTANCE,
) -> ig.Scene:  # fmt: skip
    """Return a scene with the paper's tool and object; `contact_stiffness` is in N/m^1.5."""
    contact = ig.Contact(contact_stiffness, restitution)
    return ig.Scene(ig.Tool(TOOL_MASS), ig.Object(object_mass, distance), contact, coupling or ig.Rigid(), robot)
