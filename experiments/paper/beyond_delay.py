"""Where a person reacts and not the robot, or a channel lies between: what decoupling gains then, and what braking.

Maps of V_p over the rigid tool's, by the delay of the brake and the contact's stiffness, and V_p over that without a
brake. Delays from 0 to 500 ms, stiffness over six decades; e = 0.1 and 0.25 kg as in Fig. 23, and e = 0.5 and 1 kg.
"""

from itertools import product

import numpy as np

import impact_gym as ig
from experiments.lab.charts import FLANGE, OBJECT, TOOL
from experiments.paper.layouts import Panels, panels
from experiments.paper.scenes import BRAKE, LINEAR, MECHANISM, MOTION, STEADY, THRESHOLD, scene
from experiments.paper.statements import Statements, section_1
from experiments.paper.tables import Row, Table, from_rows, where
from impact_gym.scene import Coupling

TITLE = "Where the brake comes late: a person's delay, a channel's, or a contact that is over before"
ALT = """Two maps of V_p over that of the rigid tool, by delay and contact stiffness, of the spring and of the bistable
mechanism: down to a third at short delays; right of a border near 100 ms, above 1: there decoupling hurts; the border
of an object of 1 kg, where it has one, is dashed. A chart of
V_p over that without a brake after 16 ms: 1 for the rigid tool from k_c = 1e5 on, 0.6 and 0.35 for the other two."""
COUPLINGS: dict[str, Coupling] = {"rigid": ig.Rigid(), "spring": LINEAR, "bistable": MECHANISM}
OBJECTS = {"light": (0.1, 0.25), "heavy": (0.5, 1.0)}  # e, kg
DELAYS = np.array([0, 4, 8, 12, 16, 20, 30, 40, 50, 75, 100, 125, 150, 200, 250, 300, 400, 500]) / 1000  # s
STIFFNESS = np.logspace(2, 8, 25)  # N/m^1.5
DURATION = 4.0  # s
NEVER = -1.0  # s, in place of a delay: no brake
PERSON = 0.2  # s, a simple reaction of a person


def compute() -> Table:
    """Simulate every delay, and no brake, at every stiffness, for each coupling and object."""
    rows: list[Row] = []
    braking = ig.Trapezoid(MOTION.speed, MOTION.acceleration, ig.Brake(THRESHOLD, 0.0, BRAKE.deceleration))
    stiffness = {"contact.stiffness": STIFFNESS[:, None]}
    for (coupling, what), (kind, (e, mass)) in product(COUPLINGS.items(), OBJECTS.items()):
        approach = scene(1e3, e, what, object_mass=mass)
        free = ig.sweep(approach, STEADY, stiffness, duration=DURATION)
        braked = ig.sweep(approach, braking, {**stiffness, "motion.brake.delay": DELAYS[None]}, duration=DURATION)
        grid = np.hstack([free.object_velocity, braked.object_velocity])
        for (k_c, delay), velocity in zip(product(STIFFNESS, (NEVER, *DELAYS)), grid.flat, strict=True):
            about = {"coupling": coupling, "object": kind, "stiffness": k_c, "delay": delay}
            rows.append({**about, "object_velocity": velocity})
    return from_rows(rows)


def velocities(table: Table, coupling: str, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Return V_p without a brake (stiffness,) and with one (stiffness, delays)."""
    grid = where(table, coupling=coupling, object=kind)["object_velocity"].reshape(len(STIFFNESS), -1)
    return grid[:, 0], grid[:, 1:]


def ratio(table: Table, coupling: str, kind: str) -> np.ndarray:
    """Return V_p over that of the rigid tool (stiffness, delays)."""
    return velocities(table, coupling, kind)[1] / velocities(table, "rigid", kind)[1]


@panels(13.5, 4.2, columns=3)
def plot(table: Table, grid: Panels) -> None:
    steps = np.arange(len(DELAYS))
    for axes, coupling in zip(grid[:2], ("spring", "bistable"), strict=True):
        values = ratio(table, coupling, "light")
        mesh = axes.pcolormesh(steps, STIFFNESS, np.log2(values), cmap="RdBu_r", vmin=-1.5, vmax=1.5, shading="nearest")
        axes.contour(steps, STIFFNESS, values, levels=[1.0], colors="black", linewidths=1.5)
        heavy = ratio(table, coupling, "heavy")
        if heavy.max() > 1.0:
            axes.contour(steps, STIFFNESS, heavy, levels=[1.0], colors="black", linewidths=1.5, linestyles="dashed")
        axes.set(yscale="log", title=coupling, xlabel="delay of the brake (ms)", ylabel="k_c (N/m^1.5)")
        axes.set_xticks(steps[::3], [f"{1e3 * delay:g}" for delay in DELAYS[::3]])
        bar = axes.figure.colorbar(mesh, ax=axes, label="V_p over the rigid tool's")
        bar.ax.set(title="ratio")
        bar.set_ticks([-1.0, 0.0, 1.0], labels=["1/2", "1", "2"])
    for coupling, colour in zip(COUPLINGS, (FLANGE, TOOL, OBJECT), strict=True):
        free, braked = velocities(table, coupling, "light")
        grid[2].plot(STIFFNESS, braked[:, list(DELAYS).index(BRAKE.delay)] / free, color=colour, label=coupling)
    grid[2].set(xscale="log", xlabel="k_c (N/m^1.5)", ylabel="V_p over that without a brake, 16 ms", ylim=(0.0, 1.1))
    grid[2].legend()


def statements(table: Table) -> Statements:
    said = "A tool that is able to delay the moment in which it actively pushes the objects, giving time to "
    spans = {"the robot": (BRAKE.delay >= DELAYS, "up to 16 ms"), "the operator": (DELAYS >= PERSON, "from 200 ms on")}
    for who, (when, words) in spans.items():
        cases = [(coupling, kind) for coupling in ("spring", "bistable") for kind in OBJECTS]
        below, worst = zip(*(((r := ratio(table, *case)[:, when]) < 1.0, r.max()) for case in cases), strict=True)
        coupling, kind = cases[int(np.argmax(worst))]
        yield section_1.claim(
            said + who,
            np.mean(below) > 0.95,
            f"{words} V_p is below the rigid tool's in {100 * np.mean(below):.0f} % of the map; at worst it is "
            f"{max(worst):.2f} of it ({coupling}, {OBJECTS[kind][1]:g} kg)",
            f"V_p of spring and mechanism below the rigid tool's in 95 % of the map, six decades of stiffness, {words}",
            why=""
            if who == "the robot"
            else "A person reacts after 0.21 to 0.23 s on average (D. L. Woods et al., Front. Hum. "
            "Neurosci. 9 (2015) 131). By then the tool is at the end of its way, and the robot pushes the object.",
        )
    free, braked = velocities(table, "rigid", "light")
    stiff = 1.0 - (braked[:, list(DELAYS).index(BRAKE.delay)] / free)[STIFFNESS >= 1e6]
    yield section_1.claim(
        "If the impact is short in comparison with the typical response time of the robot, the robot has a very short "
        "time to decelerate",
        np.abs(stiff).max() < 0.01,
        f"from k_c = 1e6 on the brake changes V_p of the rigid tool by at most {100 * np.abs(stiff).max():.2f} %",
        "braking gains less than 1 % where the contact of the rigid tool is over within 16 ms",
    )
