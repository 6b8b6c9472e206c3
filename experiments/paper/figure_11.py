"""Fig. 11: imposed position and velocity of the flange before the collision; the dot marks the impact."""

import numpy as np

from experiments.lab.charts import FLANGE, OBJECT
from experiments.paper.layouts import Panels, panels
from experiments.paper.scenes import MOTION, ROBOT, scene, simulate_with_trace
from experiments.paper.statements import Statements, section_3_2
from experiments.paper.tables import Table
from impact_gym.robot import default_approach

TITLE = "Position and velocity imposed by the robot control system"
ALT = """Two panels against time. The position in the robot's base frame bends upward and then rises in a straight line;
the velocity rises to 1 m/s and holds. A dot on each marks the impact at 0.34 s, at constant velocity."""


def compute() -> Table:
    """Simulate the approach of Fig. 13b; positions in the base frame of our robot model."""
    outcome, trace = simulate_with_trace(scene(1e5, 1.0, robot=ROBOT))
    detection = np.inf if outcome.detection_time is None else outcome.detection_time
    return {
        "time": trace.time,
        "position": default_approach().x[0] + trace.command_position,
        "velocity": trace.command_velocity,
        "impact": np.full_like(trace.time, outcome.contacts[0].start),
        "detection": np.full_like(trace.time, detection),
    }


@panels(10.4, 3.8, columns=2, sharex=True)
def plot(table: Table, grid: Panels) -> None:
    time, impact = table["time"], table["impact"][0]
    columns = {"position": "imposed position x_r (m)", "velocity": "imposed velocity v_r (m/s)"}
    for axes, (column, label) in zip(grid, columns.items(), strict=True):
        before = time <= impact
        axes.plot(time[before], table[column][before], color=FLANGE)
        axes.plot(time[~before], table[column][~before], color=FLANGE, linestyle=":", linewidth=1.0, label="after it")
        axes.plot(impact, np.interp(impact, time, table[column]), "o", color=OBJECT, markersize=8, label="impact")
        axes.set(xlabel="time (s)", ylabel=label, xlim=(0.0, 0.6))
        axes.legend(loc="center right")


def statements(table: Table) -> Statements:
    time, velocity, impact, detection = table["time"], table["velocity"], table["impact"][0], table["detection"][0]
    at_impact = np.interp(impact, time, velocity)
    falling = np.flatnonzero((velocity[1:] < velocity[:-1]) & (time[:-1] > impact))
    braking = (velocity < 0.9) & (velocity > 0.1) & (time > impact)
    slope, offset = np.polyfit(time[braking], velocity[braking], 1)
    yield section_3_2.given.claim(
        "A collision occurred when the robot moved at a constant velocity",
        at_impact == MOTION.speed and time[falling[0]] > impact,
        f"impact at {impact:.4f} s, at an imposed velocity of {at_impact:g} m/s",
        "the imposed velocity is at its plateau of 1 m/s at the impact",
        why="The object was put where this is so.",
    )
    yield section_3_2.given.number(
        "The robot begins to perform braking after 16 ms",
        "16 ms",
        1e3 * ((MOTION.speed - offset) / slope - detection),
        why="An input, read back from the simulation: from the instant at which the contact force exceeds 1 N to where "
        "the straight line through the braking meets 1 m/s.",
    )
