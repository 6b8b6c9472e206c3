"""MuJoCo. A contact is a spring and damper between the bodies; there is no coefficient of restitution.

`solref="-stiffness -damping"` gives k/M and c/M, where M is the reduced mass, and `solimp="d d ..."` a constant
impedance d, the part of the acceleration by other forces that the constraint removes
(https://mujoco.readthedocs.io/en/stable/modeling.html#solver-parameters).
"""

from experiments.studies.engines.cases import RADIUS, Case
from experiments.studies.engines.drive import DAMPER, Step, Variant

PACKAGE = "mujoco"
MODEL = """<mujoco>
  <option timestep="{step}" gravity="0 0 0" integrator="{integrator}"/>
  <worldbody>
    <body><joint type="slide" axis="1 0 0"/><geom name="tool" size="{radius}" mass="{tool}"/></body>
    <body pos="{ahead} 0 0"><joint type="slide" axis="1 0 0"/>
      <geom name="object" size="{radius}" mass="{object}"/></body>
  </worldbody>
  <contact><pair geom1="tool" geom2="object" condim="1" {pair}/></contact>
</mujoco>"""
ASKED = "k and c by solref"


def build(case: Case, step: float, impedance: float | None = None, integrator: str = "Euler") -> Step:
    """Return a step of MuJoCo; without an `impedance`, its contact has all default numbers."""
    import mujoco

    k, c = case.linear_stiffness / case.reduced_mass, case.linear_damping(case.asked_restitution) / case.reduced_mass
    pair = "" if impedance is None else f'solref="{-k} {-c}" solimp="{impedance} {impedance} 0.001 0.5 2"'
    words = {"tool": case.tool_mass, "object": case.object_mass, "ahead": case.bodies[1][0], "pair": pair}
    xml = MODEL.format(step=step, radius=RADIUS, integrator=integrator, **words)
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qvel[0] = case.start_speed

    def advance(push: float) -> tuple[float, float, float]:
        data.qfrc_applied[0] = push
        mujoco.mj_step(model, data)
        return data.qpos[0], *data.qvel

    return advance


VARIANTS = {
    "default": Variant("not a parameter"),
    "solref": Variant(ASKED, DAMPER, {"impedance": 0.9}),
    "solref, d 0.01": Variant(ASKED, DAMPER, {"impedance": 0.01}),
    "solref, d 0.01, RK4": Variant(ASKED, DAMPER, {"impedance": 0.01, "integrator": "RK4"}),
    "solref, d 0.01, implicit": Variant(ASKED, DAMPER, {"impedance": 0.01, "integrator": "implicitfast"}),
}
