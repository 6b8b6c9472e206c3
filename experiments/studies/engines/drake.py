"""Drake, point contact: a linear spring with the damping of Hunt and Crossley, or of Kelvin and Voigt (SAP).

TAMSI and Lagged use `hunt_crossley_dissipation` d: F = k x (1 + d x'); SAP uses `relaxation_time` tau:
F = k (x + tau x'). The bodies' stiffnesses act in series, the dissipation is a mean weighted by stiffness, and
relaxation times add (https://drake.mit.edu/doxygen_cxx/group__drake__contacts.html).
"""

from experiments.studies.engines.cases import RADIUS, Case
from experiments.studies.engines.drive import CROSSLEY, DAMPER, Step, Variant
from impact_gym.physics.dissipation import damping_factor

PACKAGE = "drake"


def build(case: Case, step: float, approximation: str | None = None) -> Step:
    """Return a step of Drake; without an `approximation`, its contact has all default numbers."""
    from pydrake.geometry import AddContactMaterial, ProximityProperties, Sphere
    from pydrake.math import RigidTransform
    from pydrake.multibody import plant as multibody
    from pydrake.multibody.tree import PrismaticJoint, SpatialInertia
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder

    builder = DiagramBuilder()
    plant, _ = multibody.AddMultibodyPlant(multibody.MultibodyPlantConfig(time_step=step), builder)
    plant.mutable_gravity_field().set_gravity_vector([0, 0, 0])
    properties, k, d = ProximityProperties(), None, None
    if approximation:
        plant.set_discrete_contact_approximation(getattr(multibody.DiscreteContactApproximation, approximation))
        k, tau = 2 * case.linear_stiffness, case.linear_damping(case.asked_restitution) / case.linear_stiffness
        d = damping_factor("exact", case.asked_restitution, 1.0, 1.0) / case.speed  # s/m; all m = n have the same d
        properties.AddProperty("material", "relaxation_time", tau / 2)
    AddContactMaterial(d, k, multibody.CoulombFriction(0, 0), properties)
    joints = []
    for name, (x, _, mass) in zip(("tool", "object"), case.bodies, strict=True):
        body = plant.AddRigidBody(name, SpatialInertia.SolidSphereWithMass(mass, RADIUS))
        joints.append(plant.AddJoint(PrismaticJoint(name, plant.world_frame(), body.body_frame(), [1, 0, 0])))
        joints[-1].set_default_translation(x)
        plant.RegisterCollisionGeometry(body, RigidTransform(), Sphere(RADIUS), name, properties)
    plant.AddJointActuator("push", joints[0])
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    joints[0].set_translation_rate(context, case.start_speed)
    tool, target = joints

    def advance(push: float) -> tuple[float, float, float]:
        plant.get_actuation_input_port().FixValue(context, [push])
        simulator.AdvanceTo(step * round(context.get_time() / step + 1))
        return tool.get_translation(context), tool.get_translation_rate(context), target.get_translation_rate(context)

    return advance


ASKED = "point stiffness, hunt_crossley_dissipation"
VARIANTS = {
    "default": Variant("not a parameter"),
    "TAMSI": Variant(ASKED, CROSSLEY, {"approximation": "kTamsi"}),
    "Lagged": Variant(ASKED, CROSSLEY, {"approximation": "kLagged"}),
    "SAP": Variant("point stiffness, relaxation_time", DAMPER, {"approximation": "kSap"}),
}
