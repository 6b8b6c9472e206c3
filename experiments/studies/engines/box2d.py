"""Box2D 3, by pyb2d3. `restitution` of a contact is the larger of both shapes'; below a velocity it is not applied.

`restitutionThreshold` of the world is that velocity, 1 m/s by default
(https://docs.rs/boxdd-sys/0.1.0/boxdd_sys/ffi/struct.b2WorldDef.html, the documentation of b2WorldDef).
"""

from math import pi

from experiments.studies.engines.cases import RADIUS, Case
from experiments.studies.engines.drive import DEFAULTS, JUMP, Step, Variant

PACKAGE = "pyb2d3"


def build(case: Case, step: float, threshold: float | None = None) -> Step:
    """Return a step of Box2D."""
    import pyb2d3 as b

    world = b.World(gravity=(0, 0))
    if threshold is not None:
        world.restitution_threshold = threshold
    world.sleeping_enabled = False
    pair = []
    for x, v, mass in case.bodies:
        body = world.create_dynamic_body(position=(x, 0), linear_velocity=(v, 0), fixed_rotation=True)
        material = b.surface_material(restitution=case.restitution, friction=0.0)
        definition = b.shape_def(density=mass / (pi * RADIUS**2), material=material)
        body.create_shape(definition, b.circle(radius=RADIUS))
        pair.append(body)
    tool, target = pair

    def advance(push: float) -> tuple[float, float, float]:
        tool.apply_force_to_center((push, 0), wake=True)
        world.step(step, 4)
        return tool.position[0], tool.linear_velocity[0], target.linear_velocity[0]

    return advance


VARIANTS = {
    "default": Variant("restitution", DEFAULTS),
    "threshold 0": Variant("restitution, threshold 0", JUMP, {"threshold": 0.0}),
}
