"""MuJoCo Warp, which has MuJoCo's contact, in single precision, here on the CPU; see mujoco.py for the parameters.

https://mujoco.readthedocs.io/en/stable/mjwarp/
"""

from experiments.studies.engines.cases import Case
from experiments.studies.engines.drive import DAMPER, Step, Variant
from experiments.studies.engines.mujoco import ASKED, model

PACKAGE = "mujoco-warp"


def build(case: Case, step: float, impedance: float | None = None) -> Step:
    """Return a step of MuJoCo Warp."""
    import mujoco
    import mujoco_warp
    import warp

    warp.config.quiet = True
    loaded = model(case, step, impedance, "Euler")
    start = mujoco.MjData(loaded)
    start.qvel[0] = case.start_speed
    with warp.ScopedDevice("cpu"):
        there, data = mujoco_warp.put_model(loaded), mujoco_warp.put_data(loaded, start)

    def advance(push: float) -> tuple[float, float, float]:
        data.qfrc_applied.numpy()[0, 0] = push
        with warp.ScopedDevice("cpu"):
            mujoco_warp.step(there, data)
        (x, _), (v, v_p) = data.qpos.numpy()[0].tolist(), data.qvel.numpy()[0].tolist()
        return x, v, v_p

    return advance


VARIANTS = {"solref, d 0.01": Variant(ASKED, DAMPER, {"impedance": 0.01})}
