"""Rapier, by its Python package. `restitution` is "the exit velocity over the entry velocity along the normal".

The rule that combines the two colliders' coefficients is the average by default
(https://rapier.rs/docs/user_guides/python/collider_restitution).
"""

from experiments.studies.engines.cases import RADIUS, Case
from experiments.studies.engines.drive import Step, Variant

PACKAGE = "rapier3d"


def build(case: Case, step: float) -> Step:
    """Return a step of Rapier."""
    import rapier3d as r

    world = r.PhysicsWorld(gravity=(0.0, 0.0, 0.0))
    world.integration_parameters.dt = step

    pair = []
    for x, v, mass in case.bodies:
        free = r.RigidBody.dynamic().translation((x, 0.0, 0.0)).linvel((v, 0.0, 0.0)).can_sleep(False)
        handle = world.add_body(free.build())
        ball = r.Collider.ball(RADIUS).mass(mass).restitution(case.restitution).friction(0.0)
        world.add_collider(ball.build(), handle)
        pair.append(world.rigid_bodies[handle])
    tool, target = pair

    def advance(push: float) -> tuple[float, float, float]:
        tool.reset_forces(True)
        tool.add_force((push, 0.0, 0.0), True)
        world.step()
        return tool.translation.x, tool.linvel.x, target.linvel.x

    return advance


VARIANTS = {"default": Variant("restitution")}
