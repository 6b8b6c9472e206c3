"""PhysX 5, by SAPIEN. `restitution` of a contact is the mean of both materials'; below a velocity it is not applied.

`bounceThresholdVelocity` of the scene is that velocity, 2 m/s by default in SAPIEN. PhysX has compliant contacts, too,
by a negative restitution, but SAPIEN does not offer them
(https://nvidia-omniverse.github.io/PhysX/physx/5.5.1/_api_build/classPxMaterial.html).
"""

from experiments.studies.engines.cases import RADIUS, Case
from experiments.studies.engines.drive import Step, Variant

PACKAGE = "sapien"


def build(case: Case, step: float, threshold: float | None = None) -> Step:
    """Return a step of PhysX."""
    import sapien
    from sapien import physx

    config = physx.PhysxSceneConfig()
    config.gravity = [0, 0, 0]
    if threshold is not None:
        config.bounce_threshold = threshold
    physx.set_scene_config(config)
    scene = sapien.Scene([physx.PhysxCpuSystem()])
    scene.set_timestep(step)
    pair = []
    for x, v, mass in case.bodies:
        body, entity = physx.PhysxRigidDynamicComponent(), sapien.Entity()
        body.attach(physx.PhysxCollisionShapeSphere(RADIUS, physx.PhysxMaterial(0.0, 0.0, case.restitution)))
        entity.add_component(body)
        entity.set_pose(sapien.Pose([x, 0, 0]))
        scene.add_entity(entity)
        body.set_mass(mass)
        body.set_linear_damping(0.0)
        body.set_sleep_threshold(0.0)
        body.set_linear_velocity([v, 0, 0])
        pair.append(body)
    tool, target = pair

    def advance(push: float) -> tuple[float, float, float]:
        tool.add_force_torque([push, 0, 0], [0, 0, 0])
        scene.step()
        return tool.entity_pose.p[0], tool.linear_velocity[0], target.linear_velocity[0]

    return advance


VARIANTS = {
    "default": Variant("restitution"),
    "threshold 0": Variant("restitution, threshold 0", None, {"threshold": 0.0}),
}
