"""Fig. 2: velocities after an instantaneous impact of a free tool against e (paper, eq. 1, 3, 4); no simulation."""

import numpy as np

from experiments.lab.charts import FLANGE, OBJECT, TOOL
from experiments.paper.layouts import Panels, panels
from experiments.paper.scenes import OBJECT_MASS, TOOL_MASS
from experiments.paper.statements import Statements, section_2_1
from experiments.paper.tables import Table
from impact_gym.physics import impact

TITLE = "Influence of restitution on the final velocities of tool and object"
ALT = """Velocity against restitution from 0 to 1, three straight lines: the object behind a free tool rises from 0.33
to 0.67 m/s, the free tool falls from 0.33 to -0.33 m/s, the object behind a fixed tool rises from 1 to 2 m/s."""


def compute() -> Table:
    """Evaluate the closed forms at v_t = 1 m/s, v_p = 0."""
    restitution = np.linspace(0.0, 1.0, 101)
    tool, hit = impact.free_tool(TOOL_MASS, OBJECT_MASS, 1.0, 0.0, restitution)
    fixed = impact.rigid_tool(1.0, 0.0, restitution)
    columns = {"tool_velocity": tool, "object_velocity": hit, "object_velocity_fixed": fixed}
    return {"restitution": restitution, **{name: np.asarray(column) for name, column in columns.items()}}


@panels(7.0, 4.4)
def plot(table: Table, axes: Panels) -> None:
    e = table["restitution"]
    axes.plot(e, table["object_velocity_fixed"], color=FLANGE, linestyle="--", label="object, tool fixed (eq. 1)")
    axes.plot(e, table["object_velocity"], color=OBJECT, label="object, tool free (eq. 4)")
    axes.plot(e, table["tool_velocity"], color=TOOL, label="free tool (eq. 3)")
    axes.set(xlabel="restitution e", ylabel="velocity after the impact (m/s)")
    axes.legend()


def statements(table: Table) -> Statements:
    fixed, hit, tool = table["object_velocity_fixed"], table["object_velocity"], table["tool_velocity"]
    momentum = TOOL_MASS * tool + OBJECT_MASS * hit - TOOL_MASS
    identity = section_2_1.given  # eq. 1, 3 and 4 evaluated
    for e, velocity in ((1, fixed[-1]), (0, fixed[0])):
        text = f"v_t = 1 m/s, fixed tool: the final velocity is {1 + e} m/s with e = {e}"
        yield identity.number(text, f"{1 + e} m/s", velocity)
    yield identity.claim(
        "The increase in e leads to increases in the final velocity of the object and in the change of the tool's",
        (np.diff(hit) > 0).all() and (np.diff(np.abs(tool - 1.0)) > 0).all(),
        f"V_p {hit[0]:.3f} to {hit[-1]:.3f}, V_t {tool[0]:.3f} to {tool[-1]:.3f} m/s",
        "both rise from each e to the next",
    )
    yield identity.claim(
        "The variation in the velocity of the tool leads to a large reduction in the final velocity of the object",
        (hit < 0.5 * fixed).all(),
        f"V_p of the free tool is {hit[-1] / fixed[-1]:.3f} of that of the fixed one, at every e",
        "less than half, at every e",
    )
    yield identity.claim(
        "The momentum of tool and object is conserved (eq. 2)",
        np.abs(momentum).max() < 1e-12,
        f"largest residual {np.abs(momentum).max():.1g} kg m/s",
        "residual of eq. 2 below 1e-12 kg m/s",
    )
