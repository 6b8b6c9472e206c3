"""Bullet, by PyBullet. `restitution` of a contact is the product of both bodies'; below a velocity it is not applied.

`restitutionVelocityThreshold` of setPhysicsEngineParameter is that velocity. A penetration below `contactSlop` (1e-5 m)
counts as a gap, and `contactERP` adds a velocity in proportion to the penetration. With `contactStiffness` and
`contactDamping` a contact is an implicit spring and damper; both bodies' springs act in series, and their dampings add
(PyBullet Quickstart Guide, https://github.com/bulletphysics/bullet3/tree/master/docs).
"""

from experiments.studies.engines.cases import RADIUS, Case
from experiments.studies.engines.drive import DAMPER, Step, Variant

PACKAGE = "pybullet"


def build(case: Case, step: float, compliant: bool = False, **parameters: float) -> Step:
    """Return a step of Bullet."""
    import pybullet as p

    if p.isConnected():
        p.disconnect()
    p.connect(p.DIRECT)
    p.setTimeStep(step)
    p.setPhysicsEngineParameter(**parameters)
    sphere = p.createCollisionShape(p.GEOM_SPHERE, radius=RADIUS)
    tool, target = (p.createMultiBody(mass, sphere, basePosition=[x, 0, 0]) for x, _, mass in case.bodies)
    for body, restitution in ((tool, case.restitution), (target, 1.0)):
        p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, lateralFriction=0, restitution=restitution,
                         activationState=p.ACTIVATION_STATE_DISABLE_SLEEPING)  # fmt: skip
        if compliant:
            k, c = 2 * case.linear_stiffness, case.linear_damping(case.asked_restitution) / 2
            p.changeDynamics(body, -1, restitution=0, contactStiffness=k, contactDamping=c)
    p.resetBaseVelocity(tool, [case.start_speed, 0, 0])

    def advance(push: float) -> tuple[float, float, float]:
        p.applyExternalForce(tool, -1, [push, 0, 0], [0, 0, 0], p.LINK_FRAME)
        p.stepSimulation()
        x = p.getBasePositionAndOrientation(tool)[0][0]
        return x, p.getBaseVelocity(tool)[0][0], p.getBaseVelocity(target)[0][0]

    return advance


THRESHOLD = {"restitutionVelocityThreshold": 0.0}
VARIANTS = {
    "default": Variant("restitution"),
    "threshold 0": Variant("restitution, threshold 0", None, THRESHOLD),
    "slop and ERP 0": Variant("restitution, all three 0", None, {**THRESHOLD, "contactSlop": 0.0, "contactERP": 0.0}),
    "stiffness": Variant("contactStiffness, contactDamping", DAMPER, {"compliant": True}),
}
