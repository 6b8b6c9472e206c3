"""Newton. Its shapes have `restitution`, which XPBD applies if asked, and `ke`, `kd` (N/m, N s/m) for other solvers.

XPBD needs `enable_restitution=True`. SemiImplicit has a spring ke and a damper kd, which acts only while the bodies
approach; so e is the square root of the restitution of a damper in both directions
(https://newton-physics.github.io/newton/latest/concepts/collisions.html). The MuJoCo solver of
Newton 1.8 asks for MuJoCo 3.17, so it is not measured beside MuJoCo 4.
"""

from typing import Any

from experiments.studies.engines.cases import RADIUS, Case
from experiments.studies.engines.drive import Step, Variant

PACKAGE = "newton"


def build(case: Case, step: float, solver: str, compliant: bool = False, **options: Any) -> Step:
    """Return a step of Newton by one of its solvers, on the CPU."""
    import newton
    import warp

    warp.config.quiet = True
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    material: dict[str, Any] = {"restitution": case.restitution, "mu": 0.0, "density": 0.0}
    if compliant:
        damping = case.linear_damping(case.asked_restitution**2)
        material |= {"ke": case.linear_stiffness, "kd": damping, "kf": 0.0, "ka": 0.0}
    for x, _, mass in case.bodies:
        inertia = 0.4 * mass * RADIUS**2
        body = builder.add_body(xform=warp.transform((x, 0.0, 0.0), warp.quat_identity()), mass=mass,
                                inertia=warp.mat33(inertia, 0, 0, 0, inertia, 0, 0, 0, inertia))  # fmt: skip
        builder.add_shape_sphere(body, radius=RADIUS, cfg=newton.ModelBuilder.ShapeConfig(**material))
    model = builder.finalize(device="cpu")
    engine = getattr(newton.solvers, f"Solver{solver}")(model, **options)
    states, control, contacts = [model.state(), model.state()], model.control(), model.contacts()
    states[0].body_qd.numpy()[0, 0] = case.start_speed

    def advance(push: float) -> tuple[float, float, float]:
        now, after = states
        now.clear_forces()
        now.body_f.numpy()[0, 0] = push
        model.collide(now, contacts)
        engine.step(now, after, control, contacts, step)
        states.reverse()
        (v, v_p), x = after.body_qd.numpy()[:, 0].tolist(), float(after.body_q.numpy()[0, 0])
        return x, v, v_p

    return advance


VARIANTS = {
    "XPBD default": Variant("restitution, not enabled", None, {"solver": "XPBD"}),
    "XPBD restitution": Variant("restitution, enabled", None, {"solver": "XPBD", "enable_restitution": True}),
    "SemiImplicit": Variant("ke and kd", None, {"solver": "SemiImplicit", "compliant": True}),
}
