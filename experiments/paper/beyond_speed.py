"""V_p against the impact speed: bistable and linear end-effector with the parameters of Fig. 23, and tool fixed.

The object stands so far ahead that the robot has moved at constant speed for as long as in Fig. 23, 188 ms.
"""

from functools import partial

import numpy as np

import impact_gym as ig
from experiments.lab.charts import FLANGE, OBJECT, TOOL
from experiments.paper.layouts import Panels, mark, panels
from experiments.paper.scenes import DISTANCE, LINEAR, MECHANISM, MOTION, scene
from experiments.paper.statements import Statements, section_1, section_6
from experiments.paper.tables import Row, Table, changes, enclose_changes, from_rows, where
from impact_gym.scene import Coupling

TITLE = "V_p against impact speed, bistable and linear"
ALT = """Two panels against impact speed from 0.2 to 2 m/s: V_p, and V_p over the impact speed. The bistable tool lies
below the linear one between about 0.8 and 1.9 m/s, with its best ratio near 1.1 m/s; below about 0.9 m/s it does not
snap through for good."""
SPEEDS = np.round(np.arange(0.2, 2.0001, 0.02), 2)  # m/s
CRUISE = (DISTANCE - MOTION.speed**2 / (2.0 * MOTION.acceleration)) / MOTION.speed  # s, at constant speed in Fig. 23
COUPLINGS: tuple[Coupling, ...] = (MECHANISM, LINEAR, ig.Rigid())  # by their number in the table
STYLES = (OBJECT, "bistable"), (TOOL, "linear, k_t = 50 N/m"), (FLANGE, "tool fixed")


def row(number: int, speed: float) -> Row:
    """Simulate one approach at `speed` (m/s); a row of the table."""
    motion = ig.Trapezoid(speed, MOTION.acceleration, MOTION.brake)
    distance = speed**2 / (2.0 * MOTION.acceleration) + speed * CRUISE
    outcome = ig.simulate(scene(1e3, 0.1, COUPLINGS[number], distance=distance), motion, duration=2.0)
    return {
        "coupling": number, "speed": speed, "object_velocity": outcome.object_velocity,
        "contacts": len(outcome.contacts), "passes": len(outcome.snap_through),  # of the slider through its alignment
        "alarm": int(outcome.detection_time is not None),
    }  # fmt: skip


def compute() -> Table:
    """Simulate both couplings; changes in contacts, passes and alarm are enclosed."""
    rows: list[Row] = []
    for number in range(len(COUPLINGS)):
        rows += enclose_changes(SPEEDS, partial(row, number), "speed", "contacts", "passes", "alarm")
    return from_rows(rows)


@panels(10.6, 4.6, columns=2, sharex=True)
def plot(table: Table, grid: Panels) -> None:
    for number, (colour, label) in enumerate(STYLES):
        rows = where(table, coupling=number)
        for axes, values in zip(grid, (rows["object_velocity"], rows["object_velocity"] / rows["speed"]), strict=True):
            axes.plot(rows["speed"], values, color=colour, label=label)
            for name, marker in (("contacts", "o"), ("passes", "D")):
                at = [speed for speed, _, _ in changes(rows, "speed", name)]
                mark(axes, at, np.interp(at, rows["speed"], values), colour, marker)
    for axes in grid:
        mark(axes, [], [], marker="D", label="number of snap-throughs changes")
        if any(changes(where(table, coupling=number), "speed", "contacts") for number in range(len(COUPLINGS))):
            mark(axes, [], [], label="number of contacts changes")
        for speed, before, after in changes(where(table, coupling=0), "speed", "passes"):
            axes.axvline(speed, color="#888888", linewidth=0.8, linestyle=":")
            placing = {"xytext": (3, 3), "textcoords": "offset points", "fontsize": 8, "rotation": 90}
            axes.annotate(f"{before} to {after}", (speed, 0.0), **placing)
        axes.set_ylim(0.0, 1.25 * axes.get_ylim()[1])  # room for the legend
        axes.set_xlabel("impact speed (m/s)")
    grid[0].legend(fontsize=9, loc="upper left")
    grid[0].set_ylabel("final object velocity V_p (m/s)")
    grid[1].set_ylabel("V_p over impact speed")


def statements(table: Table) -> Statements:
    rows, linear = where(table, coupling=0), where(table, coupling=1)
    speed = rows["speed"]
    ahead = rows["passes"] % 2 == 0  # the slider ends ahead of the alignment
    fails_below = speed[(speed < MOTION.speed) & ahead].max(initial=0.0)
    turns = changes(rows, "speed", "passes")
    velocity = {v: np.interp(v, speed, rows["object_velocity"]) for v in (1.0, 1.1, 1.2)}
    passes = int(rows["passes"][np.argmin(np.abs(speed - 1.1))])
    change = velocity[1.1] / velocity[1.0] - 1.0
    better = speed[rows["object_velocity"] < np.interp(speed, linear["speed"], linear["object_velocity"])]
    ratio = rows["object_velocity"] / rows["speed"]
    best = int(np.argmin(ratio))
    fixed = where(table, coupling=2, speed=MOTION.speed)["object_velocity"][0]
    faster = speed[rows["object_velocity"] <= fixed].max()
    yield section_1.claim(
        "The approach velocity can be incremented, allowing faster movements",
        faster > MOTION.speed,
        f"up to {faster:.2f} m/s with no more V_p than the fixed tool gives at {MOTION.speed:g} m/s, {fixed:.3f} m/s",
        "at some speed above 1 m/s the bistable tool gives no more V_p than the fixed tool at 1 m/s",
    )
    yield section_6.claim(
        "A decrease in the impact velocity may prevent the mechanism from reaching the second stable configuration",
        0.0 < fails_below < MOTION.speed,
        f"it does not stay there below {fails_below:.3f} m/s"
        + "".join(f"; {before} to {after} passes of the alignment at {v:.3f} m/s" for v, before, after in turns),
        "at some speed below 1 m/s the slider ends ahead of the alignment",
    )
    yield section_6.claim(
        "The bi-stable mechanism has to be tuned to the impact velocity",
        better.min() > speed[0] and better.max() < speed[-1],
        f"that of Fig. 23 is worse than the linear tool below {better.min():.2f} and above {better.max():.2f} m/s",
        "at the lowest and at the highest speed V_p above that of the linear tool",
    )
    yield section_6.claim(
        "A small increase in the impact velocity does not greatly change the behavior of the system",
        abs(change) < 0.1 and passes == 1,
        f"at 1.1 m/s V_p changes by {100 * change:.1f} % with {passes} snap-through; at 1.2 m/s by "
        f"{100 * (velocity[1.2] / velocity[1.0] - 1.0):.0f} %",
        "at 1.1 m/s it snaps through once as at 1 m/s, and V_p is within 10 %",
    )
    yield section_6.claim(
        "The extension of the results to different velocities is difficult due to the non-linearities",
        np.ptp(ratio) > 0.1,
        f"V_p over impact speed goes from {ratio[best]:.3f} at {speed[best]:.2f} m/s to {ratio.max():.3f}; the "
        f"bistable tool beats the linear one from {better.min():.2f} to {better.max():.2f} m/s only",
        "V_p over impact speed varies by more than 0.1 between 0.2 and 2 m/s",
    )
