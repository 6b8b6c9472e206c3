"""Check, before a training, whether the task of a set-up is possible."""

import math
from collections.abc import Iterator
from itertools import product

from impact_gym.quantities import EPISODE, QUANTITIES, SCENARIO, SET_UP
from impact_gym.support.validation import unit_text
from impact_gym.task import ObservationSpec, Task
from impact_gym.task.task import MOUNT_IDS

OVERSHOOT = 2.0
"""Largest ratio of a compliant robot's acceleration to the commanded acceleration, if the robot is an undamped spring
and the command jumps once. Several jumps at the robot's natural frequency can cause a larger ratio."""
FAR = 5.0  # a number that leaves its range in an observation by a larger factor may have a wrong unit


def doubts(task: Task) -> list[str]:
    """Return a sentence for each problem found; ValueError: the front stop cannot hold the tool."""
    (near, far), (least, most) = task.scenario.distance, task.acceleration_range
    observed = ObservationSpec(task).scale("position").high
    first_reading = task.longest("reaction_delay") + task.control_period
    sentences, given = [], task.by_path() | task.ranges
    scenario = (row for row in SCENARIO if row.id != "distance")
    for row in (QUANTITIES["velocity"], QUANTITIES["time_since_alarm"], *scenario, *EPISODE, *SET_UP):
        name, (start, end, *_), unit = row.scale.ends or row.id, row.scale, unit_text(row.unit)
        low, high = (0.0, 0.0) if given.get(name) is None else row.interval(given[name])
        if max(-low, high) > FAR * max(-start, end) or 0.0 < high < start / FAR:
            value = f"{low:g} to {high:g}" if low < high else f"{low:g}"
            sentences.append(f"{name} is {value} {unit}, expected is {start:g} to {end:g} {unit}: is the unit right?")
    if far > observed:
        sentences.append(
            f"objects stand up to {far:g} m ahead, but the observation ends at a flange position of {observed:g} m"
        )
    if near <= 0.5 * most * first_reading**2:
        sentences.append(
            f"the nearest objects stand {1e3 * near:.3g} mm ahead: the tool can get there before the first reading"
            f" arrives, {1e3 * first_reading:g} ms after the start"
        )
    if 0.0 < task.coupling.holding_force < math.inf:
        # largest accelerations (m/s^2) at which the front stop holds the tool
        holds = [corner.coupling.holding_force / corner.tool_mass for corner in corners(task)]
        if max(holds) < least:
            raise ValueError(
                f"environment.coupling must hold the tool at {least:g} m/s^2, the arm's lowest acceleration, but its "
                f"front stop holds at most {max(holds):.3g} m/s^2"
            )
        if min(holds) < most * (1.0 if task.robot is None else OVERSHOOT):
            swings = f", and a compliant robot can overshoot to {OVERSHOOT:g} times this and more" if task.robot else ""
            sentences.append(
                f"the front stop holds the tool up to {min(holds):.3g} m/s^2, the arm reaches {most:g} m/s^2{swings}: "
                f"above {min(holds):.3g} m/s^2 the mechanism leaves the stop before a touch"
            )
    return sentences


def corners(task: Task) -> Iterator[Task]:
    """Yield a task for each combination of the lowest and highest numbers of tool, coupling and robot."""
    names = [name for name in task.drawn if name in MOUNT_IDS]
    middles = {name: QUANTITIES[name].middle(*pair) for name, pair in task.drawn.items()}
    for ends in product(*(task.drawn[name] for name in names)):
        yield task.at(middles | dict(zip(names, ends, strict=True)))
