"""Fig. 25: velocities with the tool fixed to a rigid robot; e = 0.1, k_c = 1e3, m_t = 0.125 kg, m_p = 0.25 kg."""

from matplotlib.figure import Figure

from experiments.lab.charts import OBJECT, velocities
from experiments.paper import time_history as history
from experiments.paper.scenes import DURATION, MECHANISM, MOTION, held, rigid
from experiments.paper.statements import Statement, claim, number
from experiments.paper.tables import Table, histories, trace_of

TITLE = "Velocities with the tool fixed to the rigid robot, e = 0.1"
ALT = (
    "Velocity against time: the object is brought to 0.92 m/s during a contact of some hundredths of a second, and the "
    "robot with its tool brakes to rest. Dotted, the object behind the bistable mechanism: 0.45 m/s."
)


def compute() -> Table:
    """Simulate the rigid tool, and the bistable one that it is compared with."""
    return histories({"rigid": rigid(1e3, 0.1), "bistable": held(MECHANISM, 1e3, 0.1)}, MOTION, DURATION)


def plot(table: Table) -> Figure:
    """Draw the velocities."""
    figure = Figure(figsize=(7.0, 4.0))
    axes = figure.subplots()
    velocities(axes, trace_of(table, "rigid"))
    bistable = trace_of(table, "bistable")
    axes.plot(bistable.time, bistable.object_velocity, color=OBJECT, linestyle=":", label="object, Fig. 23a")
    axes.set_xlim(0.25, 0.75)
    axes.legend(loc="center right", bbox_to_anchor=(1.0, 0.66))
    return figure


def statements(table: Table) -> tuple[Statement, ...]:
    """Compare with sections 5 and 6."""
    fixed, bistable = (history.final_velocity(table, case) for case in ("rigid", "bistable"))
    reduction = 100.0 * (1.0 - bistable / fixed)
    return (
        number(
            "5",
            "The bistable mechanism leads to a 51 % reduction in V_p",
            "51",
            reduction,
            "%",
            fitted=True,
            why=f"V_p = {bistable:.5f} m/s against {fixed:.6f} m/s. The front stop, which the paper does not print, "
            "was "
            "identified with this number.",
        ),
        number(
            "6",
            "A reduction of about 50 % with respect to a rigid connection",
            "5e1",
            reduction,
            "%",
            about=True,
            fitted=True,
        ),
        claim(
            "5",
            "The decoupling and the bistable mechanism reduce V_p below that of the rigid connection",
            bistable < fixed,
            f"{bistable:.5f} m/s against {fixed:.6f} m/s",
            "V_p of Fig. 23a below that of Fig. 25",
        ),
    )
